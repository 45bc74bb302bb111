"""What a calibration is worth on the controller: errors of the true robot with and without compensated commands.

Only a simulation knows the truth. A command q was computed with the nominal robot, so its tool was meant to be at
T_nominal(q). The true robot takes it to T_true(q); calibrated on paper alone it still does. With the readings q' that
the calibrated model asks for (`compensate`) it goes to T_true(q'), and what is then left is what the
identification does not know, and what joint limits keep away.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal import spatial
from symcal.calibration.evaluate import Errors
from symcal.compensation.compensate import Compensation, compensate
from symcal.compensation.targets import commanded, tool_pose
from symcal.kernels.batch import batch_function
from symcal.model.model import Model
from symcal.placing.registration import rigid_fit
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

POSES = 10_000
"""Random poses of the working area that a run judges by."""


@dataclass(frozen=True, slots=True, eq=False)
class Handover:
    """Errors of the true robot's tool against where it was meant to be, in the base frame, at N poses.

    compensation: the commands, before and after, with the status of each. wanted: where the nominal robot's tool would
        be, shape (N, 3), mm.
    before: with the commands of the nominal robot. A calibration that does not reach the commands leaves them as they
        are, so these are also the errors after a calibration without compensation. after: with compensated commands.
    aligned: the base was estimated too, and what the calibrated and the nominal robot call base is laid on the true one
        by the rigid motion that brings their tool positions at the same readings nearest to the true ones.
    """

    compensation: Compensation
    wanted: Array
    before: Errors
    after: Errors
    aligned: bool

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Where nothing but the identification leaves an error: shape (N,)."""
        return np.array([status == "reached" for status in self.compensation.status])

    @property
    def statuses(self) -> Mapping[str, int]:
        """How many poses ended in which status, the most frequent first."""
        return dict(Counter(self.compensation.status).most_common())

    @property
    def worse(self) -> NDArray[np.bool_]:
        """Poses at which the compensated command is farther off than the plain one: shape (N,)."""
        return self.after.size > self.before.size


def true_robot(model: Model, truth: Mapping[str, float]) -> Robot:
    """The simulated robot with its errors (mm, rad; by parameter name) carried out, base and tool included.

    Raises:
        KeyError: the model has no such parameter.
    """
    errors = model.parameters.mapping(model.parameters.vector(truth))
    links = {name: errors[name] for name in model.robot.parameters if name in errors}
    setup = model.setup.moved(errors, model.measurement.points_called)
    return replace(model.robot.nominal().corrected(links), base=setup.base, tool=setup.tool, record=None)


def hand_over(
    calibrated: Robot, truth: Robot, joints: Array, rng: np.random.Generator, *, aligned: bool = False
) -> Handover:
    """Send commands of the nominal robot to the true one, as they are and compensated with the calibrated model.

    Args:
        truth: the robot as it is (see `true_robot`). joints: commands, shape (N, dof), rad and mm.
        aligned: whether the base was estimated, so that the base frame is known up to a rigid motion only.
    Raises:
        InputError: commands outside the joint limits.
    """
    result = compensate(calibrated, commanded(calibrated, joints), rng)
    meant, modelled, plain, corrected = (
        batch_function(tool_pose(robot), evaluations=2 * len(q))(q)[0]
        for robot, q in (
            (calibrated.nominal(), result.nominal),
            (calibrated, result.nominal),
            (truth, result.nominal),
            (truth, result.joints),
        )
    )
    before, after = np.eye(4), np.eye(4)
    if aligned:
        before, after = (rigid_fit(plain[:, :3, 3], model[:, :3, 3]) for model in (meant, modelled))
    return Handover(
        compensation=result,
        wanted=meant[:, :3, 3],
        before=_errors(before @ plain, meant),
        after=_errors(after @ corrected, meant),
        aligned=aligned,
    )


def _errors(reached: Array, meant: Array) -> Errors:
    """Errors between poses (N, 4, 4): where the tool is less where it was meant to be."""
    count = np.arange(len(meant))
    turn = (spatial.inverse(meant) @ reached)[:, :3, :3]
    rotations = scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec()
    return Errors(reached[:, :3, 3] - meant[:, :3, 3], count, np.zeros_like(count), rotations)
