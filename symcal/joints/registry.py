"""The kinds of joint terms by name."""

from __future__ import annotations

from symcal.joints.backlash import Backlash
from symcal.joints.compliance import Compliance
from symcal.joints.coupling import Coupling
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.joints.payload import PayloadTerm
from symcal.joints.ratio import Ratio
from symcal.joints.term import Term

TERMS: dict[str, type[Term]] = {
    kind.kind: kind for kind in (Ratio, Harmonics, Backlash, Coupling, Compliance, Gravity, PayloadTerm)
}
