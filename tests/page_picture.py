"""The README's picture of a report to touch, from its top to below the arm: with Playwright and the system's Chromium.

symcal run configs/real/franka_fr3.yaml
python tests/page_picture.py reports/franka_fr3/report.html reports/report.png
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright
from test_page_browser import SOFTWARE, SOON

SIZE = {"width": 1400, "height": 1000}


def main(page: Path, picture: Path) -> None:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=SOFTWARE)
        tab = browser.new_context(viewport=SIZE, offline=True).new_page()
        tab.goto(page.resolve().as_uri(), timeout=SOON)
        tab.wait_for_function("document.documentElement.dataset.space === 'ready'", timeout=SOON)
        tab.wait_for_timeout(2000)  # the picture in space is drawn once more
        below = tab.evaluate("document.getElementById('arm').getBoundingClientRect().bottom + window.scrollY")
        whole = {"x": 0, "y": 0, "width": SIZE["width"], "height": below + 24}
        tab.screenshot(path=picture, full_page=True, clip=whole)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
