"""The whole examination, in an order in which the first thing that is broken explains the rest."""

from __future__ import annotations

from collections.abc import Sequence

from symcal.doctor.finding import Finding


def examine() -> list[Finding]:
    """Everything there is to say about this installation; where a package is broken, only what needs none."""
    from symcal.doctor.packages import extra_findings, own_finding, python_finding, required_findings

    own = own_finding()
    if own.state == "broken":  # nobody knows then what is required
        return [own]
    try:
        found = [own, python_finding(), *required_findings()]
    except ModuleNotFoundError as error:  # of what reads requirements
        return [own, Finding(str(error.name), "broken", "missing", f"pip install {error.name}")]
    if any(each.state == "broken" for each in found):
        return [*found, *extra_findings()]
    from symcal.doctor.kernels import cache_finding, kernel_findings, processor_finding
    from symcal.doctor.surroundings import (
        data_finding,
        figure_font_finding,
        report_font_finding,
        temporary_finding,
        terminal_finding,
    )

    return [
        *found,
        *kernel_findings(),
        cache_finding(),
        processor_finding(),
        figure_font_finding(),
        report_font_finding(),
        temporary_finding(),
        terminal_finding(),
        data_finding(),
        *extra_findings(),
    ]


def sound(findings: Sequence[Finding]) -> bool:
    """Whether everything that is required works."""
    return all(each.state != "broken" for each in findings)
