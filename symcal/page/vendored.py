"""Code of others that stands in the page: plotly.js, the bundle for pictures in space, as its makers publish it."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

_FOLDER = files("symcal.page").joinpath("vendor", "plotly")

PLOTLY = {
    "package": "plotly.js-gl3d-dist-min",
    "version": "4.1.1",
    "sha256": "aab04dcd9c103a92b18723f8c837712fe820f325d0bcd2421e415e8124a75b9f",
    "licence": "MIT",
    "from": "https://registry.npmjs.org/plotly.js-gl3d-dist-min/-/plotly.js-gl3d-dist-min-4.1.1.tgz",
}


@cache
def plotly() -> str:
    """The bundle, byte for byte; its licence is beside it."""
    return _FOLDER.joinpath("plotly-gl3d.min.js").read_text(encoding="utf-8")


def plotly_licence() -> str:
    return _FOLDER.joinpath("LICENSE").read_text(encoding="utf-8")
