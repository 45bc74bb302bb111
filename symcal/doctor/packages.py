"""Python, the packages that are required, with their bounds, and the optional ones by the extras that bring them."""

from __future__ import annotations

import importlib
import platform
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import TYPE_CHECKING

from symcal.doctor.finding import Finding

if TYPE_CHECKING:
    from packaging.requirements import Requirement

MODULES = {"opencv-python-headless": "cv2", "pyyaml": "yaml", "python-calamine": "python_calamine"}
"""What is imported, where it is called otherwise than its package."""

USES = {
    "fast": "a C compiler",
    "proof": "what leaves is read back by another program",
    "serial": "instruments at a serial port",
    "ros": "ROS 2 bags as measurements",
    "cluster": "studies on a Dask cluster, tables as Parquet",
    "bench": "other programs beside symcal in `symcal bench`",
    "test": "the tests",
    "docs": "the documentation",
    "dev": "lint and types",
}
"""What extras are for."""


def own_finding() -> Finding:
    """Which symcal this is, and where it lies."""
    place = Path(__file__).resolve().parents[1]
    try:
        return Finding("symcal", "ok", f"{version('symcal')} in {place}")
    except PackageNotFoundError:
        return Finding("symcal", "broken", f"not installed, only found in {place}", "pip install symcal")


def python_finding() -> Finding:
    """The interpreter, and whether it is one that symcal is made for."""
    from packaging.specifiers import SpecifierSet

    bounds = distribution("symcal").metadata["Requires-Python"] or ""
    found = f"{platform.python_implementation()} {platform.python_version()}"
    if SpecifierSet(bounds).contains(platform.python_version(), prereleases=True):
        return Finding("Python", "ok", found)
    return Finding("Python", "broken", f"{found}, needed {bounds}", f"install symcal with Python {bounds}")


def required_findings() -> list[Finding]:
    """Every package that is required: there, within its bounds, and importable."""
    return [_required(each) for each in _requirements() if _wanted(each, "")]


def extra_findings() -> list[Finding]:
    """Every extra: whether all of its packages are there."""
    return [_extra(name) for name in distribution("symcal").metadata.get_all("Provides-Extra") or ()]


def _requirements() -> list[Requirement]:
    from packaging.requirements import Requirement

    return [Requirement(text) for text in distribution("symcal").requires or ()]


def _wanted(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _needed(requirement: Requirement) -> str:
    return f"{requirement.name}{requirement.specifier}"


def _required(requirement: Requirement) -> Finding:
    name, found = requirement.name, _installed(requirement.name)
    command = f"pip install '{_needed(requirement)}'"
    try:
        importlib.import_module(MODULES.get(name, name))
    except ModuleNotFoundError as error:
        if found is None:
            return Finding(name, "broken", f"missing, needed {requirement.specifier}", command)
        return Finding(name, "broken", f"{found} cannot be imported: {error}", f"{command} --force-reinstall")
    except Exception as error:  # noqa: BLE001 - whatever a broken package raises is what was looked for
        first = next(iter(str(error).strip().splitlines()), type(error).__name__)
        return Finding(name, "broken", f"{found} cannot be imported: {first}", f"{command} --force-reinstall")
    if found is None:  # OpenCV has four packages of one module
        return Finding(name, "note", f"{MODULES.get(name, name)} comes from another package", command)
    if not requirement.specifier.contains(found, prereleases=True):
        return Finding(name, "broken", f"{found}, needed {requirement.specifier}", command)
    return Finding(name, "ok", f"{found} ({requirement.specifier})")


def _extra(extra: str) -> Finding:
    wanted = [each for each in _requirements() if _wanted(each, extra) and not _wanted(each, "")]
    found = {each.name: _installed(each.name) for each in wanted}
    lacking = [
        _needed(each) + ("" if there is None else f" (found {there})")
        for each in wanted
        if (there := found[each.name]) is None or not each.specifier.contains(there, prereleases=True)
    ]
    use = f"{USES[extra]}: " if extra in USES else ""
    if lacking:
        return Finding(f"extra {extra}", "note", f"{use}without {', '.join(lacking)}", f"pip install 'symcal[{extra}]'")
    return Finding(f"extra {extra}", "ok", use + ", ".join(f"{name} {there}" for name, there in found.items()))
