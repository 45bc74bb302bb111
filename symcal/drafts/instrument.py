"""The instruments that first files are written for: each a template, and what plan, simulation and table need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from string import Template

from symcal.data.saved_measurements import joint_columns, reading_columns
from symcal.drafts.posture import Facing
from symcal.errors import InputError
from symcal.instruments import KINDS
from symcal.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Draft:
    """What is written for an instrument; its experiment is `templates/<name>.yaml`.

    what: said to people who choose. kind: as experiments call it. poses: to plan. noise: one standard deviation by
    quantity, in mm, deg and px; none where the template says it of each entry. facing: where the tool points in the
    posture that the area is around. turn: how far joints may turn from it, deg. view: for a camera, how far instead in
    multiples of what one joint alone may turn before a board leaves the view.
    images: what is filled in are the joint readings of images. entries: those of `measurements` that share the table,
    told apart by its column `by`.
    """

    name: str
    what: str
    kind: str
    poses: int
    noise: Mapping[str, float] = field(default_factory=dict)
    facing: Facing = "down"
    turn: float = 60.0
    view: float | None = None
    images: bool = False
    by: str = ""
    entries: tuple[str, ...] = ()

    @property
    def template(self) -> Template:
        folder = files("symcal.drafts").joinpath("templates")
        return Template(folder.joinpath(f"{self.name}.yaml").read_text(encoding="utf-8"))

    @property
    def table(self) -> str:
        """Name of the file that measurements are filled in."""
        return "joints.csv" if self.images else "measurements.csv"

    def columns(self, robot: Robot) -> list[str]:
        """Those of `table`."""
        if self.images:
            return ["image", *joint_columns(robot)]
        return ["pose", *([self.by] if self.by else []), *joint_columns(robot), *reading_columns(KINDS[self.kind]())]


DRAFTS: Mapping[str, Draft] = {
    each.name: each
    for each in (
        Draft("tracker", "x, y, z of a point on the tool: laser tracker, motion capture", "position", 40,
              {"position": 0.05}),
        Draft("pose", "a camera in the hand that reports poses of a marker or board", "pose", 40,
              {"position": 0.5, "orientation": 0.1}, view=1.5),
        Draft("board", "a camera in the hand that looks at a printed board", "pixels", 40,
              {"image": 0.1}, view=2.0, images=True),
        Draft("fixed-camera", "a camera that stands still, and a printed board on the flange", "pixels", 40,
              {"image": 0.1}, facing="outward", view=2.0, images=True),
        Draft("wire", "a draw-wire or another meter of distances", "distance", 80, {"distance": 0.1}),
        Draft("gauge", "a gauge of one coordinate: height gauge, dial gauge, laser sensor", "component", 80,
              {"component": 0.02}),
        Draft("socket", "a ball on the tool, seated by hand in two sockets", "fixed_point", 60,
              turn=120.0, by="socket", entries=("left", "right")),
        Draft("plate", "a ball on the tool that touches three flat plates", "plane", 90,
              turn=120.0, by="plate", entries=("floor", "ramp", "side")),
    )
}  # fmt: skip


def draft_named(name: str) -> Draft:
    """The draft of this name, or the first one of a kind that experiments call so.

    Raises:
        InputError: there is none.
    """
    if name in DRAFTS:
        return DRAFTS[name]
    of_kind = [draft for draft in DRAFTS.values() if draft.kind == name]
    if not of_kind:
        raise InputError(
            "no first files are written for this instrument", key="--instrument", found=name, allowed=DRAFTS
        )
    return of_kind[0]
