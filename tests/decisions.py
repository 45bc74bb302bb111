"""Decisions that robots of tests carry, where what they are tested for begins after the decision."""

from __future__ import annotations

from symcal.calibration.decision import Decision

ACCEPTED = {"decision": Decision(None, (), "made for a test").facts}
"""Provenance of a calibrated robot that was accepted."""
