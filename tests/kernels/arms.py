"""Little arms as CasADi expressions: what the kernels are for, without the rest of the program."""

from __future__ import annotations

import casadi as ca


def handling_arm() -> ca.Function:
    """The five-joint arm of the paper: (q[5], x[15]) -> (p[3], J[3, 15]); standard convention, mm and rad."""
    q, x = ca.SX.sym("q", 5), ca.SX.sym("x", 15)
    theta = [q[0] + x[0], 0, 0, q[3] + x[1], q[4] + x[2]]
    d = [0, q[1] + x[3], q[2] + x[4], 300 + x[5], 25 + x[6]]
    a = [0, 0, 0, x[7], x[8]]
    alpha = [x[9], -ca.pi / 2 + x[10], x[11], -ca.pi / 2 + x[12], 0]
    beta = [x[13], 0, x[14], 0, 0]
    p = ca.SX.zeros(3)
    for i in reversed(range(5)):
        p = rz(theta[i]) @ (rx(alpha[i]) @ (ry(beta[i]) @ p) + ca.vertcat(a[i], 0, d[i]))
    return ca.Function("handling", [q, x], ca.cse([p, ca.densify(ca.jacobian(p, x))]), ["q", "x"], ["p", "J"])


def seven_joint_arm() -> ca.Function:
    """Seven revolute joints: (q[7], x[40]) -> (h[6], J[6, 40]); h is six coordinates of three tool points."""
    q, x = ca.SX.sym("q", 7), ca.SX.sym("x", 40)
    twist = [-ca.pi / 2, ca.pi / 2, ca.pi / 2, -ca.pi / 2, -ca.pi / 2, ca.pi / 2, 0]
    offset = [333.0, 0.0, 316.0, 0.0, 384.0, 0.0, 107.0]
    points = [x[35:38], x[35:38] + ca.vertcat(100, 0, 0), x[35:38] + ca.vertcat(0, 100, 0)]
    for i in reversed(range(7)):
        theta, d, a, alpha, beta = (
            q[i] + x[5 * i],
            offset[i] + x[5 * i + 1],
            x[5 * i + 2],
            twist[i] + x[5 * i + 3],
            x[5 * i + 4],
        )
        points = [rz(theta) @ (rx(alpha) @ (ry(beta) @ p) + ca.vertcat(a, 0, d)) for p in points]
    points = [rx(x[38]) @ (ry(x[39]) @ p) for p in points]
    h = ca.vertcat(points[0], points[1][:2], points[2][:1])
    return ca.Function("seven", [q, x], ca.cse([h, ca.densify(ca.jacobian(h, x))]), ["q", "x"], ["h", "J"])


def rx(angle: ca.SX) -> ca.SX:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(1, 0, 0), ca.horzcat(0, c, -s), ca.horzcat(0, s, c))


def ry(angle: ca.SX) -> ca.SX:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, 0, s), ca.horzcat(0, 1, 0), ca.horzcat(-s, 0, c))


def rz(angle: ca.SX) -> ca.SX:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
