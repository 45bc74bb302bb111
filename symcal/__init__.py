"""Kinematic calibration of serial robots, from the symbolic model to the controller.

The steps as plain functions on frozen objects:

    import symcal as sc

    robot = sc.load_robot("robot.yaml")
    data = sc.load_measurements("measurements.csv", robot, "position")
    calibration = sc.identify(robot, data, sc.Task.of("position", {"base", "tool"}))
    sc.save_robot(calibration.robot, "calibrated.yaml")

Inside the program lengths are mm and angles rad.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symcal.calibration.calibrate import Calibration as Calibration
    from symcal.calibration.compare import compare as compare
    from symcal.calibration.compare import cross_validate as cross_validate
    from symcal.calibration.evaluate import evaluate as evaluate
    from symcal.calibration.evaluate import statistics as statistics
    from symcal.calibration.identify import identify as identify
    from symcal.calibration.robot_difference import robot_difference as robot_difference
    from symcal.calibration.simulate import simulate as simulate
    from symcal.camera.board import Board as Board
    from symcal.camera.board import parse_board as parse_board
    from symcal.camera.files import read_camera as read_camera
    from symcal.camera.files import write_camera as write_camera
    from symcal.compensation.compensate import compensate as compensate
    from symcal.compensation.targets import commanded as commanded
    from symcal.compensation.targets import wanted as wanted
    from symcal.data.dataset import Dataset as Dataset
    from symcal.data.measurement_file import load_measurements as load_measurements
    from symcal.data.saved_measurements import save_measurements as save_measurements
    from symcal.errors import InputError as InputError
    from symcal.errors import RefusedError as RefusedError
    from symcal.errors import SymcalError as SymcalError
    from symcal.export import export_c as export_c
    from symcal.export import save_json as save_json
    from symcal.export import save_urdf as save_urdf
    from symcal.fit.options import Options as Options
    from symcal.instruments import Instrument as Instrument
    from symcal.instruments import Quantity as Quantity
    from symcal.instruments import register as register
    from symcal.instruments.noise import Noise as Noise
    from symcal.instruments.registry import Component as Component
    from symcal.instruments.registry import Direction as Direction
    from symcal.instruments.registry import Distance as Distance
    from symcal.instruments.registry import FixedPoint as FixedPoint
    from symcal.instruments.registry import Pixels as Pixels
    from symcal.instruments.registry import Plane as Plane
    from symcal.instruments.registry import Pose as Pose
    from symcal.instruments.registry import Position as Position
    from symcal.instruments.registry import Tracker as Tracker
    from symcal.model.model import build_model as build_model
    from symcal.model.observation import Observation as Observation
    from symcal.model.observation import Place as Place
    from symcal.model.observation import Target as Target
    from symcal.model.task import Task as Task
    from symcal.planning.information import pose_information as pose_information
    from symcal.planning.search import select_poses as select_poses
    from symcal.report import write_report as write_report
    from symcal.robot.conventions import convert as convert
    from symcal.robot.files import load_robot as load_robot
    from symcal.robot.files import save_robot as save_robot
    from symcal.robot.robot import (
        Joint as Joint,
    )
    from symcal.robot.robot import (
        Link as Link,
    )
    from symcal.robot.robot import (
        Robot as Robot,
    )
    from symcal.robot.urdf import load_urdf as load_urdf
    from symcal.runs.run import run as run
    from symcal.vision.board import detect_boards as detect_boards
    from symcal.vision.calibrate import calibrate_camera as calibrate_camera
    from symcal.vision.corners import load_corners as load_corners

_HOME = {
    "Board": "camera.board",
    "calibrate_camera": "vision.calibrate",
    "compensate": "compensation.compensate",
    "detect_boards": "vision.board",
    "load_corners": "vision.corners",
    "parse_board": "camera.board",
    "read_camera": "camera.files",
    "write_camera": "camera.files",
    "convert": "robot.conventions",
    "Dataset": "data.dataset",
    "InputError": "errors",
    "RefusedError": "errors",
    "SymcalError": "errors",
    "Options": "fit.options",
    "compare": "calibration.compare",
    "cross_validate": "calibration.compare",
    "evaluate": "calibration.evaluate",
    "statistics": "calibration.evaluate",
    "run": "runs.run",
    "export_c": "export",
    "save_json": "export",
    "save_urdf": "export",
    "Calibration": "calibration.calibrate",
    "identify": "calibration.identify",
    "robot_difference": "calibration.robot_difference",
    "load_measurements": "data.measurement_file",
    "save_measurements": "data.saved_measurements",
    "Task": "model.task",
    "build_model": "model.model",
    "Observation": "model.observation",
    "Place": "model.observation",
    "Target": "model.observation",
    "Instrument": "instruments",
    "Quantity": "instruments",
    "register": "instruments",
    "Component": "instruments.registry",
    "Direction": "instruments.registry",
    "FixedPoint": "instruments.registry",
    "Plane": "instruments.registry",
    "Distance": "instruments.registry",
    "Pixels": "instruments.registry",
    "Pose": "instruments.registry",
    "Position": "instruments.registry",
    "Tracker": "instruments.registry",
    "pose_information": "planning.information",
    "select_poses": "planning.search",
    "write_report": "report",
    "Joint": "robot.robot",
    "Link": "robot.robot",
    "Robot": "robot.robot",
    "load_robot": "robot.files",
    "save_robot": "robot.files",
    "Noise": "instruments.noise",
    "simulate": "calibration.simulate",
    "commanded": "compensation.targets",
    "wanted": "compensation.targets",
    "load_urdf": "robot.urdf",
}
"""Where each public name lives; modules are loaded when a name is first used, so that `import symcal` costs nothing."""

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'symcal' has no attribute {name!r}")
    return getattr(importlib.import_module(f"symcal.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
