"""What objects show in a notebook: true numbers with units, well-formed, and names that cannot be markup."""

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import symcal as sc
from symcal.notebook import MOST, html_table


class _Reader(HTMLParser):
    """Cells and other text of a table; fails where tags do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
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


def test_long_tables_are_cut_and_say_so() -> None:
    texts = _Reader(html_table("t", ["n"], [[str(i)] for i in range(MOST + 7)])).texts
    assert texts[-1] == "and 7 more rows"
    assert str(MOST) not in texts
