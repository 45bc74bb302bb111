"""Templates and data to HTML: whatever comes from files is text there, in markup and in script alike."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from symcal.page.vendored import PLOTLY, plotly, plotly_licence

_ENDS = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}
"""Characters of JSON texts that could end a script or a line of it, as escapes that mean the same."""


def render(kind: str, given: Mapping[str, Any]) -> str:
    """The page of a kind (`identification`, ...) from what it shows."""
    code = {"plotly": Markup(plotly()), "plotly_facts": PLOTLY, "plotly_licence": plotly_licence()}
    return _environment().get_template(f"{kind}.html").render({**given, **code})


def as_json(data: Any) -> Markup:
    """Data inside a script element."""
    return Markup(json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=False).translate(_ENDS))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("symcal.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["as_json"] = as_json
    return environment
