"""Ways out of Python: files for controllers and other programs, all in the base frame unless asked otherwise."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symcal.export.c import export_c as export_c
    from symcal.export.carries import check_carries as check_carries
    from symcal.export.carries import left_out as left_out
    from symcal.export.corrections import corrections as corrections
    from symcal.export.export import FORMATS as FORMATS
    from symcal.export.export import Exported as Exported
    from symcal.export.export import export_robot as export_robot
    from symcal.export.gate import check_exportable as check_exportable
    from symcal.export.gate import doubts as doubts
    from symcal.export.json import robot_json as robot_json
    from symcal.export.json import save_json as save_json
    from symcal.export.urdf import save_urdf as save_urdf

_HOME = {
    "FORMATS": "export",
    "Exported": "export",
    "check_carries": "carries",
    "check_exportable": "gate",
    "corrections": "corrections",
    "doubts": "gate",
    "export_c": "c",
    "export_robot": "export",
    "left_out": "carries",
    "robot_json": "json",
    "save_json": "json",
    "save_urdf": "urdf",
}
"""Where each name lives; a module is loaded when a name is first used: who writes a table needs no C export."""

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'symcal.export' has no attribute {name!r}")
    return getattr(importlib.import_module(f"symcal.export.{_HOME[name]}"), name)
