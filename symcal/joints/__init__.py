"""Joint terms: what a joint adds to its reading before the chain begins; one file per kind."""

from symcal.joints.registry import TERMS as TERMS
from symcal.joints.term import Term as Term
from symcal.joints.term import TermParameter as TermParameter
