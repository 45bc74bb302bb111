"""What symcal finds around it: fonts, temporary files, the terminal, the measured sets."""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

from symcal.doctor.finding import Finding


def figure_font_finding() -> Finding:
    """The font of the figures, which comes with matplotlib."""
    from matplotlib import font_manager

    from symcal.plots.style import FONT

    try:
        place = font_manager.findfont(FONT, fallback_to_default=False)
    except ValueError:
        do = "pip install --force-reinstall matplotlib"
        return Finding("font of figures", "note", f"{FONT} is missing: another one is taken", do)
    return Finding("font of figures", "ok", f"{FONT} ({place})")


def report_font_finding() -> Finding:
    """The fonts of the reports, which come with Typst: a line in each of them is set."""
    import typst

    templates = [part for part in files("symcal.report").joinpath("templates").iterdir() if part.name.endswith(".typ")]
    wanted = sorted({name for part in templates for name in _FONT.findall(part.read_text(encoding="utf-8"))})
    if not wanted:
        do = "pip install --force-reinstall symcal"
        return Finding("fonts of reports", "broken", "the templates of the reports are missing", do)
    try:
        _, warnings = typst.compile_with_warnings("".join(f'#text(font: "{name}")[a]' for name in wanted).encode())
    except typst.TypstError as error:
        do = "pip install --force-reinstall typst"
        return Finding("fonts of reports", "broken", f"typst makes no PDF: {error}", do)
    if warnings:
        do = "pip install --force-reinstall typst"
        return Finding("fonts of reports", "note", "; ".join(each.message for each in warnings), do)
    return Finding("fonts of reports", "ok", f"{', '.join(wanted)} (in typst)")


_FONT = re.compile(r'font: "([^"]+)"')


def temporary_finding() -> Finding:
    """The folder of temporary files, without which there is no report."""
    try:
        folder = tempfile.gettempdir()
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return Finding("temporary files", "broken", f"no folder for them: {error}", "set TMPDIR to a folder with room")
    small = free < _ROOM
    do = "make room there, or set TMPDIR to another folder" if small else ""
    return Finding("temporary files", "note" if small else "ok", f"{folder}, {free / 1e9:.1f} GB free", do)


_ROOM = 200_000_000  # bytes: what a report with images and its figures take, with much to spare


def terminal_finding() -> Finding:
    """Whether output goes to a terminal, in which colours and characters, and how options are completed."""
    from rich.console import Console

    system = sys.__stdout__ or sys.stdout  # not what stands in for it while something turns
    console, encoding = Console(file=system), system.encoding
    if console.is_terminal:
        colours = "no colours (NO_COLOR)" if console.no_color else f"colours {console.color_system or 'none'}"
        said = f"{console.width} columns, {colours}, {encoding}"
    else:
        said = f"output is piped: no colours, {encoding}"
    if encoding.lower().replace("-", "") != "utf8":
        return Finding("terminal", "note", f"{said}: some characters cannot be shown", "set PYTHONUTF8=1")
    return Finding("terminal", "ok", said, "complete commands with the tab key: symcal --install-completion")


def data_finding() -> Finding:
    """The folder of measured sets that `configs/real/` names."""
    named = os.environ.get("SYMCAL_DATA")
    if named is None:
        return Finding("measured sets", "ok", "SYMCAL_DATA is not set; only configs/real/ needs it")
    if Path(named).expanduser().is_dir():
        return Finding("measured sets", "ok", named)
    return Finding("measured sets", "note", f"SYMCAL_DATA={named} is no folder", "set it to the folder of the sets")
