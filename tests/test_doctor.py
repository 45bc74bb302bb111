"""What `symcal doctor` finds: in an installation that is sound, and in some that are not."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from symcal.doctor import packages
from symcal.doctor.examine import examine, sound
from symcal.doctor.finding import Finding
from symcal.doctor.kernels import cache_finding, kernel_findings
from symcal.doctor.surroundings import report_font_finding, temporary_finding

REQUIRED = [text for text in distribution("symcal").requires or () if "extra ==" not in text]


@pytest.fixture(scope="module")
def findings() -> dict[str, Finding]:
    return {each.subject: each for each in examine()}


def test_everything_that_is_required_is_looked_at(findings: dict[str, Finding]) -> None:
    assert sound(list(findings.values()))
    for requirement in map(Requirement, REQUIRED):
        assert findings[requirement.name].state == "ok"
        assert findings[requirement.name].found.startswith(version(requirement.name))
    assert {f"extra {name}" for name in ("fast", "test", "cluster", "bench", "dev")} <= findings.keys()
    for subject in ("compiler", "kernels", "cache", "processor", "font of figures", "fonts of reports", "terminal"):
        assert subject in findings


def test_what_is_missing_says_what_to_do(findings: dict[str, Finding]) -> None:
    assert not [each for each in findings.values() if each.state != "ok" and not each.do]


def test_piped_it_is_a_line_each_without_colours(symcal: Callable[..., tuple[int, str, str]]) -> None:
    code, out, err = symcal("doctor")
    assert (code, err) == (0, "")
    assert "\x1b" not in out
    lines = out.splitlines()
    assert all(line.split()[0] in ("ok", "note") and ": " in line for line in lines)
    assert len(lines) > len(REQUIRED)


def test_a_package_that_is_too_old_or_missing_is_exit_code_one(
    symcal: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def old(name: str) -> str:
        if name == "rich":
            raise PackageNotFoundError(name)
        return "1.26.4" if name == "numpy" else version(name)

    monkeypatch.setattr(packages, "version", old)
    code, out, _ = symcal("doctor", "--json")
    said = json.loads(out)
    found = {each["subject"]: each for each in said["results"]["findings"]}
    assert (code, said["exit_code"], said["results"]["sound"]) == (1, 1, False)
    assert found["numpy"]["state"] == "broken"
    assert found["numpy"]["found"].startswith("1.26.4, needed >=")
    assert found["numpy"]["do"].startswith("pip install 'numpy>=")
    assert found["rich"]["state"] == "note"  # it is there, whoever brought it
    assert "compiler" not in found  # looked at only where everything loads


def test_a_package_that_does_not_load_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(name: str) -> None:
        if name == "casadi":
            raise OSError("libgfortran.so.5: cannot open shared object file\nand more")

    monkeypatch.setattr(packages.importlib, "import_module", load)
    found = {each.subject: each for each in packages.required_findings()}
    assert found["casadi"].state == "broken"
    assert found["casadi"].found.endswith("cannot be imported: libgfortran.so.5: cannot open shared object file")
    assert found["numpy"].state == "ok"


_COMPILER = """#!/bin/sh
if [ "$1" = --version ]; then echo "cc 1.0"; exit 0; fi
echo "kernel.c:1: math.h: No such file" >&2
exit 1
"""


def test_a_compiler_that_answers_and_does_not_compile_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "cc"
    program.write_text(_COMPILER)
    program.chmod(0o755)
    monkeypatch.setenv("CC", str(program))
    compiler, kernels = kernel_findings()
    assert compiler.state == "note"
    assert "cc 1.0 does not compile: " in compiler.found
    assert compiler.found.endswith("math.h: No such file")
    assert "\n" not in compiler.found
    assert kernels.found.startswith("numpy, since nothing compiles: about 15 times slower")
    monkeypatch.setenv("CC", "/bin/false")
    compiler, kernels = kernel_findings()
    assert compiler.found == "CC=/bin/false does not work"
    assert kernels.found == "numpy: about 15 times slower than C"


@pytest.mark.parametrize(
    ("choice", "state", "words"),
    [("numpy", "note", "numpy: about"), ("vm", "note", "virtual machine"), ("fortran", "broken", "unknown backend")],
)
def test_kernels_that_were_asked_for_are_named(
    choice: str, state: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SYMCAL_KERNELS", choice)
    _, kernels = kernel_findings()
    assert kernels.state == state
    assert words in kernels.found
    assert kernels.do == "unset SYMCAL_KERNELS"


def test_a_cache_counts_its_bytes_and_says_why_it_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "symcal" / "kernels"
    assert cache_finding().found == f"{folder}: 0 files, 0.0 MB, writable (rights 700)"
    (folder / "kernel.so").write_bytes(bytes(2_500_000))
    assert ": 1 files, 2.5 MB, " in cache_finding().found
    assert cache_finding().do == f"may be emptied at any time: rm -r '{folder}'"
    folder.chmod(0o777)
    found = cache_finding()
    assert (found.state, found.found.endswith(f"others can write in {folder}")) == ("note", True)
    assert "XDG_CACHE_HOME" in found.do


def test_fonts_of_reports_are_those_of_the_templates() -> None:
    assert report_font_finding().found == "DejaVu Sans Mono, Libertinus Serif (in typst)"


def test_no_folder_for_temporary_files_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr("tempfile.gettempdir", none)
    assert temporary_finding().state == "broken"
