"""Drawings that the code makes: an arm with the frames of its links, and what each kind of instrument reads.

Written to `docs/_made/` at every build, so that a change of a convention or a kind shows.
"""

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sphinx.application import Sphinx

from symcal.instruments import KINDS
from symcal.kinematics.picture import frames_at
from symcal.robot.conventions import convert
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
POSTURE = (-50.0, -60.0, 75.0, -105.0, -90.0, 30.0)
X, Y, Z, INK, PALE, PAPER = "#b3262b", "#2f7d32", "#1f5fa8", "#333333", "#9a9a9a", "#ffffff"


def p(x: float, y: float) -> Array:
    return np.array([x, y])


def line(a: Array, b: Array, colour: str, width: float = 2.0, dash: str = "", end: str = "") -> str:
    more = (f' stroke-dasharray="{dash}"' if dash else "") + (f' marker-end="url(#{end})"' if end else "")
    return (
        f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" stroke="{colour}" '
        f'stroke-width="{width}" stroke-linecap="round"{more}/>'
    )


def text(at: Array, words: str, colour: str = INK, size: int = 13) -> str:
    return f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{colour}" font-size="{size}">{words}</text>'


def dot(at: Array, colour: str, radius: float = 4.0) -> str:
    return f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{colour}"/>'


def picture(width: int, height: int, title: str, parts: list[str]) -> str:
    heads = "".join(
        f'<marker id="{name}" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="{colour}"/></marker>'
        for name, colour in (("x", X), ("y", Y), ("z", Z), ("ink", INK))
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" font-family="sans-serif"><title>{title}</title><defs>{heads}</defs>'
        f'<rect width="{width}" height="{height}" fill="{PAPER}"/>{"".join(parts)}</svg>\n'
    )


def arm(robot: Robot, title: str) -> str:
    frames = frames_at(robot, np.radians(POSTURE))[: robot.dof + 1]
    # seen from the front right and above: rows are the picture's right and down
    turn, lift = np.radians(-35.0), np.radians(22.0)
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    away = np.array([-np.sin(turn), np.cos(turn), 0.0])
    down = away * np.sin(lift) * -1.0 - np.array([0.0, 0.0, np.cos(lift)])
    view = np.array([right, down])
    flat = frames[:, :3, 3] @ view.T
    scale = min(420 / np.ptp(flat[:, 0]), 300 / np.ptp(flat[:, 1]))
    low = flat.min(axis=0)
    height = int(np.ptp(flat[:, 1]) * scale + 120)

    def on_paper(point: Array) -> Array:
        return (view @ point - low) * scale + 60

    origins = [on_paper(frame[:3, 3]) for frame in frames]
    parts = [line(a, b, PALE, 7) for a, b in itertools.pairwise(origins)]
    taken: list[Array] = []
    for i, frame in enumerate(frames):
        at = on_paper(frame[:3, 3])
        for k, colour, end in ((0, X, "x"), (1, Y, "y"), (2, Z, "z")):
            parts.append(line(at, on_paper(frame[:3, 3] + 75 * frame[:3, k]), colour, 2.2, end=end))
        parts.append(dot(at, INK))
        label = at + p(9, 16)
        while any(np.linalg.norm(label - other) < 15 for other in taken):
            label = label + p(0, 15)
        taken.append(label)
        parts.append(text(label, "base" if i == 0 else str(i)))
    for k, (name, colour) in enumerate((("x", X), ("y", Y), ("z", Z))):
        parts.append(text(np.array([20.0 + 20 * k, 22.0]), name, colour))
    return picture(560, height, title, parts)


HAND = [line(p(20, 40), p(110, 40), PALE, 9), line(p(110, 40), p(150, 75), PALE, 9), text(p(24, 26), "the robot")]
TIP = p(150, 75)


def _position() -> list[str]:
    foot = p(330, 150)
    parts = [*HAND, dot(TIP, INK, 6), line(foot, TIP, INK, 1.5, "5 4"), text(p(160, 68), "reflector")]
    parts += [line(foot, foot + p(40, 0), X, 2, end="x"), line(foot, foot + p(0, -40), Z, 2, end="z")]
    return [*parts, text(p(255, 172), "tracker = world")]


def _pose() -> list[str]:
    parts = [*_position()[:-1], text(p(255, 172), "camera or tracker")]
    return [*parts, line(TIP, TIP + p(34, 14), X, 2, end="x"), line(TIP, TIP + p(-12, 34), Z, 2, end="z")]


def _pixels() -> list[str]:
    corners = [p(230 + 24 * i, 150 - 4 * i) for i in range(5)]
    parts = [*HAND, *(line(TIP, c, INK, 1, "3 3") for c in corners), *(dot(c, INK, 3) for c in corners)]
    return [*parts, text(p(163, 66), "camera"), text(p(225, 174), "printed board")]


def _distance() -> list[str]:
    return [
        *HAND,
        dot(TIP, INK, 5),
        line(TIP, p(330, 145), INK, 2),
        dot(p(330, 145), INK, 8),
        text(p(270, 172), "wire box"),
    ]


def _component() -> list[str]:
    gauge = p(150, 160)
    parts = [*HAND, dot(TIP, INK, 5), line(gauge, p(150, 90), Z, 2, end="z")]
    return [*parts, dot(gauge, INK, 8), text(p(168, 164), "dial gauge: one direction")]


def _direction() -> list[str]:
    return [*HAND, line(TIP, TIP + p(120, 50), Z, 2.5, end="z"), text(p(200, 84), "beam or spindle: z of the target")]


def _fixed_point() -> list[str]:
    cup = '<path d="M185 120 A 20 20 0 0 0 225 120" fill="none" stroke="#333333" stroke-width="3"/>'
    return [
        *HAND,
        line(TIP, p(205, 118), PALE, 5),
        dot(p(205, 122), INK, 12),
        cup,
        text(p(235, 140), "ball in a socket"),
    ]


def _plane() -> list[str]:
    parts = [*HAND, line(TIP, p(205, 118), PALE, 5), dot(p(205, 122), INK, 12), line(p(120, 136), p(360, 136), INK, 3)]
    return [*parts, line(p(320, 134), p(320, 90), Z, 2, end="z"), text(p(120, 160), "flat plate, z out of it")]


SKETCHES = {
    "position": _position,
    "pose": _pose,
    "pixels": _pixels,
    "distance": _distance,
    "component": _component,
    "direction": _direction,
    "fixed_point": _fixed_point,
    "plane": _plane,
}


def draw(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "_made"
    folder.mkdir(exist_ok=True)
    standard = load_robot(ROOT / "configs" / "robots" / "ur5.yaml")
    made = {
        "frames_standard": arm(standard, "Link frames of a UR5, standard convention"),
        "frames_craig": arm(convert(standard, "craig"), "Link frames of a UR5, Craig's convention"),
    }
    for kind in KINDS:
        made[kind] = picture(430, 190, f"What {kind} reads", SKETCHES[kind]())
    for name, svg in made.items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True}
