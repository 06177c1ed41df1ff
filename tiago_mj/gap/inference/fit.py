"""Fit an explanation: its magnitudes jointly with the nominal model's own numbers, and the evidence for it.

Gauss-Newton on whitened residuals with a normal prior on the nuisance parameters, within bounds; what a fit is worth is
its :func:`tiago_mj.gap.inference.evidence.log_evidence`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import central, likelihood, scatter
from tiago_mj.gap.inference.differenced import Differenced, FitTask, moved_magnitudes
from tiago_mj.gap.inference.evidence import Responses, log_evidence
from tiago_mj.gap.inference.points import NUISANCE_STEP, Fitted, Point, Start
from tiago_mj.gap.inference.remembered import remembered
from tiago_mj.gap.inference.whitening import Whitening

__all__ = ["NUISANCE_STEP", "FitTask", "Fitted", "Fitter", "Point", "Start"]

Array = NDArray[np.float64]

#: Gauss-Newton steps, each by its share and its damping (Marquardt 1963), and whether it is of the magnitudes alone: in
#: turn, until one helps; those in one row are tried at once.
STEP_SCHEDULE: Final = (
    ((1.0, 0.0, False),),
    ((0.4, 0.0, False), (1.0, 0.0, True)),
    ((0.1, 0.0, False), (1.0, 3.0, False), (0.4, 0.0, True)),
)
#: The same of a step whose responses were simulated where it begins: all are tried at once, and the best is taken.
DESCENT: Final = tuple(
    (*one, False) for one in ((1.0, 0.0), (0.5, 0.0), (0.25, 0.0), (1.0, 0.3), (1.0, 3.0), (1.0, 30.0))
)
#: Such responses at most: five ended at an evidence of -684 nats, five more at -554 (blind check, seed 71, case 34).
MAX_DESCENT: Final = 10
#: Share of the predicted drop of the cost that a step has to gain for another with the same responses (chosen; in
#: Shamanskii 1967 a number of steps is fixed).
MIN_SHARE_OF_DROP: Final = 0.25
#: Iteration ends where a step lowers the cost by less than this [nats]: of a quadratic cost the step was then shorter
#: than √(2 · 0.01) = 0.14 standard deviations of the estimate.
MIN_COST_DROP_NATS: Final = 0.01
MAX_ITERATIONS: Final = 5
#: Gauss-Newton steps where responses are linear: the first softens large residuals by where it began.
STEPS_IN_A_LINEAR_MODEL: Final = 2
#: A fit is abandoned where even this many times the cost drop predicted by the linear model would leave it more than
#: HOPELESS_COST_NATS above the lowest cost of the fits beside it [nats]: contacts do not follow the linear model.
#: Halved and doubled, none of 32 answers about hinges changes (varied.json).
PREDICTED_DROP_FACTOR: Final = 3.0
HOPELESS_COST_NATS: Final = 15.0
#: Shares of a Gauss-Newton step of the magnitudes alone, tried in turn until one lowers the cost; iteration ends
#: after a step that lowers it by a smaller share than MIN_RELATIVE_COST_DROP. Halved and doubled, none of 32 answers
#: about hinges changes (varied.json).
MAGNITUDE_STEP_SHARES: Final = (1.0, 0.4)
MIN_RELATIVE_COST_DROP: Final = 0.01
#: Nuisance responses are recomputed around fitted magnitudes that leave a misfit above this (mean squared residual
#: of the worst channel, in units of floor and tolerance), unless their cost is more than RELINEARIZING_COST_RATIO
#: times the lowest plus HOPELESS_COST_NATS. Halved and doubled, none of 32 answers about hinges changes
#: (varied.json).
RELINEARIZING_MISFIT: Final = 1.2
RELINEARIZING_COST_RATIO: Final = 3.0


T = TypeVar("T")


@dataclass
class Fitter(Differenced):
    """Fits explanations to one set of trials.

    Attributes:
        iterations: Gauss-Newton steps at most.
        min_cost_drop: a drop of the cost below this is no progress [nats].
        out_of_time: asked between steps; once it returns True, a fit ends where it is.
    """

    iterations: int = MAX_ITERATIONS
    min_cost_drop: float = MIN_COST_DROP_NATS
    out_of_time: Callable[[], bool] = lambda: False

    def responses_to_magnitudes(self, at: Point, base: Array) -> Array:
        """Response of predictions ``base`` at a point to each of its magnitudes, per unit of it, (k, ntrials, T, C)."""
        return _run([self.value_responses(at, base)], self.predictions)[0]

    def fit_all(self, starts: Sequence[Start]) -> list[Fitted]:
        """Fit the magnitudes and nuisances of each explanation. The simulations that the fits need next are run in one
        batch; a fit whose cost is far above the lowest is abandoned."""
        return self._fitted([self], starts, together=True)

    def fit_each(self, fitters: Sequence[Fitter], starts: Sequence[Start]) -> list[Fitted]:
        """Fit explanations to the same trials, each by a fitter with its own nuisance responses
        (:meth:`linearized_at_each`). Simulations are batched; no fit is abandoned for being far behind."""
        return self._fitted(fitters, starts, together=False)

    def _fitted(self, fitters: Sequence[Fitter], starts: Sequence[Start], *, together: bool) -> list[Fitted]:
        """A fit of each start, as long as they are finished from the journal."""

        def work() -> list[Fitted]:
            costs: list[float] = []
            each = fitters if not together else [self] * len(starts)
            tasks = [one._fit(start, costs if together else []) for one, start in zip(each, starts, strict=True)]
            return _run(tasks, self.predictions)

        depends_on = ("fits", together, [one.settings() for one in fitters], list(starts))
        return remembered(self.predict, work, depends_on, self.out_of_time)

    def descended(self, start: Start, ahead: float = -np.inf) -> Fitted:
        """Fit whose responses are simulated anew for each step, by central differences of moves that are long enough
        for the scatter of predictions (:mod:`tiago_mj.gap.inference.scatter`); abandoned where it stays behind an
        explanation with the evidence ``ahead``."""

        def work() -> Fitted:
            return _run([self._descended(start, ahead)], self.predictions)[0]

        return remembered(self.predict, work, ("descended", self.settings(), start, ahead), self.out_of_time)

    def _descended(self, start: Start, ahead: float) -> FitTask[Fitted]:
        at = self.without_duplicates(Point.of(start))
        on, base, scattered = yield from self.opened(at)
        moved = yield from self.first_moves(on, at, base, scattered)
        for _ in range(MAX_DESCENT):
            around = central.around(self, at, moved)
            of_values, of_terms = central.responses(self, at, around, (yield around))
            columns = np.concatenate([on.white(of_values).T, on.columns(of_terms, self.per_trial)], axis=1)
            added = scatter.added_curvature(self, moved, scattered)
            normal, before = self.normal(on, at, base, columns), on.cost(base, at.nuisance)
            least = before + on.tolerance_cost - PREDICTED_DROP_FACTOR * normal.predicted_drop
            if least - HOPELESS_COST_NATS > -ahead:
                break
            # What a prediction scatters by changes the cost of an optimum by about its root.
            enough = max(self.min_cost_drop, scattered**0.5)
            at, base, gained = yield from self._steps(on, at, base, columns, enough)
            if gained < enough or self.out_of_time():
                break
            moved = self.moves(at, columns, added, scattered)
            # What showed nothing beyond the scatter is not moved again, so that nothing is simulated for it.
            silent = scatter.told(self, len(at.parts), columns, added) == 0
            silent[: len(at.parts)] = False
            moved[silent] = 0.0
        return self._evaluated(on, at, base, Responses(columns, added=added))

    def _steps(
        self, on: Whitening, at: Point, base: Array, columns: Array, enough: float
    ) -> FitTask[tuple[Point, Array, float]]:
        """Gauss-Newton steps with the same responses, as long as each gains ``enough`` and the share of what it should
        (Shamanskii 1967); the point, the prediction there, and the drop of the cost."""
        first = before = on.cost(base, at.nuisance)
        while True:
            normal = self.normal(on, at, base, columns)
            points = self.points(normal, at, DESCENT)
            tried = yield points
            costs = [on.cost(one, point.nuisance) for one, point in zip(tried, points, strict=True)]
            # Of what is as good to within the scatter the full step, which the responses ask for.
            whole = costs[0] < min(before, *costs) + enough
            best = 0 if whole else int(np.argmin(costs))
            gained = before - costs[best]
            if whole or gained > 0:
                at, base, before = points[best], tried[best], costs[best]
            if gained < max(enough, MIN_SHARE_OF_DROP * normal.predicted_drop) or self.out_of_time():
                return at, base, first - before

    def settled(self, fits: Sequence[Fitted]) -> list[Fitted]:
        """Fits with a last Gauss-Newton step, evidence and deviations by responses of central differences
        (:mod:`tiago_mj.gap.inference.central`)."""

        def work() -> list[Fitted]:
            return _run([self._settled(Point.of(fit)) for fit in fits], self.predictions)

        return remembered(self.predict, work, ("settled", self.settings(), list(fits)), self.out_of_time)

    def _settled(self, at: Point) -> FitTask[Fitted]:
        on, base, scattered = yield from self.opened(at)
        wider = scatter.MAX_WIDENING if scatter.is_uneven(scattered) else 1.0
        # Along a valley, where numbers make up for each other, only what scatter adds to each counts, not its share.
        moved = np.array([wider * one for one in self.usual_moves(at)])
        moved[len(at.parts) :] = scatter.nudge(scattered)
        around, of_seconds = central.around(self, at, moved), central.around_second_numbers(at, wider)
        asked = [*around, *of_seconds]
        simulated = (yield asked) if asked else np.zeros((0, *base.shape))
        simulated, beside = simulated[: len(around)], simulated[len(around) :]
        of_values, of_terms = central.responses(self, at, around, simulated)
        columns = np.concatenate([on.white(of_values).T, on.columns(of_terms, self.per_trial)], axis=1)
        normal, before = self.normal(on, at, base, columns), on.cost(base, at.nuisance)
        if normal.predicted_drop > self.min_cost_drop:
            points = self.points(normal, at, [step for steps in STEP_SCHEDULE for step in steps if not step[2]])
            tried = yield points
            costs = [on.cost(one, point.nuisance) for one, point in zip(tried, points, strict=True)]
            if min(costs) < before:
                at, base = points[int(np.argmin(costs))], tried[int(np.argmin(costs))]
        steps = [wider * central.second_step(part, name) for part in at.parts for name in part.second_numbers]
        seconds = on.white((beside[::2] - beside[1::2]) / (2 * np.array(steps)[:, None, None, None])).T
        added = scatter.added_curvature(self, moved, scattered, steps)
        return self._evaluated(on, at, base, Responses(columns, seconds if steps else None, added))

    def evaluated(self, fits: Sequence[Fitted]) -> list[Fitted]:
        """Fits with the mean squares that their residuals have in the noise of this fitter; all else is as it was."""
        each = [[at, *self.without_each(at)] for at in map(Point.of, fits)]
        simulated, out = iter(self.predictions(list(itertools.chain(*each)))), []
        for fit, points in zip(fits, each, strict=True):
            base, *without = (next(simulated) for _ in points)
            on = self.with_form_tolerance(points[0], base, without)
            misfit, lasting = self._mean_squares(on, base)
            out.append(replace(fit, misfit=misfit, lasting=lasting))
        return out

    def _mean_squares(self, on: Whitening, base: Array) -> tuple[float, float]:
        """Of the residual of the worst channel: sample by sample, and over blocks."""
        over_blocks = np.nan_to_num(likelihood.lasting(on.data, on.data.value - base))
        return float(on.misfit(base).max(initial=0.0)), float(over_blocks.max(initial=0.0))

    def costs_by_shares(self, shares: Sequence[float], start: Start, judged: Whitening) -> list[float]:
        """What an explanation leaves with each of several shares of the step's error put right, at the end of a fit by
        linear responses [nats]: what is put right is the same beside all that a fit tries, so that all shares respond
        alike to the numbers.

        Args:
            shares: of the step's error.
            start: the explanation, fitted with one of them.
            judged: whitening by which costs are told; the fit is by the whitening of this fitter.
        """

        def work() -> list[float]:
            begin = self.without_duplicates(Point.of(start))
            return _run([self._costs_by_shares(shares, begin, judged)], self.predictions)[0]

        depends_on = ("shares", self.settings(), tuple(shares), start, judged.data, judged.weight)
        return remembered(self.predict, work, depends_on, self.out_of_time)

    def _costs_by_shares(self, shares: Sequence[float], begin: Point, judged: Whitening) -> FitTask[list[float]]:
        base, *alone = yield [begin, *self.without_each(begin)]
        on = self.with_form_tolerance(begin, base, alone)
        of_values = yield from self.value_responses(begin, base)
        near = replace(self, responses=(yield from self.nuisance_responses(begin, base))) if self.size else self
        columns = np.concatenate([on.white(of_values).T, on.columns(near.responses, self.per_trial)], axis=1)
        costs = []
        for simulated in self.predict.by_shares(self.wanted([begin]), shares):
            at, there = begin, simulated
            for _ in range(STEPS_IN_A_LINEAR_MODEL):
                (at,) = self.points(self.normal(on, at, there, columns), at, STEP_SCHEDULE[0])
                of_nuisances = near.change_by(at.nuisance - begin.nuisance)
                there = simulated + np.tensordot(at.values - begin.values, of_values, axes=1) + of_nuisances
            costs.append(judged.cost(there, at.nuisance))
        return costs

    def settings(self) -> tuple[object, ...]:
        """What a fit depends on beside its start and the simulations."""
        numbers = (self.iterations, self.min_cost_drop, self.min_move_share, self.uneven)
        return (self.trials, self.data, self.weight, self.terms, self.responses, self.given, *numbers)

    def _fit(self, start: Start, costs_beside: list[float]) -> FitTask[Fitted]:
        nuisance = np.zeros(self.size) if start.nuisance is None else start.nuisance
        points = [
            self.without_duplicates(Point(start.parts, v, n))
            for v, n in ((start.values, nuisance), *start.alternatives)
        ]
        tried = yield points
        on = Whitening(self.data, self.weight)
        best = int(np.argmin([on.cost(one, point.nuisance) for one, point in zip(tried, points, strict=True)]))
        at, base = points[best], tried[best]
        if alone := self.without_each(at):
            on = self.with_form_tolerance(at, base, (yield alone))
        columns = on.columns(self.responses, self.per_trial)
        if at.parts and not at.nuisance.any():
            at, base = yield from self._fit_magnitudes(on, at, base)
            behind = (
                on.cost(base, at.nuisance)
                > RELINEARIZING_COST_RATIO * min(costs_beside, default=np.inf) + HOPELESS_COST_NATS
            )
            if self.size and not behind and on.misfit(base).max() > RELINEARIZING_MISFIT and not self.out_of_time():
                columns = on.columns((yield from self.nuisance_responses(at, base)), self.per_trial)
        jacobian = yield from self.value_columns(on, at, base)
        for iteration in range(self.iterations):
            if iteration and self.out_of_time():
                break
            before = on.cost(base, at.nuisance)
            costs_beside.append(before + on.tolerance_cost)
            normal = self.normal(on, at, base, np.concatenate([jacobian, columns], axis=1))
            if (
                costs_beside[-1] - PREDICTED_DROP_FACTOR * normal.predicted_drop
                > min(costs_beside) + HOPELESS_COST_NATS
            ):
                break
            if normal.predicted_drop < self.min_cost_drop:
                break
            for k, steps in enumerate(STEP_SCHEDULE):
                if k:
                    normal = self.normal(on, at, base, np.concatenate([jacobian, columns], axis=1))
                points = self.points(normal, at, steps)
                tried = yield points
                costs = [on.cost(tried[k], points[k].nuisance) for k in range(len(points))]
                best = int(np.argmin(costs))
                jacobian, columns = self._broyden_update(jacobian, columns, at, points[0], on.white(tried[0] - base))
                if costs[best] < before:
                    break
            else:
                break
            at, base = points[best], tried[best]
            if before - costs[best] < self.min_cost_drop * (1 + iteration):
                break
            jacobian = yield from self.value_columns(on, at, base)
        return self._evaluated(on, at, base, Responses(np.concatenate([jacobian, columns], axis=1)))

    def _fit_magnitudes(self, on: Whitening, at: Point, base: Array) -> FitTask[tuple[Point, Array]]:
        """Fit the magnitudes alone, nuisances held: fitted jointly from a far start, nuisances that mimic the effect
        would shorten the common step and end at their bounds."""
        for _ in range(self.iterations):
            before = on.cost(base, at.nuisance)
            jacobian = yield from self.value_columns(on, at, base)
            step = self.normal(on, at, base, jacobian, alone=True).step()
            for share in MAGNITUDE_STEP_SHARES:
                there = Point(at.parts, moved_magnitudes(at, share * step), at.nuisance)
                (tried,) = yield [there]
                cost = on.cost(tried, at.nuisance)
                if cost < before:
                    break
            else:
                break
            at, base = there, tried
            if before - cost < max(MIN_RELATIVE_COST_DROP * before, self.min_cost_drop) or self.out_of_time():
                break
        return at, base

    def _broyden_update(
        self, jacobian: Array, columns: Array, at: Point, to: Point, change: Array
    ) -> tuple[Array, Array]:
        """Rank-one update of the responses so that they reproduce the change that a step made (Broyden 1965)."""
        scale = self.scale(at.parts)
        step = np.concatenate([to.values - at.values, to.nuisance - at.nuisance]) / scale
        if not step.any():
            return jacobian, columns
        scaled = np.concatenate([jacobian, columns], axis=1) * scale
        scaled += np.outer(change - scaled @ step, step / (step @ step))
        scaled /= scale
        return scaled[:, : len(at.parts)], scaled[:, len(at.parts) :]

    def _evaluated(self, on: Whitening, at: Point, base: Array, responses: Responses) -> Fitted:
        twins = [place for part in at.parts for place in self.duplicating_nuisances(part)]
        found = log_evidence(on, at, base, responses, twins)
        misfit, lasting = self._mean_squares(on, base)
        each = iter(found.second_deviations.tolist())
        spreads = [d if p.spread is None else p.spread for p, d in zip(at.parts, found.deviations, strict=True)]
        return Fitted(
            at.parts,
            at.values,
            np.array(spreads),
            at.nuisance,
            found.log_likelihood + found.prior - sum(self.selection_penalty(part) for part in at.parts),
            misfit,
            found.prior,
            lasting,
            nuisance_deviations=found.nuisance_deviations,
            correlation=found.correlation,
            second_deviations=tuple({name: next(each) for name in part.second_numbers} for part in at.parts)
            if responses.seconds is not None
            else (),
            marginal=None if responses.seconds is None else found.marginal,
        )


def _run(tasks: Sequence[FitTask[T]], predict: Callable[[Sequence[Point]], Array]) -> list[T]:
    """Run tasks to completion, simulating all points that they ask for in one batch per round."""
    done: dict[int, T] = {}
    asked: dict[int, Sequence[Point]] = {}
    answers: dict[int, Array | None] = dict.fromkeys(range(len(tasks)))
    while True:
        for k, answer in answers.items():
            try:
                asked[k] = tasks[k].send(answer) if answer is not None else next(tasks[k])
            except StopIteration as end:
                done[k] = end.value
        if not asked:
            break
        predicted = predict([point for points in asked.values() for point in points])
        answers, used = {}, 0
        for k, points in asked.items():
            answers[k] = predicted[used : used + len(points)]
            used += len(points)
        asked = {}
    return [done[k] for k in range(len(tasks))]
