"""The command that says what an installation lacks: doctor."""

from __future__ import annotations

import typer


def doctor() -> None:
    """Say what is installed, what works, what is missing, and what to do about it."""
    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.doctor.examine import examine, sound

    with terminal.spinner(False) as progress:
        progress("looking around")
        findings = examine()
    reply(lambda: {"sound": sound(findings), "findings": [each.facts() for each in findings]})
    terminal.print_findings(findings)
    if not sound(findings):
        raise typer.Exit(1)
