r"""How the rate of false alarms is shared among the tests of a check.

Equal shares alpha / m waste most of alpha on joints whose wanted offset is found in any case. The joints whose wanted
offset is found at an equal share at least half of the time pool theirs, and half of those of all other tests, so that
these offsets are found with the same power, each keeping a tenth. The shares add up to alpha and follow from the poses
alone, not from what was read there, so that alpha holds as for equal ones ([Spjotvoll1972]).
"""

from __future__ import annotations

from collections.abc import Mapping

import scipy

from symcal.watch.directed import Law

_ABLE = 0.5  # power at an equal share
_KEPT = 0.1  # of an equal share, by a joint that pools
_GIVEN = 0.5  # of an equal share, that all other tests have
_SURE = 1 - 1e-9


def shares(alpha: float, tests: int, wanted: Mapping[str, float], dof: float) -> tuple[dict[str, float], float]:
    """Levels of the tests of joints by name, and that of each other test.

    Args:
        wanted: lambda of every joint's wanted offset, a test of one direction.
    """
    equal = alpha / tests
    able = {name: size for name, size in wanted.items() if Law(dof, equal).power(1, size) >= _ABLE}
    if not able:
        return dict.fromkeys(wanted, equal), equal
    other = _GIVEN * equal
    total = alpha - (tests - len(able)) * other

    def levels(power: float) -> dict[str, float]:
        return {name: max(Law.reaching(dof, size, power), _KEPT * equal) for name, size in able.items()}

    def excess(power: float) -> float:
        return sum(levels(power).values()) - total

    power = _SURE if excess(_SURE) <= 0 else float(scipy.optimize.brentq(excess, _ABLE - 1e-6, _SURE, xtol=1e-5))
    found = levels(power)
    scale = total / sum(found.values())
    return {name: scale * found[name] if name in found else other for name in wanted}, other
