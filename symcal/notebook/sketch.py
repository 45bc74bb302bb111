"""Small drawings as SVG: panels with dots and paths, written in milliseconds and without matplotlib.

What is not finite is left out, and a panel of nothing is not drawn: whatever is shown, a notebook goes on.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.colors import INK, RULE
from symcal.words import MINUS

Array = NDArray[np.float64]
Shape = Literal["disc", "ring", "square"]

_WIDTH, _HEIGHT = 300.0, 210.0  # of a panel, px
_LEFT, _RIGHT, _TOP, _BOTTOM = 56.0, 12.0, 26.0, 38.0
_LEGEND = 18.0
_PAPER = "#ffffff"  # notebooks may be dark
_STEPS = (1.0, 2.0, 5.0, 10.0)
_TICKS = 4  # of an axis, about


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """Marks at points, shape (k, 2). shape: of each, so that colours are not needed to tell them apart."""

    points: Array
    color: str
    shape: Shape = "disc"
    label: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A line through points, shape (k, 2)."""

    points: Array
    color: str
    width: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """What is drawn over two axes, and their words.

    equal: a mm is as long on both; then at least ``span`` of it is shown. log: of y. rows: names of y = 0, 1, ... from
    the top, instead of numbers.
    """

    title: str
    x: str
    y: str
    items: tuple[Dots | Path, ...]
    equal: bool = False
    span: float = 0.0
    log: bool = False
    rows: tuple[str, ...] = ()


def sketch(words: str, panels: Sequence[Panel]) -> str:
    """Panels side by side as one SVG element; empty where there is nothing to draw.

    Args:
        words: what it shows, for those who do not see it.
    """
    drawn = [each for each in map(_Axes.of, panels) if each is not None]
    if not drawn:
        return ""
    labels = {i.label: i for each in drawn for i in each.panel.items if isinstance(i, Dots) and i.label}
    width, height = _WIDTH * len(drawn), _HEIGHT + (_LEGEND if labels else 0.0)
    body = [f'<g transform="translate({k * _WIDTH:g} 0)">{each.drawn()}</g>' for k, each in enumerate(drawn)]
    at = _LEFT
    for name, dots in labels.items():
        body += [_mark(dots, at, _HEIGHT + 4), _text(at + 8, _HEIGHT + 8, name, "start")]
        at += 24 + 6.2 * len(name)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" style="max-width:100%;height:auto" role="img" font-family="sans-serif" font-size="11">'
        f'<title>{escape(words)}</title><rect width="{width:g}" height="{height:g}" fill="{_PAPER}"/>'
        f"{''.join(body)}</svg>"
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Axes:
    """A panel with the ranges of its axes, in the numbers that are drawn (logarithms where y is logarithmic)."""

    panel: Panel
    low: Array
    high: Array

    @staticmethod
    def of(panel: Panel) -> _Axes | None:
        points = np.concatenate([_finite(panel, item) for item in panel.items] or [np.empty((0, 2))])
        if not len(points):
            return None
        low, high = points.min(axis=0), points.max(axis=0)
        if panel.rows:
            low[1], high[1] = -0.8, len(panel.rows) - 0.8
        size = np.maximum(high - low, 1e-9 * np.maximum(np.abs(low), 1.0))
        if panel.equal:
            room = np.array([_WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM])
            size = max(*(size / room), panel.span / max(room)) * room
        middle, half = (low + high) / 2, 0.54 * size
        return _Axes(panel, middle - half, middle + half)

    def at(self, points: Array) -> Array:
        """Where points are on the panel, px."""
        share = (points - self.low) / (self.high - self.low)
        share[:, 1] = share[:, 1] if self.panel.rows else 1 - share[:, 1]
        room = np.array([_WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM])
        return np.asarray(np.array([_LEFT, _TOP]) + share * room)

    def drawn(self) -> str:
        panel = self.panel
        right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
        parts = [_text(_LEFT, 15, panel.title, "start")]
        for value, words in _ticks(self.low[0], self.high[0]):
            x = self.at(np.array([[value, self.low[1]]]))[0, 0]
            parts += [_rule(x, _TOP, x, bottom), _text(x, bottom + 13, words)]
        marks = [(float(i), name) for i, name in enumerate(panel.rows)]
        for value, words in marks or _ticks(self.low[1], self.high[1], log=panel.log):
            y = self.at(np.array([[self.low[0], value]]))[0, 1]
            parts += [_rule(_LEFT, y, right, y), _text(_LEFT - 5, y + 4, words, "end")]
        parts.append(_text((_LEFT + right) / 2, bottom + 28, panel.x))
        if panel.y:
            parts.append(_text(right, 15, panel.y, "end"))
        for item in panel.items:
            at = self.at(_finite(panel, item))
            if isinstance(item, Dots):
                parts += [_mark(item, x, y) for x, y in at]
            elif len(at):
                line = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
                style = f'stroke="{item.color}" stroke-width="{item.width:g}" stroke-linejoin="round"'
                parts.append(f'<polyline points="{line}" fill="none" {style}/>')
        return "".join(parts)


def _finite(panel: Panel, item: Dots | Path) -> Array:
    points = np.asarray(item.points, dtype=np.float64).reshape(-1, 2)
    if panel.log:
        points = np.column_stack([points[:, 0], np.log10(np.where(points[:, 1] > 0, points[:, 1], np.nan))])
    return np.asarray(points[np.isfinite(points).all(axis=1)])


def _ticks(low: float, high: float, *, log: bool = False) -> list[tuple[float, str]]:
    """Where an axis has its numbers, and these."""
    if log:
        powers = range(math.floor(low), math.ceil(high) + 1)
        wide = high - low > 2
        values = [10.0**p * m for p, m in itertools.product(powers, (1,) if wide else (1, 2, 5))]
        return [(math.log10(v), f"{v:g}") for v in values if low <= math.log10(v) <= high]
    raw = (high - low) / _TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = power * next(s for s in _STEPS if s * power >= raw * (1 - 1e-9))
    first, last = math.ceil(low / step), math.floor(high / step)
    return [(k * step, f"{k * step:.6g}".replace("-", MINUS)) for k in range(first, last + 1)]


def _mark(dots: Dots, x: float, y: float) -> str:
    if dots.shape == "square":
        return f'<rect x="{x - 2.5:.1f}" y="{y - 2.5:.1f}" width="5" height="5" fill="{dots.color}"/>'
    paint = f'fill="none" stroke="{dots.color}"' if dots.shape == "ring" else f'fill="{dots.color}"'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" {paint}/>'


def _rule(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{RULE}" stroke-width="0.6"/>'


def _text(x: float, y: float, words: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{INK}" text-anchor="{anchor}">{escape(words)}</text>'
