"""What the section `study` of an experiment file may say: the paper's two simulations on four plans, and repetitions.

Robot, measurement, working area, initial pose, true errors, noise and test poses are those of the experiment. Numbers
here are still in the file's units.
"""

from typing import Annotated, Literal, Self

from pydantic import Field

from symcal.camera.files import Intrinsics, Triangle
from symcal.config.counts import MOST, Count
from symcal.documents.document import Strict
from symcal.robot.schema import Frame

_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]
_Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


class SceneConfig(Strict):
    """The vision set-up of the paper's Fig. 3: a camera on a tripod, a triangle of discs on the tool.

    position, look_at: of the camera in world. mount: the target in the tool frame, its discs face along z.
    margin_px, incidence: within which a pose counts as visible.
    """

    width: Count
    height: Count
    intrinsics: Intrinsics
    position: _Triple
    look_at: _Triple
    triangle: Triangle
    disc_radius: _Positive
    mount: Frame = Frame.model_construct()
    margin_px: _NotNegative = 0.0
    incidence: _Positive


class WeightsConfig(Strict):
    """c1, c2 and c3 of the fitness: per unit of observability, per rad and per px^2 (negative: large is good)."""

    observability: _NotNegative = 1.0
    angle: _NotNegative = 0.0
    area: float = 0.0


class ReadingConfig(Strict):
    """What the paper's fitness is taken to mean; see `symcal.planning.fitness.Reading`."""

    conditioning: Literal["per_pose", "stacked"] = "stacked"
    rows: Literal["image", "projection", "position"] = "image"
    point: Literal["target", "tool"] = "target"
    over: Literal["sum", "mean"] = "mean"


class SearchConfig(Strict):
    """The genetic algorithm of both plans that it makes; side_generations: of the other readings' plans."""

    population: Annotated[int, Field(ge=4, le=MOST)] = 200
    generations: Annotated[int, Field(ge=1, le=MOST)] = 200
    side_generations: Annotated[int, Field(ge=1, le=MOST)] = 80
    bits: Annotated[int, Field(ge=1, le=52)] = 8
    coding: Literal["binary", "gray", "real"] = "binary"


class SimulationOneConfig(Strict):
    """Exact positions. start: of every error, in rad and mm; damping: lambda of the first step, D = I.

    iterations, position_error: where the solver stops, the latter the mean over the poses in mm. draws: random plans
    on which it is repeated.
    """

    plan: Literal["paper_ga", "ga", "certified", "random"] = "paper_ga"
    start: float = 0.01
    damping: _Positive = 1.0
    factor: Annotated[float, Field(gt=1)] = 10.0
    iterations: Count = 100
    position_error: _Positive = 1e-10
    draws: Annotated[int, Field(ge=0, le=MOST)] = 100


class StudyConfig(Strict):
    """The paper's study.

    weights, reading: of the paper's fitness. sound_weights: of ours. random_plans: with which every plan's prediction
    is compared. repetitions: of Simulation II; unregularised: of them that are also fitted with all parameters free.
    quick: a tenth of generations, repetitions and random plans, to see whether all works.
    """

    scene: SceneConfig
    weights: WeightsConfig
    sound_weights: WeightsConfig
    reading: ReadingConfig = ReadingConfig.model_construct()
    search: SearchConfig = SearchConfig.model_construct()
    simulation_1: SimulationOneConfig = SimulationOneConfig.model_construct()
    random_plans: Annotated[int, Field(ge=10, le=MOST)] = 2000
    repetitions: Annotated[int, Field(ge=10, le=MOST)] = 2000
    unregularised: Annotated[int, Field(ge=10, le=MOST)] = 60
    quick: bool = False

    def sized(self) -> Self:
        """The study that is run: this one, or its small version if `quick`."""
        if not self.quick:
            return self
        search = self.search.model_copy(
            update={
                "generations": max(self.search.generations // 10, 1),
                "side_generations": max(self.search.side_generations // 10, 1),
            }
        )
        first = self.simulation_1.model_copy(update={"draws": self.simulation_1.draws // 10})
        return self.model_copy(
            update={
                "search": search,
                "simulation_1": first,
                "random_plans": max(self.random_plans // 10, 10),
                "repetitions": max(self.repetitions // 10, 10),
                "unregularised": max(self.unregularised // 10, 10),
            }
        )
