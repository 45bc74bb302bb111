"""What no training pose tells of, settled on the held-out poses: places of sessions that were held out, wires that read
nothing in training."""

from __future__ import annotations

from dataclasses import dataclass

from symcal.data.dataset import Dataset
from symcal.model.model import State
from symcal.parameters import Parameter
from symcal.placing.placement import placed_by, settled


@dataclass(frozen=True, slots=True)
class HeldOutPlaces:
    """A state with everything in it that the data tell of.

    state: the robot as it was identified, what it had unplaced fitted to the held-out poses. settled, unknown: names of
    the parameters that were, and of those that nothing tells.
    """

    state: State
    settled: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()

    @property
    def numbers(self) -> dict[str, tuple[float, Parameter]]:
        """Numbers of instruments that were settled, by name: value, and what it is."""
        parameters, own = self.state.model.parameters, self.state.setup.own
        return {name: (own[name], parameters.items[parameters.index(name)]) for name in self.settled if name in own}


def held_out_places(state: State, held_out: Dataset | None) -> HeldOutPlaces:
    """What a state has unplaced, fitted to the held-out poses as they judge it; None or no pose: nothing tells it."""
    if not state.unplaced or held_out is None or len(held_out) == 0:
        return HeldOutPlaces(state, (), state.unplaced)
    told = set(placed_by(state.model, held_out))
    found = tuple(name for name in state.unplaced if name in told)
    unknown = tuple(name for name in state.unplaced if name not in told)
    return HeldOutPlaces(settled(state, held_out), found, unknown)
