"""What objects show in a notebook: true numbers with units, well-formed, names that cannot be markup, and drawings that
need no script and put things where they are."""

from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

import symcal as sc
from symcal.colors import BLUE, GREEN, INK, ORANGE, VERMILION
from symcal.data.dataset import readings
from symcal.notebook import Dots, Panel, html_table, sketch
from symcal.notebook.table import MOST

SVG = "{http://www.w3.org/2000/svg}"
DRAWN = {"svg", "title", "g", "rect", "circle", "path", "polyline", "text"}


class _Reader(HTMLParser):
    """Cells and other text of a table; fails where tags do not match, or ask for anything."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        html, mark, drawing = html.partition("<svg")
        self.drawing = ElementTree.fromstring(mark + drawing) if mark else None
        self.texts: list[str] = []
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs) -> None:
        assert not attrs
        self.open.append(tag)
        self.tags.add(tag)

    def handle_endtag(self, tag) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data) -> None:
        self.texts.append(data)


@pytest.fixture(scope="module")
def arm(configs):
    return sc.load_robot(configs / "robots" / "handling_robot.yaml")


@pytest.fixture(scope="module")
def measured(arm):
    rng = np.random.default_rng(1)
    model = sc.build_model(arm, sc.Task.of("position"))
    q = rng.uniform(arm.lower, arm.upper, (30, arm.dof))
    return sc.simulate(model, {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)


def _marks(drawing, color: str) -> np.ndarray:
    """Where discs and rings of a colour are, px."""
    own = [each for each in drawing.iter(f"{SVG}circle") if color in (each.get("fill"), each.get("stroke"))]
    return np.array([[float(each.get("cx")), float(each.get("cy"))] for each in own])


def test_a_robot_shows_its_links_in_deg_and_mm(arm) -> None:
    texts = _Reader(arm._repr_html_()).texts
    assert "handling-robot: standard convention, nominal" in texts
    assert {"alpha deg", "d mm", "850 to 1350 mm", "-165 to 165 deg", "300"} <= set(texts)


def test_names_are_text_and_never_markup(arm) -> None:
    bad = "<script>alert(1)</script>&"
    links = (replace(arm.links[0], joint=replace(arm.links[0].joint, name=bad)), *arm.links[1:])
    seen = _Reader(replace(arm, name=bad, links=links)._repr_html_())
    assert seen.tags == {"table", "caption", "tr", "th", "td"}
    assert bad in seen.texts
    assert {each.tag.removeprefix(SVG) for each in seen.drawing.iter()} <= DRAWN
    assert bad in seen.drawing.find(f"{SVG}title").text


def test_data_show_what_was_read_how_often(measured) -> None:
    holed = replace(measured, z=np.where(np.arange(30)[:, None] < 3, np.nan, measured.z))
    texts = _Reader(holed._repr_html_()).texts
    assert "30 poses (30 train)" in texts
    assert {"x mm, y mm, z mm", "27"} <= set(texts)


def test_a_calibration_shows_errors_with_their_units(arm, measured) -> None:
    calibration = sc.identify(arm, measured, sc.Task.of("position"))
    texts = _Reader(calibration._repr_html_()).texts
    assert "handling-robot: 11 of 15 directions seen" in texts
    row = texts[texts.index("theta_1") :][:5]
    assert float(row[1].replace("\N{MINUS SIGN}", "-")) == pytest.approx(1e3 * calibration.after.x[0], rel=5e-3)
    assert row[3] == "mrad"


def test_a_plan_shows_what_it_promises(arm) -> None:
    model = sc.build_model(arm, sc.Task.of("position"))
    info = sc.pose_information(model.measurement, model.setup, {"position": 0.05})
    plan = sc.select_poses(info, 15, np.random.default_rng(1), method="random", random=0)
    texts = _Reader(plan._repr_html_()).texts
    assert "Plan of 15 poses: random, criterion D" in texts
    shown = float(texts[texts.index("expected error, rms over the region") + 1])
    assert shown == pytest.approx(plan.prediction.mean_pose_rms_mm, rel=5e-3)


def test_joints_and_tool_of_a_drawn_arm_are_where_they_are() -> None:
    """Two links of 300 and 200 mm that lie along x: joints and tool on one level, at 0, 300 and 500 mm."""
    links = [sc.Link(sc.Joint("revolute", "a", -1, 1), {"theta": 0, "a": 300.0})]
    links.append(sc.Link(sc.Joint("revolute", "b", -2, 2), {"theta": 0, "a": 200.0}))
    drawing = _Reader(sc.Robot("planar", "standard", tuple(links))._repr_html_()).drawing
    for view in drawing.findall(f"{SVG}g"):
        joints, tool = _marks(view, INK), _marks(view, VERMILION)
        x = [*joints[:, 0], tool[0, 0]]
        assert (x[1] - x[0]) / (x[2] - x[0]) == pytest.approx(0.6, abs=2e-3)
        assert np.ptp([*joints[:, 1], tool[0, 1]]) == 0


def test_drawn_errors_are_in_the_order_of_the_errors(arm, measured) -> None:
    calibration = sc.identify(arm, measured, sc.Task.of("position"))
    drawing = _Reader(calibration._repr_html_()).drawing
    (panel,) = drawing.findall(f"{SVG}g")
    for color, state in ((ORANGE, "before"), (BLUE, "after")):
        size = sc.evaluate(calibration.states[state], measured).size
        high = -_marks(panel, color)[:, 1]
        assert (np.diff(high[np.argsort(size)]) >= 0).all()
        assert np.ptp(high) > 10


def test_drawn_data_tell_training_from_held_out_by_shape(measured) -> None:
    split = tuple("test" if i % 3 == 0 else "train" for i in range(30))
    drawing = _Reader(replace(measured, split=split)._repr_html_()).drawing
    for view in drawing.findall(f"{SVG}g"):
        assert len(_marks(view, GREEN)) == 20
        assert len([each for each in view.iter(f"{SVG}rect") if each.get("fill") == VERMILION]) == 10


def test_what_is_odd_is_shown_without_a_drawing_or_in_part(arm, measured) -> None:
    calibration = sc.identify(arm, measured, sc.Task.of("position"))
    assert _Reader(replace(arm, links=())._repr_html_()).drawing is None
    assert _Reader(measured.take(range(0))._repr_html_()).drawing is None
    assert _Reader(replace(measured, z=np.full_like(measured.z, np.nan))._repr_html_()).drawing is None
    assert _Reader(replace(calibration, train=None)._repr_html_()).drawing is None
    unread = replace(measured, z=np.full_like(measured.z, np.nan))
    assert _Reader(replace(calibration, train=unread)._repr_html_()).drawing is None
    adrift = replace(arm, links=(replace(arm.links[0], parameters={"theta": np.nan}), *arm.links[1:]))
    assert _Reader(adrift._repr_html_()).drawing is not None  # what is left of it
    one = Panel("t", "x", "y", (Dots(np.array([[1.0, 0.0], [1.0, -3.0]]), "#000000"),))
    assert sketch("one value on each axis", [one])
    assert not sketch("no logarithm of it", [replace(one, log=True)])


@pytest.mark.parametrize("kind", ["position", "pose", "distance", "component", "direction", "fixed_point"])
def test_every_kind_of_data_is_shown(kind) -> None:
    of = readings(kind, () if kind == "pose" else ("P",))
    rng, width = np.random.default_rng(1), of[0].width
    data = sc.Dataset(of, rng.normal(size=(5, 5)), rng.normal(size=(5, width)), tuple("abcde"), ("train",) * 5)
    assert (_Reader(data._repr_html_()).drawing is None) == (kind == "fixed_point")  # of which nothing is read


def test_long_tables_are_cut_and_say_so() -> None:
    texts = _Reader(html_table("t", ["n"], [[str(i)] for i in range(MOST + 7)])).texts
    assert texts[-1] == "and 7 more rows"
    assert str(MOST) not in texts
