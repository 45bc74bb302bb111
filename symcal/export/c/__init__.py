"""A robot as a folder of C for its controller: kinematics, Jacobian, compensation, and a test that they are right."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from symcal.compensation.compensate import joint_caps
from symcal.errors import InputError
from symcal.export.c.expressions import programs
from symcal.export.c.names import identifier
from symcal.export.c.project import cost, project_files
from symcal.export.c.source import CModel, header, model_hash, source
from symcal.export.c.vectors import self_test_vectors
from symcal.export.carries import LeftOut, check_carries
from symcal.export.gate import check_exportable
from symcal.outputs.manifest import foreign_files
from symcal.outputs.whole_file import write_whole
from symcal.outputs.whole_folder import whole_folder
from symcal.robot.robot import Robot

MANIFEST = "symcal_export.json"
SCHEMA = "symcal/c-export/1"
BUILD = "build"
"""Where the exported Makefile puts what it makes."""


@dataclass(frozen=True, slots=True)
class CExport:
    """An exported folder.

    prefix: of every name in C; the header is `<prefix>_kinematics.h`. files: paths inside the folder and their sizes
        in bytes.
    left_out: what of the robot's joint terms is not in the code; None: nothing.
    operations: of one call by public function, in total; libm: how many of them call the mathematical library.
    """

    folder: Path
    prefix: str
    model_hash: str
    files: Mapping[str, int]
    operations: Mapping[str, int]
    libm: Mapping[str, int]
    left_out: LeftOut | None = None


def export_c(
    robot: Robot,
    out_dir: Path | str,
    *,
    prefix: str | None = None,
    iterations: int | None = None,
    vectors: int = 24,
    force: bool = False,
) -> CExport:
    """Write a robot's kinematics as C99, ready to be dropped into a firmware.

    Poses are in the base frame, mm and rad. The folder appears whole or not at all; an earlier export in its place is
    replaced. The same robot gives the same text. Joint terms are inside, at nominal conditions (see
    `symcal.export.carries`).

    Args:
        robot: calibrated (or nominal: then both models are the same).
        out_dir: the folder to write.
        prefix: of all names, an identifier; by default made of the robot's name.
        iterations: Newton steps of a compensation; by default three, and six where large zero offsets widen the caps.
        vectors: how many test vectors.
        force: whether also a calibration that was refused or never judged (`symcal.export.gate`).
    Raises:
        InputError: the folder holds files that are not of an export, or cannot be written; the prefix is no identifier.
        RefusedError: the calibration was refused; the model has numbers that single precision cannot hold, or a smooth
            remainder.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> sc.export_c(robot, "c").prefix
        'handling_robot'
    """
    check_exportable(robot, force)
    left = check_carries(robot, "c")
    if prefix is not None and identifier(prefix, "robot") != prefix:
        message = (
            "the prefix must be lower-case letters, digits and single underscores, at most 24, starting with a letter"
        )
        raise InputError(message, key="prefix", found=prefix)
    if iterations is None:
        iterations = 3 if (joint_caps(robot) <= joint_caps(robot.nominal())).all() else 6
    if iterations < 1 or vectors < 1:
        raise InputError("there must be at least one iteration and one test vector", found=(iterations, vectors))
    model = CModel(robot, prefix or identifier(robot.name, "robot"), iterations, programs(robot), left)
    texts = {
        f"{model.prefix}_kinematics.h": header(model),
        f"{model.prefix}_kinematics.c": source(model),
        **project_files(model, self_test_vectors(robot, vectors)),
    }
    digest = model_hash(robot)
    manifest = {
        "schema": SCHEMA,
        "model_hash": digest,
        "prefix": model.prefix,
        "robot": robot.name,
        "calibrated": robot.record is not None,
        "parameters": list(model.parameters),
        "left_out": None if model.left_out is None else model.left_out.text,
        "files": {path: hashlib.sha256(text.encode()).hexdigest() for path, text in texts.items()},
    }
    texts[MANIFEST] = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
    folder = Path(out_dir)
    # a link to a folder is followed: what it points to is exchanged, and it stays a link
    with whole_folder(folder.resolve(), lambda place: _check_replaceable(place, folder)) as fresh:
        for path, text in texts.items():
            (fresh / path).parent.mkdir(parents=True, exist_ok=True)
            write_whole(fresh / path, text)
    costs = {name: cost(model, name) for name in model.functions}
    return CExport(
        folder=folder,
        prefix=model.prefix,
        model_hash=digest,
        files={path: len(text.encode()) for path, text in texts.items()},
        operations={name: total for name, (total, _) in costs.items()},
        libm={name: calls for name, (_, calls) in costs.items()},
        left_out=model.left_out,
    )


def _check_replaceable(folder: Path, shown: Path) -> None:
    """Refuse a folder with anything in it that is not of an earlier export, or was changed since."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError("there is a file of this name; a folder is to be written", file=shown)
    try:
        foreign = foreign_files(folder, MANIFEST, made_since=is_built)
    except OSError as error:
        raise InputError(f"the folder cannot be read: {error.strerror}", file=shown) from None
    if foreign:
        message = (
            "the folder holds files that are not of an export, or were changed since: choose another, or remove it "
            "yourself"
        )
        raise InputError(message, file=shown, found=foreign[0])


def is_built(path: str) -> bool:
    """Whether the exported Makefile makes this file, a path in the exported folder; it goes with the export that it was
    made from, and is nobody's own."""
    folder, _, name = path.partition("/")
    return folder == BUILD and "/" not in name and (name.endswith((".o", ".a")) or name.startswith("selftest."))
