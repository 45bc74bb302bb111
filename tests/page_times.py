"""How soon pages are there in a browser without a network, and what they look like; no test, as the load counts.

    python tests/page_times.py PAGE.html... [--out FOLDER]

Prints for each page its bytes, when it was first painted, when the headline stood and the arm could be turned, what it
asked for and complained of, the processor time of its process (without that which draws), and the load of the machine
where it was late; leaves screenshots at 1400 and 400 px. Needs Playwright's client and a Chromium of the system.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from pathlib import Path
from typing import Any

SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
SOON = 60_000  # ms
WIDTHS = (1400, 400)
LIMITS = {"painted": 1.0, "headline": 1.0, "space": 8.0}
"""Seconds, in software GL on two cores that do nothing else."""

WATCH = """
const seen = () => {
  const now = performance.now();
  if (document.querySelector(".headline .of")?.getBoundingClientRect().height) window.headlineAt ??= now;
  if (document.documentElement.dataset.space === "ready") window.spaceAt ??= now;
  if (window.spaceAt === undefined) requestAnimationFrame(seen);
};
requestAnimationFrame(seen);
"""
"""Frame by frame, when the first words stand and when the arm is drawn; ms since the page was asked for."""


def timed(browser: Any, path: Path, width: int, folder: Path) -> dict[str, Any]:
    """What one page does in one window, with two screenshots of it."""
    context = browser.new_context(viewport={"width": width, "height": 1000}, offline=True)
    context.add_init_script(WATCH)
    page, said, asked = context.new_page(), [], []
    session = context.new_cdp_session(page)
    session.send("Performance.enable")
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.resolve().as_uri(), timeout=SOON)
    page.wait_for_function("window.spaceAt !== undefined || !document.getElementById('nospace')?.hidden", timeout=SOON)
    painted = page.evaluate("performance.getEntriesByName('first-contentful-paint').map((e) => e.startTime)")
    times = page.evaluate("[window.headlineAt, window.spaceAt]")
    metrics = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
    page.wait_for_timeout(500)
    name = f"{path.resolve().parent.name}_{path.stem}_{width}"
    page.screenshot(path=str(folder / f"{name}.png"))
    page.screenshot(path=str(folder / f"{name}_whole.png"), full_page=True)
    wide = page.evaluate("document.documentElement.scrollWidth")
    context.close()
    seconds = [None if ms is None else ms / 1000 for ms in (*painted[:1], *times)]
    return {
        "times": dict(zip(LIMITS, seconds, strict=True)),
        "said": said,
        "asked": asked,
        "wide": wide,
        "cpu": metrics.get("ProcessTime", 0.0),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path("page_times"))
    given = parser.parse_args()
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    given.out.mkdir(parents=True, exist_ok=True)
    bad = 0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=SOFTWARE)
        for path in given.pages:
            sys.stdout.write(f"{path}: {path.stat().st_size / 1e6:.2f} MB\n")
            for width in WIDTHS:
                found = timed(browser, path, width, given.out)
                late = [name for name, s in found["times"].items() if s is None or s > LIMITS[name]]
                words = ", ".join(
                    f"{name} {'never' if s is None else f'{s:.2f} s'}" for name, s in found["times"].items()
                )
                missed = f" (late: {', '.join(late)}; load {os.getloadavg()[0]:.1f})" if late else ""
                sys.stdout.write(
                    f"  {width} px: {words}{missed}; "
                    f"{found['cpu']:.1f} s of CPU in the page; "
                    f"{found['wide']} px wide; {len(found['asked'])} requests, {len(found['said'])} errors\n"
                )
                for each in [*found["said"], *found["asked"][1:]]:
                    sys.stdout.write(f"    {each[:200]}\n")
                bad += bool(late or found["said"] or found["asked"][1:])
        browser.close()
    return bad


if __name__ == "__main__":
    sys.exit(main())
