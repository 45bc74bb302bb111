"""The handling robot as exported C, and that compiled for this machine."""

from __future__ import annotations

import numpy as np
import pytest
from c_robots import handling

from symcal.export.c import CExport, export_c
from symcal.export.c.check import CLibrary, build_library
from symcal.kernels.compiler import find_compiler
from symcal.robot.robot import Robot


@pytest.fixture(scope="session")
def paper_robot() -> Robot:
    """The paper's robot, calibrated: with the errors of its Table III."""
    return handling()


@pytest.fixture(scope="session")
def export(paper_robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> CExport:
    return export_c(paper_robot, tmp_path_factory.mktemp("export") / "handling")


@pytest.fixture(scope="session")
def libraries(
    export: CExport, paper_robot: Robot, tmp_path_factory: pytest.TempPathFactory
) -> tuple[CLibrary, CLibrary]:
    """In double and in float."""
    if find_compiler() is None:
        pytest.skip("no C compiler on this machine")
    folder = tmp_path_factory.mktemp("built")
    return build_library(export, paper_robot, folder, np.float64), build_library(
        export, paper_robot, folder, np.float32
    )
