"""pinocchio: an arm in which every turn and shift is a joint, so that its Jacobian is by parameters too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symcal.bench.peers.elements import Elements

Array = NDArray[np.float64]


def positions_and_slopes(arm: Elements) -> Callable[[Array, Array], tuple[Array, Array]]:
    """(q, x) -> positions, shape (N, 3), and slopes, (N, 3, n): a loop over poses, as its users write it."""
    import pinocchio as pin

    joints = {
        (True, 0): pin.JointModelRX,
        (True, 1): pin.JointModelRY,
        (True, 2): pin.JointModelRZ,
        (False, 0): pin.JointModelPX,
        (False, 1): pin.JointModelPY,
        (False, 2): pin.JointModelPZ,
    }
    model, parent, placement = pin.Model(), 0, pin.SE3(arm.base)
    for k, each in enumerate(arm.motions):
        parent = model.addJoint(parent, joints[each.turn, each.axis](), placement, f"element_{k}")
        placement = pin.SE3.Identity()
    point = model.addFrame(pin.Frame("point", parent, pin.SE3(arm.tool), pin.FrameType.OP_FRAME))
    data = model.createData()
    values = np.array([each.value for each in arm.motions])
    rates, errors = np.zeros((len(arm.motions), arm.dof)), np.zeros((len(arm.motions), arm.count))
    for k, each in enumerate(arm.motions):
        if each.joint is not None:
            rates[k, each.joint] = each.rate
        if each.parameter is not None:
            errors[k, each.parameter] = 1.0
    columns = np.argmax(errors, axis=0)

    def run(q: Array, x: Array) -> tuple[Array, Array]:
        coordinates = values + q @ rates.T + errors @ x
        p, slopes = np.empty((len(q), 3)), np.empty((len(q), 3, arm.count))
        for k, own in enumerate(coordinates):
            pin.computeJointJacobians(model, data, own)
            p[k] = pin.updateFramePlacement(model, data, point).translation
            jacobian = pin.getFrameJacobian(model, data, point, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            slopes[k] = jacobian[:3, columns]
        return p, slopes

    return run
