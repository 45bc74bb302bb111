"""The `symcal` command: each step works alone on files; results go to files, a short table to the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    help="Kinematic calibration of serial robots: plan, measure, identify, validate, compensate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Experiment = Annotated[Path, typer.Argument(metavar="EXPERIMENT.yaml", help="experiment file")]
Calibrated = Annotated[Path, typer.Argument(metavar="CALIBRATED.yaml", help="calibrated robot")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="the run's folder [reports/<name>]")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="instead of the file's seed")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="replace a value of the file")]
Images = Annotated[list[Path], typer.Argument(metavar="IMAGES...", help="image files, or folders of them")]
NoReport = Annotated[bool, typer.Option("--no-report", help="numbers and tables only: no figures, no PDF, no page")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress and no table")]


def with_outputs(overrides: list[str] | None, no_report: bool) -> list[str]:
    """What is set on the command line; without a report also its keys of the file."""
    return [
        *(overrides or ()),
        *(("outputs.figures=false", "outputs.report=false", "outputs.html=false") if no_report else ()),
    ]


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"symcal {version('symcal')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and exit", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    pass
