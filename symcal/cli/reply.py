"""`--json`: one object on standard output; everything that is said to people goes to standard error meanwhile."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from symcal.errors import InputError, SymcalError

SCHEMA = "symcal/reply/1"
OPTION = "--json"

Json = Annotated[bool, typer.Option(OPTION, help="print one JSON object; words go to standard error")]

_UsageError: type[Exception] = typer.BadParameter.__bases__[0]  # the parent of them all, of which typer shows no name
_results: ContextVar[list[Mapping[str, Any]] | None] = ContextVar("results", default=None)


def reply(results: Callable[[], Any], *written: Path) -> None:
    """Keep what a command found, and the files and folders that it wrote, for its JSON; where none is asked for,
    nothing is done. What is said here is there even if the command then refuses.
    """
    kept = _results.get()
    if kept is not None:
        kept.append({"written": [str(place) for place in written], "results": results()})


def json_asked(arguments: list[str]) -> bool:
    """Whether a command line asks for JSON; who asks for help gets help."""
    options = arguments[: arguments.index("--")] if "--" in arguments else arguments
    return OPTION in options and "--help" not in options


class WithJson:
    """A command that knows the option `--json`, which `answer` has already obeyed.

    Its signature is made when typer asks for it: it asks for that of the called command alone.
    """

    def __init__(self, command: Callable[..., None]) -> None:
        self._command = command
        self.__name__, self.__doc__, self.__module__ = command.__name__, command.__doc__, command.__module__

    def __call__(self, *args: Any, json: bool = False, **options: Any) -> None:  # noqa: ARG002
        self._command(*args, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        own = inspect.signature(self._command, eval_str=True)
        option = inspect.Parameter("json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Json)
        return own.replace(parameters=[*own.parameters.values(), option])

    @property
    def __annotations__(self) -> dict[str, Any]:  # type: ignore[override]
        return {each.name: each.annotation for each in self.__signature__.parameters.values()}


def answer(app: typer.Typer, command: str | None, say: Callable[[SymcalError], None]) -> NoReturn:
    """Run a command, print its reply (`schema`, `command`, `exit_code`, `written`, `results`, `error`) and exit.

    Args:
        command: what was called. say: tells people of an error.
    """
    error: dict[str, Any] | None = None
    kept: list[Mapping[str, Any]] = []
    _results.set(kept)
    try:
        with redirect_stdout(sys.stderr):
            ended = app(standalone_mode=False)
        code = ended if isinstance(ended, int) else 0
        if code and not kept:  # what it found says why
            error = {"message": f"ended with exit code {code}"}
    except SymcalError as refused:
        say(refused)
        code, error = 1, error_facts(refused)
    except _UsageError as usage:
        usage.show()  # type: ignore[attr-defined]
        code, error = usage.exit_code, {"message": usage.format_message()}  # type: ignore[attr-defined]
    except typer.Abort:
        code, error = 1, {"message": "aborted"}
    finally:
        _results.set(None)
    found = kept[-1] if kept else {"written": [], "results": None}
    said = {"schema": SCHEMA, "command": command, "exit_code": code, **found, "error": error}
    typer.echo(json.dumps(said, indent=2, ensure_ascii=False, allow_nan=False, default=str))
    sys.exit(code)


def error_facts(error: SymcalError) -> dict[str, Any]:
    """An error by its parts; `message` alone for those that are not about a place in a file."""
    if not isinstance(error, InputError):
        return {"message": str(error)}
    return {
        "message": error.message,
        "file": None if error.file is None else str(error.file),
        "line": error.line,
        "part": error.part,
        "key": error.key,
        "column": error.column,
        "found": error.found,
        "allowed": list(error.allowed),
    }
