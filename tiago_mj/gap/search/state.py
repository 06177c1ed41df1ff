"""Question, state and result of a search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.detectors.readings import Known
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.search import ranking
from tiago_mj.gap.search.screen import Screened
from tiago_mj.gap.simulation.subset import Subset

Array = NDArray[np.float64]

#: Physics steps of all trials that are fitted, and of the screening trials; no fewer than so many trials: ten
#: grasps of a second and a quarter are all fitted, of ten-second ones those in which the nominal model fails most.
FIT_STEPS: Final = 8_000
FIRST_STEPS: Final = 4_000
FIT_TRIALS: Final = 3
FIRST_TRIALS: Final = 1
#: Screening trials at most.
SCREEN_TRIALS: Final = 3
#: Physics steps that a search for one effect or two takes at most, in units of those of all fitted trials, and half as
#: many again for three: fits then end where they are. Of 18 cases of the blind check (seed 14) right answers took 150
#: to 690, one 1130; three without any 1120 to 1930. With half of it two of 34 hinges (seed 8801) ended before their
#: second effect was sought; a real servo that rubs by its load had taken all before its third was.
BUDGET: Final = 1800
#: The same in rows of efforts along a motion, of which each takes a hundredth of the time: an arm with two frictions on
#: each of four joints took 4 000.
BUDGET_ALONG: Final = 10_000

#: Smallest weight of a sample (square root) while another effect is sought: half of that of uncorrelated samples.
#: Residuals beside an explanation that lacks an effect are correlated by that effect, not by model error. Halved and
#: doubled, none of 16 answers about hinges changes (varied.json).
MIN_WEIGHT_WHILE_UNEXPLAINED: Final = 0.5 / ranking.SAMPLES_PER_INDEPENDENT**0.5


class Tick(Protocol):
    """Callback for the progress of a diagnosis."""

    def __call__(self, stage: str, total: int, done: int = 0, *, gap: bool | None = None) -> None:
        """A stage of ``total`` steps begins, or has done ``done`` of them; ``gap``: whether the best explanation so far
        leaves one."""


@dataclass(frozen=True)
class Question:
    """What is to be explained, and the candidates and nuisances to explain it with.

    Attributes:
        predict: simulations.
        data: measured, of the trials.
        trials: their indices.
        pool: candidates.
        terms: nuisance parameters.
        base: nominal predictions, (ntrials, T, C).
        known: effects that are measured on the readings alone: they are part of every explanation.
        motion: what the servos' motion says; None: there is nothing to be read from it.
        steps: physics steps of one trial; 0: not known, and no limit to them.
        already: physics steps that were made before, and do not count.
        beyond: whether further effects are sought beside an explanation that leaves nothing to explain.
        share: of the usual physics steps that the search may take.
        most: effects of one explanation at most; None: as many as a search ever seeks.
        assumed: ``data`` with the tolerance by which what is found is judged; None: that of ``data``.
        sets: explanations by several effects of what the servos must have given, which are worth a fit; None: nothing
            says that.
    """

    predict: Predictor
    data: Data
    trials: Subset
    pool: Sequence[Candidate]
    terms: Sequence[Term]
    base: Array
    known: Sequence[Known] = ()
    motion: ServoMotion | None = None
    steps: int = 0
    already: int = 0
    beyond: bool = True
    share: float = 1.0
    most: int | None = None
    assumed: Data | None = None
    sets: Callable[[], Sequence[Fitted]] | None = None

    @property
    def fitted_trials(self) -> int:
        """Number of trials that are fitted."""
        return min(max(FIT_STEPS // max(self.steps, 1), FIT_TRIALS), len(self.trials))

    @property
    def first_trials(self) -> int:
        """Largest number of screening trials."""
        return min(max(FIRST_STEPS // max(self.steps, 1), FIRST_TRIALS), SCREEN_TRIALS)

    def budget(self, effects: int) -> float:
        """Physics steps of the search until explanations of so many effects were sought."""
        most = (BUDGET if self.predict.replays else BUDGET_ALONG) * max(effects / 2, 1.0)
        return most * self.share * self.fitted_trials * self.steps if self.steps else np.inf


@dataclass(frozen=True)
class State:
    """State of a search; immutable, every stage returns a new one.

    Attributes:
        screening: fitter to the screening trials.
        full: fitter to all trials.
        fits: explanations of all trials, the nominal model among them.
        nominal_nuisance: nuisances of the nominal model on all trials, beside which effects are sought.
        linearization_point: the nominal model on the screening trials, beside which effects are screened.
        promising: screened effects by decreasing gain; none before screening.
        pool: candidates that are visible, those included that gained little on the first trial.
        unseen: effects that no magnitude makes visible in these recordings.
        losing: candidates that lose commands: which were lost is decoded, not drawn.
        motion: what the servos' motion says; None: there is nothing to be read from it.
        excluded: indices of excluded trials: their motion departs from what the best explanation predicts.
        periods_tried: explanations by a driver beside which all its periods were tried.
    """

    screening: Fitter
    full: Fitter
    fits: tuple[Fitted, ...]
    nominal_nuisance: Array
    linearization_point: Point
    promising: tuple[Screened, ...] = ()
    pool: tuple[Candidate, ...] = ()
    unseen: tuple[str, ...] = ()
    losing: tuple[Candidate, ...] = ()
    motion: ServoMotion | None = None
    excluded: tuple[int, ...] = ()
    periods_tried: frozenset[frozenset[object]] = frozenset()

    @property
    def best(self) -> Fitted:
        """The explanation with the most evidence."""
        return ranking.by_evidence(self.fits)[0]

    @property
    def nominal(self) -> Fitted:
        """The nominal model with its best nuisances."""
        return ranking.best_nominal(self.fits)

    def with_weight(self, weight: Array) -> State:
        """The search with other sample weights, (C,); earlier fits keep their evidence."""
        screening, full = replace(self.screening, weight=weight), replace(self.full, weight=weight)
        return replace(self, screening=screening, full=full)

    def with_fits(self, fits: Sequence[Fitted]) -> State:
        """The search with further explanations; of fits of the same effects the one with the most evidence is kept."""
        return replace(self, fits=tuple(ranking.unique_by_labels([*self.fits, *fits])))


@dataclass(frozen=True)
class Ranked:
    """Explanations with the evidence for them, best first.

    Attributes:
        fits: explanations; ``known`` effects are the last parts of each, and nuisances of all trials the first of its
            nuisances, those too that tell nothing.
        not_excited: effects that no magnitude makes visible in these recordings.
        known: number of effects that are measured on the readings alone: they are part of every explanation.
        pool: number of different effects that were considered.
        complete: False when time ran out.
        weight: square root of what a sample of each channel counts for, (C,).
        predict: simulations, in which those commands are lost that were.
        excluded: indices of excluded trials: their motion departs from what the best explanation predicts.
        ended: what ended the search before its end: the user, or the time while something was simulated.
    """

    fits: tuple[Fitted, ...]
    not_excited: tuple[str, ...]
    known: int
    pool: int
    complete: bool
    weight: Array
    predict: Predictor
    excluded: tuple[int, ...] = ()
    ended: BaseException | None = None
