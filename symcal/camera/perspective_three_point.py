"""The algebra of three known points seen along three known directions, for many views at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

_PAIRS = ((0, 1), (0, 2), (1, 2))
_COMMON_AND_DIFFERENCES = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 0.0, -2.0]])


def solve_bearings(bearings: Float, points: Float) -> tuple[Float, Bool]:
    r"""All poses of three points that are seen along three directions.

    The distances l_i from the camera's centre satisfy |l_i f_i - l_j f_j|^2 = |p_i - p_j|^2 for the three pairs: two
    homogeneous conics in (l_1, l_2, l_3) and a scale. A degenerate member of the conics' pencil (a root of a
    cubic) is a pair of lines; each meets the other conics in two points. Distances are written as their common part
    and two differences in units of the field of view, which keeps far targets as well conditioned as near ones.

    Args:
        bearings: unit vectors f_i in the camera frame, shape (n, 3, 3).
        points: p_i in the target frame, shape (3, 3), mm, not on one line.
    Returns:
        poses T_camera_target, shape (n, 4, 4, 4), to roughly single precision near double roots and almost double
        elsewhere; valid, shape (n, 4). Slots that are not valid hold some finite pose.
    Source: the pencil of conics after [Persson2018] (Lambda Twist); the coordinates and the homogeneous
        intersection are ours.
    """
    squares = np.array([np.sum((points[i] - points[j]) ** 2) for i, j in _PAIRS])
    forms, basis = _distance_forms(bearings)
    conics = np.stack([forms[:, k] * squares[2] - forms[:, 2] * squares[k] for k in (0, 1)], axis=1) / squares.max()
    lines, conic = _degenerate_member(conics)
    directions, real = _intersect(lines, conic)

    distances = np.einsum("nij,nkj->nki", basis, directions)
    distances *= np.where(distances.sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    scale = np.einsum("nki,nij,nkj->nk", directions, forms.sum(axis=1), directions)
    valid = real & (distances > 0).all(axis=-1) & (scale > 0)
    factor = np.sqrt(squares.sum() / np.where(valid, scale, 1.0)) / _field(bearings)[:, None]
    distances = np.where(valid[..., None], distances * factor[..., None], np.linalg.norm(np.ptp(points, axis=0)))
    return _rigid(points, distances[..., None] * bearings[:, None]), valid


def _field(bearings: Float) -> Float:
    """Root mean square chord between the directions, shape (n,)."""
    chords = np.stack([np.sum((bearings[:, i] - bearings[:, j]) ** 2, axis=-1) for i, j in _PAIRS])
    result: Float = np.sqrt(chords.mean(axis=0))
    return result


def _distance_forms(bearings: Float) -> tuple[Float, Float]:
    """Squared distances of the pairs as quadratic forms, (n, 3, 3, 3), in units of the field; basis (n, 3, 3).

    |l_i f_i - l_j f_j|^2 = (l_i - l_j)^2 + |f_i - f_j|^2 l_i l_j, without the cancellation of 1 - cos.
    """
    field = _field(bearings)
    basis = np.repeat(_COMMON_AND_DIFFERENCES[None], len(bearings), axis=0)
    basis[:, :, 1:] *= field[:, None, None]
    forms = []
    for i, j in _PAIRS:
        difference = _COMMON_AND_DIFFERENCES[i] - _COMMON_AND_DIFFERENCES[j]
        chord = np.sum((bearings[:, i] - bearings[:, j]) ** 2, axis=-1) / field**2
        product = basis[:, i, :, None] * basis[:, j, None, :]
        product = (product + product.swapaxes(-1, -2)) / 2
        forms.append(np.outer(difference, difference) + chord[:, None, None] * product)
    return np.stack(forms, axis=1), basis


def _degenerate_member(conics: Float) -> tuple[Float, Float]:
    """Spanning points of the two lines, (n, 2, 2, 3), of a degenerate conic of each pencil; another conic of it."""
    angles = np.arange(4) * np.pi / 4
    turn = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rotated = np.einsum("ak,nkij->naij", turn, conics)
    pick = np.abs(np.linalg.det(rotated)).argmax(axis=1)
    everyone = np.arange(len(conics))
    regular = rotated[everyone, pick]
    other = np.einsum("nk,nkij->nij", np.stack([-turn[pick, 1], turn[pick, 0]], axis=-1), conics)
    roots = np.linalg.eigvals(np.linalg.solve(regular, -other))
    members = other[:, None] + roots.real[..., None, None] * regular[:, None]
    values, vectors = np.linalg.eigh(members)
    size = np.abs(values).max(axis=-1)
    pair = np.minimum(-values[..., 0], values[..., 2]) - np.abs(values[..., 1])
    best = (pair / size - np.abs(roots.imag) / (1 + np.abs(roots))).argmax(axis=1)
    values, vectors = values[everyone, best], vectors[everyone, best]
    low = np.sqrt(np.maximum(-values[:, 0], 0))[:, None] * vectors[:, :, 2]
    high = np.sqrt(np.maximum(values[:, 2], 0))[:, None] * vectors[:, :, 0]
    second = np.stack([low + high, low - high], axis=1)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    vertex = np.broadcast_to(vectors[:, None, :, 1], second.shape)
    return np.stack([vertex, second], axis=2), regular


def _intersect(lines: Float, conic: Float) -> tuple[Float, Bool]:
    """Homogeneous intersections of two lines with a conic, (n, 4, 3), and whether they are real, (n, 4)."""
    form = np.einsum("nlai,nij,nlbj->nlab", lines, conic, lines)
    a, half, c = form[..., 0, 0], form[..., 0, 1], form[..., 1, 1]
    discriminant = half**2 - a * c
    size = np.maximum(half**2, np.abs(a * c))
    real = discriminant > -1e-7 * size
    q = -(half + np.copysign(np.sqrt(np.maximum(discriminant, 0)), half))
    weights = np.stack([np.stack([q, a], axis=-1), np.stack([c, q], axis=-1)], axis=2)
    found = np.einsum("nlsk,nlki->nlsi", weights, lines)
    length = np.linalg.norm(found, axis=-1, keepdims=True)
    real = np.repeat(real, 2, axis=-1) & (length[..., 0] > 0).reshape(len(conic), 4)
    return (found / np.where(length > 0, length, 1.0)).reshape(-1, 4, 3), real


def _rigid(points: Float, placed: Float) -> Float:
    """Poses that carry three points, (3, 3), to their places, (n, k, 3, 3), in the least-squares sense."""
    center, centers = points.mean(axis=0), placed.mean(axis=-2)
    correlation = np.einsum("nkai,aj->nkij", placed - centers[..., None, :], points - center)
    u, _, vt = np.linalg.svd(correlation)
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    poses = np.zeros((*centers.shape[:2], 4, 4))
    poses[..., :3, :3] = u @ vt
    poses[..., :3, 3] = centers - u @ vt @ center
    poses[..., 3, 3] = 1.0
    return poses
