"""JAX: one pose, `jit`, `vmap` and `jacrev` for the rest; double precision, on the processor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.bench.peers.elements import Elements
from symcal.bench.peers.fit_problem import FitProblem

Array = NDArray[np.float64]


def position_of(arm: Elements) -> Callable[[Any, Any], Any]:
    """(q, x) -> position of one posture, as JAX traces it: from the point back to the base, number by number.

    Stacks of 4x4 matrices, as NumPy likes them, are twenty times slower in JAX on a processor.
    """
    import jax.numpy as jnp

    def position(q: Any, x: Any) -> Any:
        p = list(arm.tool[:3, 3])
        for each in reversed(arm.motions):
            value = each.value
            if each.joint is not None:
                value = value + each.rate * q[each.joint]
            if each.parameter is not None:
                value = value + x[each.parameter]
            if not each.turn:
                p[each.axis] = p[each.axis] + value
                continue
            i, j = (each.axis + 1) % 3, (each.axis + 2) % 3
            c, s = jnp.cos(value), jnp.sin(value)
            p[i], p[j] = c * p[i] - s * p[j], s * p[i] + c * p[j]
        return jnp.stack([sum(row[k] * p[k] for k in range(3)) + row[3] for row in arm.base[:3]])

    return position


def positions_and_slopes(arm: Elements) -> Callable[[Array, Array], tuple[Any, Any]]:
    """(q, x) -> positions, shape (N, 3), and slopes, (N, 3, n), ready when the call returns; x is shared."""
    jax = double_precision()
    position = position_of(arm)

    def both(q: Any, x: Any) -> Any:
        return position(q, x), jax.jacrev(position, argnums=1)(q, x)  # three rows, more columns

    compiled = jax.jit(jax.vmap(both, in_axes=(0, None)))

    def run(q: Array, x: Array) -> tuple[Any, Any]:
        p, slopes = compiled(q, x)
        return p.block_until_ready(), slopes.block_until_ready()

    return run


def least_squares(arm: Elements, problem: FitProblem, steps: int, *, many: bool) -> Callable[[Array, Array], Array]:
    """(q, z) -> errors after so many Gauss-Newton steps by QR of the scaled rows, from zero.

    Args:
        steps: the same for all, since a loop that ends when the last has converged costs as much.
        many: z has shape (R, N, 3), and the errors (R, n); otherwise (N, 3) and (n,).
    """
    jax = double_precision()
    import jax.numpy as jnp

    position = position_of(arm)
    size = np.ones(problem.count) if problem.sizes is None else problem.sizes
    free = problem.free

    def fit(q: Any, z: Any) -> Any:
        def step(_: int, y: Any) -> Any:
            x = jnp.zeros(problem.count).at[free].set(size[free] * y)
            r = (jax.vmap(position, in_axes=(0, None))(q, x) - z).ravel() / problem.sigma
            slopes = jax.vmap(jax.jacrev(position, argnums=1), in_axes=(0, None))(q, x)
            wide = slopes.reshape(-1, problem.count)[:, free] * size[free] / problem.sigma
            if problem.sizes is not None:
                r, wide = jnp.concatenate([r, y]), jnp.concatenate([wide, jnp.eye(len(free))])
            orthogonal, upper = jnp.linalg.qr(wide)
            return y - jax.scipy.linalg.solve_triangular(upper, orthogonal.T @ r)

        y = jax.lax.fori_loop(0, steps, step, jnp.zeros(len(free)))
        return jnp.zeros(problem.count).at[free].set(size[free] * y)

    compiled = jax.jit(jax.vmap(fit, in_axes=(None, 0)) if many else fit)

    def run(q: Array, z: Array) -> Array:
        return np.asarray(compiled(q, z))

    return run


def double_precision() -> Any:
    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", "cpu")
    return jax
