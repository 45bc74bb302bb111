"""Exported C under strict compilers and build systems, its symbols, and the folder that it is written to."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from c_build import COMPILERS, STRICT, needs_make, self_test, succeed
from c_robots import arm

from symcal.errors import InputError
from symcal.export.c import CExport, export_c
from symcal.kernels.compiler import find_compiler
from symcal.robot.robot import Robot

# ------------------------------------------------------------------------------------------ compilers and build systems


@needs_make
@pytest.mark.parametrize("compiler", COMPILERS)
def test_strict_compilers_and_self_test(export: CExport, compiler: str, tmp_path: Path) -> None:
    folder = shutil.copytree(export.folder, tmp_path / "copy with a space")
    output = self_test(folder, compiler)
    assert output.count("self-test passed") == 2
    assert "FAILED" not in output


@needs_make
@pytest.mark.parametrize(("name", "compiler"), [("franka_fr3", "gcc"), ("tiago", "clang")])
def test_other_arms_with_pose_compensation(name: str, compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} on this machine")
    output = self_test(export_c(arm(name), tmp_path / name).folder, compiler, "-O1")
    assert output.count("pose compensation") == 2


@pytest.mark.skipif(shutil.which("cmake") is None or find_compiler() is None, reason="no cmake or compiler here")
def test_cmake_and_ctest(export: CExport, tmp_path: Path) -> None:
    succeed("cmake", "-S", export.folder, "-B", tmp_path, f"-DCMAKE_C_FLAGS={STRICT}", cwd=tmp_path)
    succeed("cmake", "--build", tmp_path, cwd=tmp_path)
    assert "100% tests passed, 0 tests failed out of 2" in succeed("ctest", "--test-dir", tmp_path, cwd=tmp_path)


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++ on this machine")
def test_the_header_is_cpp_too(export: CExport, tmp_path: Path) -> None:
    text = f'#include "{export.prefix}_kinematics.h"\nint main() {{ return {export.prefix.upper()}_DOF - 5; }}\n'
    (tmp_path / "main.cpp").write_text(text)
    succeed("g++", *STRICT.split(), f"-I{export.folder}", "-c", "main.cpp", cwd=tmp_path)


@needs_make
def test_the_self_test_notices_a_wrong_number(export: CExport, tmp_path: Path) -> None:
    folder = shutil.copytree(export.folder, tmp_path / "wrong")
    source = folder / f"{export.prefix}_kinematics.c"
    text = source.read_text()
    assert "real_c(299.9583)" in text
    source.write_text(text.replace("real_c(299.9583)", "real_c(299.96)"))
    done = subprocess.run(["make", "test"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "calibrated pose (mm)" in done.stdout
    assert "self-test FAILED" in done.stdout


@pytest.mark.skipif(shutil.which("nm") is None or find_compiler() is None, reason="no nm or compiler on this machine")
def test_symbols(export: CExport, tmp_path: Path) -> None:
    """Nothing but libm is called, nothing but constants is stored, and the float build calls no double function."""
    source = export.folder / f"{export.prefix}_kinematics.c"
    for define, libm, end in (("-DSYMCAL_FLOAT", {"sinf", "cosf", "sincosf", "sqrtf"}, "_f"), ("-DX", None, "")):
        succeed("cc", "-std=c99", "-O2", define, "-c", source, "-o", "k.o", cwd=tmp_path)
        rows = [line.split() for line in succeed("nm", "k.o", cwd=tmp_path).splitlines()]
        undefined = {row[-1] for row in rows if row[-2] == "U"} - {"_GLOBAL_OFFSET_TABLE_"}
        assert undefined <= (libm or {"sin", "cos", "sincos", "sqrt"})
        assert {row[-2] for row in rows} <= {"U", "T", "t", "R", "r"}
        public = {row[-1] for row in rows if row[-2] == "T"}
        assert public == {f"{export.prefix}_{name}{end}" for name in export.operations}


def test_no_double_instruction_in_the_float_build(export: CExport, tmp_path: Path) -> None:
    if find_compiler() is None or shutil.which("objdump") is None:
        pytest.skip("no compiler or objdump on this machine")
    source = export.folder / f"{export.prefix}_kinematics.c"
    succeed("cc", "-std=c99", "-O2", "-DSYMCAL_FLOAT", "-c", source, "-o", "k.o", cwd=tmp_path)
    text = succeed("objdump", "-d", "k.o", cwd=tmp_path)
    if "mulss" not in text:
        pytest.skip("not an x86-64 machine: the names of its instructions are others")
    assert not re.findall(r"\b(?:add|sub|mul|div|sqrt)sd\b|\bcvts[sd]2s[sd]\b", text)


# ----------------------------------------------------------------------------------------------------------- the folder


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_the_same_robot_gives_the_same_text(export: CExport, paper_robot: Robot, tmp_path: Path) -> None:
    again = export_c(paper_robot, tmp_path / "c")
    assert contents(again.folder) == contents(export.folder)
    assert again.files == {path: len(data) for path, data in contents(again.folder).items()}
    assert export_c(paper_robot.nominal(), tmp_path / "n").model_hash != again.model_hash


def test_an_earlier_export_is_replaced_whole(paper_robot: Robot, tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "c"
    export_c(paper_robot, folder, prefix="first")
    (folder / "build").mkdir()
    (folder / "build" / "first.o").write_text("old")
    export = export_c(paper_robot, folder, prefix="second")
    assert set(contents(folder)) == set(export.files)
    assert [p.name for p in folder.parent.iterdir()] == ["c"]


def test_files_of_others_are_left_alone(paper_robot: Robot, tmp_path: Path) -> None:
    folder = tmp_path / "c"
    export_c(paper_robot, folder)
    (folder / "main.c").write_text("mine")
    before = contents(folder)
    with pytest.raises(InputError, match="not of an export") as caught:
        export_c(paper_robot, folder)
    assert caught.value.found == "main.c"
    assert contents(folder) == before
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="there is a file"):
        export_c(paper_robot, tmp_path / "file")


def test_a_failure_leaves_what_was_there(paper_robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "c"
    export_c(paper_robot, folder)
    before, write = contents(folder), os.write

    def full_disk(descriptor: int, data: bytes) -> int:
        if b"self-test" in bytes(data):
            raise OSError(28, "No space left on device")
        return write(descriptor, data)

    monkeypatch.setattr(os, "write", full_disk)
    with pytest.raises(InputError, match="No space left"):
        export_c(paper_robot, folder, prefix="other")
    monkeypatch.undo()
    assert contents(folder) == before
    assert [p.name for p in tmp_path.iterdir()] == ["c"]


def test_an_exported_file_that_the_user_changed_is_kept(paper_robot: Robot, tmp_path: Path) -> None:
    folder = tmp_path / "c"
    export_c(paper_robot, folder)
    for name, text in (("Makefile", "mine"), ("build/notes.txt", "mine")):
        before = (folder / name).read_bytes() if (folder / name).exists() else None
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
        with pytest.raises(InputError, match="or were changed since") as caught:
            export_c(paper_robot, folder)
        assert caught.value.found == name
        assert (folder / name).read_text() == text
        (folder / name).unlink() if before is None else (folder / name).write_bytes(before)
    export_c(paper_robot, folder)


def test_a_link_to_a_folder_stays_one(paper_robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("there")
    for _ in range(2):
        export_c(paper_robot, tmp_path / "link")
        assert (tmp_path / "link").is_symlink()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "there"]
