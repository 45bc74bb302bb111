"""The C code of a run: the six lines of its report compile and do what they say, and doubts keep it back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_build import STRICT, needs_compiler, succeed

from symcal.compensation.compensate import REACHED, compensate
from symcal.compensation.targets import commanded
from symcal.export import delivery
from symcal.export.c import CExport
from symcal.export.c.check import check_c
from symcal.export.delivery import deliver_c, example
from symcal.export.results import code_facts
from symcal.report.handover import handover_text
from symcal.robot.robot import Robot

PROGRAM = """
{include}
#include <stdio.h>
static void command(const double *q);
static void command(const double *q) {{ for (int i = 0; i < {dof}; i++) printf("%.17g ", q[i]); }}
int main(void)
{{
{declarations}
  const double planned[{dof}] = {{{numbers}}};
  for (int i = 0; i < {dof}; i++) q[i] = planned[i];
{call}
  return 0;
}}
"""


@needs_compiler
def test_the_lines_of_the_report_compile_and_compensate(
    export: CExport, paper_robot: Robot, tmp_path: Path, rng: np.random.Generator
) -> None:
    lines = example(export.prefix)
    assert len(lines) == 6
    q = np.array([[0.4, 1000.0, 300.0, 1.2, -0.3]])
    values = {
        "include": lines[0],
        "dof": paper_robot.dof,
        "declarations": "\n".join(lines[1:3]),
        "numbers": ", ".join(repr(float(value)) for value in q[0]),
        "call": "\n".join(lines[3:]),
    }
    (tmp_path / "main.c").write_text(PROGRAM.format(**values))
    source = export.folder / f"{export.prefix}_kinematics.c"
    flags = ["-std=c99", "-O2", *STRICT.split(), f"-I{export.folder}"]
    succeed("cc", *flags, "main.c", source, "-lm", "-o", "main", cwd=tmp_path)
    printed = np.array(succeed(tmp_path / "main", cwd=tmp_path).split(), dtype=float)
    wanted = compensate(paper_robot, commanded(paper_robot, q), rng)
    assert wanted.status == ("reached",)
    np.testing.assert_allclose(printed, wanted.joints[0], atol=10 * REACHED)
    assert np.abs(printed - q[0]).max() > 1e-3


@needs_compiler
def test_a_delivery_is_written_and_compared(paper_robot: Robot, tmp_path: Path, rng: np.random.Generator) -> None:
    found = deliver_c(paper_robot, tmp_path / "c", rng)
    assert found.doubts == ()
    assert found.export is not None
    assert found.check is not None
    facts = code_facts(found)
    assert sum(facts["files_bytes"].values()) == sum(
        p.stat().st_size for p in (tmp_path / "c").rglob("*") if p.is_file()
    )
    assert facts["check"]["double_mm"] < 1e-12 * paper_robot.reach
    assert 0 < facts["check"]["float_mm"] < 5e-7 * paper_robot.reach
    text = handover_text({"controller": {"corrections": [], "doubts": [], "code": facts}})
    assert text is not None
    assert text["code"]["example"].splitlines() == facts["example"]
    assert "in double" in text["code"]["check"]
    assert next(row[2] for row in text["code"]["functions"]) == str(facts["operations"]["forward"]["total"])


def test_without_a_compiler_it_is_said(
    paper_robot: Robot, tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(delivery, "check_c", lambda *_: None)
    facts = code_facts(deliver_c(paper_robot, tmp_path / "c", rng))
    assert facts["written"]
    assert facts["check"] is None
    text = handover_text({"controller": {"corrections": [], "doubts": [], "code": facts}})
    assert text is not None
    assert "not compiled here" in text["code"]["check"]


def test_no_compiler_means_no_check(
    export: CExport, paper_robot: Robot, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("symcal.export.c.check.find_compiler", lambda: None)
    assert check_c(export, paper_robot, rng) is None


def test_doubts_keep_the_code_back(paper_robot: Robot, tmp_path: Path, rng: np.random.Generator) -> None:
    assert paper_robot.record is not None
    record = replace(paper_robot.record, errors={**paper_robot.record.errors, "theta_4": 0.5})
    found = deliver_c(replace(paper_robot, record=record), tmp_path / "c", rng)
    assert found.export is None
    assert [doubt.parameter for doubt in found.doubts] == ["theta_4"]
    assert not (tmp_path / "c").exists()
    assert code_facts(found)["doubts"]
