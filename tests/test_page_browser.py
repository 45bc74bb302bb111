"""report.html in a browser without a network: numbers at once, the arm soon, and what one touches is what it says.

Needs Playwright's client and a Chromium of the system; no browser is downloaded.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identifications import content_of, simulated
from quick_plans import ABOVE_A_TABLE, quick_plan

from symcal.page import Gallery, Identified, Thumbnail, write_page
from symcal.page.plan import PlanShown, write_plan_page
from symcal.runs.plan import PlanOutcome
from symcal.vision.images import thumbnail

sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright, which steers a browser, is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
    # of Playwright's own event loop, when a test fails
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]

SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
SOON = 60_000  # ms; on a machine that does nothing else it takes a few seconds

AT = """(place) => {
  const scene = document.getElementById("space")._fullLayout.scene._scene, camera = scene.glplot.cameraParams;
  const times = (m, v) => [0, 1, 2, 3].map((r) => m[r] * v[0] + m[4 + r] * v[1] + m[8 + r] * v[2] + m[12 + r] * v[3]);
  const point = place.map((value, k) => value * scene.dataScale[k]);
  const seen = times(camera.projection, times(camera.view, times(camera.model, [...point, 1])));
  const box = scene.container.getBoundingClientRect();
  return [box.left + (seen[0] / seen[3] / 2 + 0.5) * box.width, box.top + (0.5 - seen[1] / seen[3] / 2) * box.height];
}"""
"""Where on the screen a place in space is, by the camera of the picture."""


@pytest.fixture(scope="module")
def case(configs: Path) -> Any:
    return simulated(configs, "pose", 12, 6)


@pytest.fixture(scope="module")
def content(case: Any) -> dict[str, Any]:
    return content_of(*case)


@pytest.fixture(scope="module")
def path(case: Any, content: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With an image of the first pose."""
    file = tmp_path_factory.mktemp("page") / "report.html"
    images = Gallery((Thumbnail(case[1].labels[0], "", thumbnail(np.zeros((480, 640), np.uint8))),), 1)
    write_page(Identified(content, *case, images=images), file)
    return file


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def plan(configs: Path) -> PlanOutcome:
    return quick_plan(configs / "plan_position.yaml", *ABOVE_A_TABLE)


@pytest.fixture(scope="module")
def plan_path(plan: PlanOutcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plan") / "report.html"
    write_plan_page(PlanShown(plan.content, plan.findings, plan.experiment.model), file)
    return file


def opened(browser: Any, path: Path) -> tuple[Any, list[str], list[str]]:
    """A page whose arm is drawn, what it complained of, and what it asked for."""
    context = browser.new_context(viewport={"width": 1400, "height": 1000}, offline=True)
    page, said, asked = context.new_page(), [], []
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri(), timeout=SOON)
    page.wait_for_function("document.documentElement.dataset.space === 'ready'", timeout=SOON)
    return page, said, asked


def click(page: Any, place: list[float], label: str) -> bool:
    """Click on a place in space until the pose of that name is shown; whether it is."""
    x, y = page.evaluate(AT, place)
    for _ in range(5):  # a button that goes up before the picture was drawn again is not seen
        page.mouse.move(x + 4, y)
        page.wait_for_timeout(300)
        page.mouse.move(x, y)
        page.wait_for_timeout(700)
        page.mouse.down()
        page.wait_for_timeout(500)
        page.mouse.up()
        page.wait_for_timeout(500)
        if page.inner_text("#detail h3") == f"pose {label}":
            return True
    return False


def test_a_page_is_touched(browser: Any, path: Path, case: Any, content: dict[str, Any]) -> None:
    page, said, asked = opened(browser, path)
    (painted,) = page.evaluate("performance.getEntriesByName('first-contentful-paint').map((e) => e.startTime)")
    assert painted < page.evaluate("performance.now()")

    errors, data = case[2]["test"]["after"], case[1].part("test")
    label, largest = data.labels[int(errors.pose[errors.size.argmax()])], errors.size.max()
    assert content["accuracy"]["test"]["after"]["position_mm"]["worst"]["pose"] == label
    assert page.inner_text("#detail h3") == f"pose {label}"  # the worst one, before anything is chosen
    page.evaluate("document.getElementById('arm').scrollIntoView({behavior: 'instant'})")
    page.click("#detail .step button:last-child")
    assert page.inner_text("#detail h3") != f"pose {label}"
    assert click(page, page.evaluate("data.marks.at[data.worst]"), label)
    row = page.inner_text("#points tr.chosen").split("\t")
    assert row[0].strip() == label
    assert float(row[4]) == pytest.approx(largest, abs=1e-3)

    start = page.evaluate("document.getElementById('space').data[4].x.slice(0, 2)")
    page.fill("#exaggerate", "90")
    end = page.evaluate("document.getElementById('space').data[4].x.slice(0, 2)")
    assert start[0] == end[0]
    assert abs(end[1] - end[0]) > 2 * abs(start[1] - start[0])

    page.fill("#search", "held-out")
    assert page.inner_text("#count") == f"{len(data)} of {len(case[1])} rows"
    head = "#points th:nth-child(5) button"
    page.click(head)
    page.click(head)
    assert page.inner_text("#points tbody tr:not([hidden]) td") == label
    page.press("#search", "Enter")
    for by in ("after", "before", "split", "held"):
        page.select_option("#colour", by)
    page.check("#show-area")
    page.check("#show-arms")
    page.click("#images a")
    assert page.inner_text("#detail h3") == f"pose {case[1].labels[0]}"
    assert page.evaluate("document.querySelector('#detail img').naturalWidth") == 320
    assert said == []
    assert asked == [path.as_uri()]
    page.context.close()


def test_a_plan_is_driven(browser: Any, plan_path: Path, plan: PlanOutcome) -> None:
    planned, arm = plan.findings.planned, plan.findings.problem.arm
    tool = arm.motion(planned.plan.poses)[0]
    page, said, asked = opened(browser, plan_path)

    def end() -> Any:
        """Where the drawn arm ends."""
        return page.evaluate("['x', 'y', 'z'].map((k) => document.getElementById('space').data[1][k].at(-1))")

    page.evaluate("document.getElementById('tour').scrollIntoView({behavior: 'instant'})")
    assert end() == pytest.approx(arm.motion(planned.start[None])[0][0], abs=0.51)
    page.press("#forth", "Enter")
    page.press("#forth", "Enter")
    assert page.inner_text("#detail h3") == f"pose {planned.names[1]}"
    assert end() == pytest.approx(tool[1], abs=0.51)
    page.press("#at", "End")
    assert end() == pytest.approx(tool[-1], abs=0.51)
    page.select_option("#speed", "0.25")  # it is not at its end before one has looked
    page.click("#play")  # from the start again
    page.wait_for_function("Number(document.getElementById('at').value) > 3", timeout=SOON)
    assert page.get_attribute("#play", "aria-pressed") == "true"
    page.click("#play")
    frame = int(page.input_value("#at"))
    assert end() == page.evaluate("(i) => data.tour.nodes[i].at(-1)", frame)

    apart = np.linalg.norm(tool[:, None] - tool, axis=-1) + np.diag(np.full(len(tool), np.inf))
    lone = np.argsort(-apart.min(axis=1))[:4].tolist()  # a plan may repeat poses, and lines may hide one
    page.click("#back")
    far = next(i for i in lone if click(page, tool[i].tolist(), planned.names[i]))
    assert page.inner_text("#points tr.chosen").split("\t")[0].strip() == planned.names[far]
    assert end() == pytest.approx(tool[far], abs=0.51)

    straight = planned.motion.kinds.count("line")
    page.fill("#search", "straight")
    assert page.inner_text("#count") == f"{straight} of {len(tool)} rows"
    page.fill("#search", "")
    for _ in range(2):
        page.click("#points th:nth-child(2) button")
    best = page.evaluate("data.best")
    assert page.inner_text("#points tbody td") == planned.names[best]
    page.click("#points tbody td")
    assert page.inner_text("#detail h3") == f"pose {planned.names[best]}"
    for by in ("foretold", "order", "worth"):
        page.select_option("#colour", by)
    page.check("#show-arms")
    page.uncheck("#show-around")
    assert said == []
    assert asked == [plan_path.as_uri()]
    page.context.close()


@pytest.mark.parametrize("script", [True, False])
@pytest.mark.parametrize(("kind", "slider"), [("path", "#exaggerate"), ("plan_path", "#at")])
def test_a_narrow_page_fits(browser: Any, request: pytest.FixtureRequest, kind: str, slider: str, script: bool) -> None:
    """400 px, with script and without: numbers are there, and nothing but tables is wider."""
    context = browser.new_context(viewport={"width": 400, "height": 800}, offline=True, java_script_enabled=script)
    page = context.new_page()
    page.goto(request.getfixturevalue(kind).as_uri(), timeout=SOON)
    assert page.is_visible("#headline")
    assert page.is_visible("#points")
    assert page.is_visible("noscript") != script or script
    assert page.is_visible(slider) == script
    if script:
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
    context.close()
