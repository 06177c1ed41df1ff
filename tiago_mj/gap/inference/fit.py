"""Fit an explanation: its magnitudes jointly with the nominal model's own numbers, and the evidence for it.

Gauss-Newton on whitened residuals with a normal prior on the nuisance parameters, within bounds; what a fit is worth is
its :func:`tiago_mj.gap.inference.evidence.log_evidence`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import likelihood, noise_model
from tiago_mj.gap.inference.evidence import log_evidence
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.points import NUDGE, Fitted, Point, Start
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.inference.whitening import Normal, Whitening

__all__ = ["NUDGE", "Fitted", "Fitter", "Point", "Start", "Steps"]

Array = NDArray[np.float64]

#: Gauss-Newton steps, each by its share and its damping (Marquardt 1963), and whether it is of the magnitudes alone: in
#: turn, until one helps; those in one row are tried at once.
STEPS: Final = (
    ((1.0, 0.0, False),),
    ((0.4, 0.0, False), (1.0, 0.0, True)),
    ((0.1, 0.0, False), (1.0, 3.0, False), (0.4, 0.0, True)),
)
#: A drop of the cost below this is no progress [nats].
SETTLED: Final = 0.01
ITERATIONS: Final = 5
#: A fit ends where even so many times what a step promises would leave it so far behind the best of those beside it
#: [nats]. Chosen: promises are of straight lines, which contacts do not follow.
PROMISED: Final = 3.0
LOST: Final = 15.0
#: Shares of a step of the magnitudes alone, in turn until one helps; a step that lowers the cost by a smaller share
#: than this is the last.
ALONE: Final = (1.0, 0.4)
LITTLE: Final = 0.01
#: Curvature that keeps a nuisance where it is, in units of its prior's.
CERTAIN: Final = 1e12
#: Responses are taken anew around magnitudes that leave more than this (mean square of the worst channel, in units of
#: floor and tolerance), unless the best beside it costs so many times less.
FITS: Final = 1.2
BEHIND: Final = 3.0
#: A magnitude is moved by at least this share of its range to see what it does.
REACH: Final = 5e-3


T = TypeVar("T")
#: A computation that asks for predictions at points and is sent (npoints, ntrials, T, C).
Steps = Generator[Sequence[Point], Array, T]


@dataclass
class Fitter:
    """Fits explanations to one set of trials.

    Attributes:
        predict: simulations.
        trials: indices of the trials.
        data: measured, of these trials.
        weight: square root of what a sample of each channel counts for, (C,).
        terms: nuisance parameters.
        responses: change of the predictions per deviation of each term, (nterms, ntrials, T, C): of the nominal
            model's, or around another point (:meth:`around`); those that every trial has of its own come last.
        given: effects that are part of whatever is fitted.
        iterations: Gauss-Newton steps at most.
        settled: a drop of the cost below this is no progress [nats].
        reach: share of a magnitude's range that it is moved by at least to see what it does. Where contacts begin and
            end the response to a very small move is of single physics steps; a fit from far off needs about 0.01.
        out_of_time: asked between steps: a fit then ends where it is.
    """

    predict: Predictor
    trials: tuple[int, ...]
    data: Data
    weight: Array
    terms: tuple[Term, ...]
    responses: Array
    given: tuple[Entry, ...] = ()
    iterations: int = ITERATIONS
    settled: float = SETTLED
    reach: float = REACH
    out_of_time: Callable[[], bool] = lambda: False

    def __post_init__(self) -> None:
        self.shared = [k for k, term in enumerate(self.terms) if not term.per_trial]
        self._own = [k for k, term in enumerate(self.terms) if term.per_trial]
        self.per_trial = np.array([term.per_trial for term in self.terms], dtype=bool)

    @property
    def size(self) -> int:
        """Number of nuisance parameters."""
        return len(self.shared) + len(self._own) * len(self.trials)

    @property
    def motion_counts(self) -> float:
        """What a sample of the joints' motion counts for."""
        of_joints = [kind != "force" for kind in self.data.kinds]
        return float(np.mean(self.weight[of_joints] ** 2)) if any(of_joints) else 0.0

    def paid(self, part: Candidate) -> float:
        """What it costs to have chosen what an effect drew at random [nats]: told by the joints' motion, by samples
        that count for what they do here."""
        return self.motion_counts * sum(part.paid[trial] for trial in self.trials) if part.paid else 0.0

    def places(self, term: int) -> list[int]:
        """Where a nuisance parameter stands among the nuisances: once, or once a trial."""
        if term in self.shared:
            return [self.shared.index(term)]
        return list(range(len(self.shared) + self._own.index(term), self.size, len(self._own)))

    def effects(self, parts: Sequence[Candidate], values: Array, nuisance: Array, trial: int) -> tuple[Entry, ...]:
        """What is simulated for a trial (by its position among the trials)."""
        chosen = [*self.given, *(part.entry(float(v)) for part, v in zip(parts, values, strict=True))]
        for k, term in enumerate(self.shared):
            if nuisance[k]:
                chosen.append(self.terms[term].entry(float(nuisance[k])))
        base = len(self.shared) + trial * len(self._own)
        for k, term in enumerate(self._own):
            if nuisance[base + k]:
                chosen.append(self.terms[term].entry(float(nuisance[base + k])))
        return tuple(chosen)

    def predictions(self, points: Sequence[Point], *, keep: bool = False) -> Array:
        """(npoints, ntrials, T, C); ``keep``: remember the physics, for what only measures differently."""
        wanted = [
            (t, self.effects(p.parts, p.values, p.nuisance, k)) for p in points for k, t in enumerate(self.trials)
        ]
        out = self.predict(wanted, keep=keep)
        return out.reshape(len(points), len(self.trials), *out.shape[1:])

    def part(self, rows: Sequence[int]) -> Fitter:
        """Of some of the trials, by their positions among them."""
        return replace(
            self,
            trials=tuple(self.trials[k] for k in rows),
            data=noise_model.part(self.data, rows),
            responses=self.responses[:, list(rows)],
        )

    def of(self, rows: Sequence[int], nuisance: Array) -> Array:
        """Nuisances of some of the trials, of those of all."""
        shared = len(self.shared)
        own = nuisance[shared:].reshape(len(self.trials), len(self._own))
        return np.concatenate([nuisance[:shared], own[list(rows)].ravel()])

    def around(self, at: Point) -> Fitter:
        """The same with the nuisances' responses around a point: contacts do not answer in straight lines."""
        return self.around_each([at])[0]

    def around_each(self, points: Sequence[Point]) -> list[Fitter]:
        """The same around each of several points, simulated side by side."""
        asked = [[at, *self._nudged(at)] for at in points]
        predicted = self.predictions([one for some in asked for one in some]) if asked else np.empty(0)
        each = predicted.reshape(len(points), -1, *predicted.shape[1:])
        return [replace(self, responses=(some[1:] - some[0]) / NUDGE) for some in each]

    def fit_all(self, starts: Sequence[Start]) -> list[Fitted]:
        """Fit explanations, each its magnitudes and nuisances, side by side: what they all need next is simulated at
        once. What is far behind is not brought to its end."""
        costs: list[float] = []
        return _run([self._fit(start, costs) for start in starts], self.predictions)

    def fit_each(self, fitters: Sequence[Fitter], starts: Sequence[Start]) -> list[Fitted]:
        """Fits of this one's trials, each by a fitter with responses of its own (:meth:`around_each`), side by side and
        each brought to its end."""
        return _run([fitter._fit(start, []) for fitter, start in zip(fitters, starts, strict=True)], self.predictions)

    def _fit(self, start: Start, costs_beside: list[float]) -> Steps[Fitted]:
        nuisance = np.zeros(self.size) if start.nuisance is None else start.nuisance
        points = [self._once(Point(start.parts, v, n)) for v, n in ((start.values, nuisance), *start.also)]
        tried = yield points
        on = Whitening(self.data, self.weight)
        best = int(np.argmin([on.cost(one, point.nuisance) for one, point in zip(tried, points, strict=True)]))
        at, base = points[best], tried[best]
        if at.parts:
            without = yield [at.less(k) for k in range(len(at.parts))]
            shares = [EFFECTS[part.effect].form_known_to for part in at.parts]
            missed = [np.square(share * (base - one)) for share, one in zip(shares, without, strict=True)]
            on = on.with_shape(np.sqrt(sum(missed)))
        columns = on.columns(self.responses, self.per_trial)
        if at.parts and not at.nuisance.any():
            at, base = yield from self._alone(on, at, base)
            behind = on.cost(base, at.nuisance) > BEHIND * min(costs_beside, default=np.inf) + LOST
            if self.size and not behind and on.misfit(base).max() > FITS and not self.out_of_time():
                columns = on.columns((yield from self._responses(at, base)), self.per_trial)
        jacobian = yield from self._value_columns(on, at, base)
        for iteration in range(self.iterations):
            if iteration and self.out_of_time():
                break
            before = on.cost(base, at.nuisance)
            costs_beside.append(before + on.wider)
            normal = self._normal(on, at, base, np.concatenate([jacobian, columns], axis=1))
            if costs_beside[-1] - PROMISED * normal.promised > min(costs_beside) + LOST:
                break
            if normal.promised < self.settled:
                break
            for k, steps in enumerate(STEPS):
                if k:
                    normal = self._normal(on, at, base, np.concatenate([jacobian, columns], axis=1))
                points = self._points(normal, at, steps)
                tried = yield points
                costs = [on.cost(tried[k], points[k].nuisance) for k in range(len(points))]
                best = int(np.argmin(costs))
                jacobian, columns = self._corrected(jacobian, columns, at, points[0], on.white(tried[0] - base))
                if costs[best] < before:
                    break
            else:
                break
            at, base = points[best], tried[best]
            if before - costs[best] < self.settled * (1 + iteration):
                break
            jacobian = yield from self._value_columns(on, at, base)
        return self._finished(on, at, base, np.concatenate([jacobian, columns], axis=1))

    def _twins(self, part: Candidate) -> list[int]:
        """Places of nuisances that are the same number as a magnitude: of the same effect on some of its targets."""
        terms = [
            k for k, term in enumerate(self.terms) if (term.effect, term.parameter) == (part.effect, part.parameter)
        ]
        mine = [k for k in terms if part.target is None or set(self.terms[k].target or ()) <= set(part.target)]
        return [place for k in mine if not self.terms[k].per_trial for place in self.places(k)]

    def _once(self, point: Point) -> Point:
        """The same with what nuisances hold of a magnitude added to it: one number is not known twice."""
        values, nuisance = point.values.copy(), point.nuisance.copy()
        for k, part in enumerate(point.parts):
            twins = self._twins(part)
            if not twins or not nuisance[twins].any():
                continue
            move = float(np.mean([nuisance[place] * self.terms[self.shared[place]].deviation for place in twins]))
            moved = values[k] * np.exp(move) if self.terms[self.shared[twins[0]]].factor else values[k] + move
            values[k], nuisance[twins] = float(np.clip(moved, part.low, part.high)), 0.0
        return Point(point.parts, values, nuisance)

    def _alone(self, on: Whitening, at: Point, base: Array) -> Steps[tuple[Point, Array]]:
        """Magnitudes at their best while the nominal numbers stay where they are: what those mimic would shorten steps
        that all of them share, and leave them at their bounds."""
        for _ in range(self.iterations):
            before = on.cost(base, at.nuisance)
            jacobian = yield from self._value_columns(on, at, base)
            step = self._normal(on, at, base, jacobian, alone=True).step()
            for share in ALONE:
                there = Point(at.parts, _moved(at, share * step), at.nuisance)
                (tried,) = yield [there]
                cost = on.cost(tried, at.nuisance)
                if cost < before:
                    break
            else:
                break
            at, base = there, tried
            if before - cost < max(LITTLE * before, self.settled) or self.out_of_time():
                break
        return at, base

    def _responses(self, at: Point, base: Array) -> Steps[Array]:
        """Responses of the nuisances around a point, see :attr:`responses`."""
        return ((yield self._nudged(at)) - base) / NUDGE

    def _nudged(self, at: Point) -> list[Point]:
        """A little further in each nuisance; those that every trial has of its own all at once, and last."""
        own = [slice(len(self.shared) + k, None, len(self._own)) for k in range(len(self._own))]
        return [at.moved(which) for which in (*(slice(k, k + 1) for k in range(len(self.shared))), *own)]

    def _value_columns(self, on: Whitening, at: Point, base: Array) -> Steps[Array]:
        """Whitened response to each magnitude, per unit of it, (n, k)."""
        if not at.parts:
            return np.zeros((self.data.value.size, 0))
        points, steps = [], []
        for k, part in enumerate(at.parts):
            step = 0.02 * abs(at.values[k] - (part.identity if np.isfinite(part.identity) else 0.0))
            step = max(step, self.reach * (part.high - part.low))
            if at.values[k] + step > part.high:
                step = -step
            values = at.values.copy()
            values[k] += step
            points.append(Point(at.parts, values, at.nuisance))
            steps.append(step)
        response = ((yield points) - base) / np.array(steps)[:, None, None, None]
        return np.asarray(on.white(response).T)

    def _normal(self, on: Whitening, at: Point, base: Array, columns: Array, *, alone: bool = False) -> Normal:
        """The normal equations of a step; ``alone``: of the magnitudes."""
        count = len(at.parts) if alone else None
        known = np.ones(self.size)
        for part in at.parts:
            known[self._twins(part)] = CERTAIN
        prior = np.concatenate([np.zeros(len(at.parts)), known])[:count]
        scale = self._scale(at.parts)[:count]
        r, weighted = on.weighted(base, columns)
        weighted = weighted * scale
        gradient = weighted.T @ r - prior * np.concatenate([at.values * 0, at.nuisance])[:count]
        return Normal(weighted.T @ weighted + np.diag(prior + 1e-6), gradient, scale)

    def _points(self, normal: Normal, at: Point, steps: Sequence[tuple[float, float, bool]]) -> list[Point]:
        """Points to try: shares of damped Gauss-Newton steps, of magnitudes and nuisances together, or of magnitudes
        alone, with the nuisances where they are: their responses may be those of another point, and what they mimic
        shortens a step that both share."""
        count, bound = len(at.parts), likelihood.NUISANCE_BOUND
        points = []
        for share, damping, alone in steps:
            if alone and count:
                step = normal.first(count).step(damping)
                points.append(Point(at.parts, _moved(at, share * step), at.nuisance))
            elif not alone:
                step = normal.step(damping)
                nuisance = np.clip(at.nuisance + share * step[count:], -bound, bound)
                points.append(Point(at.parts, _moved(at, share * step[:count]), nuisance))
        return points

    def _corrected(self, jacobian: Array, columns: Array, at: Point, to: Point, change: Array) -> tuple[Array, Array]:
        """Responses, changed as little as it takes for them to have foretold what a step did (Broyden 1965)."""
        scale = self._scale(at.parts)
        step = np.concatenate([to.values - at.values, to.nuisance - at.nuisance]) / scale
        if not step.any():
            return jacobian, columns
        scaled = np.concatenate([jacobian, columns], axis=1) * scale
        scaled += np.outer(change - scaled @ step, step / (step @ step))
        scaled /= scale
        return scaled[:, : len(at.parts)], scaled[:, len(at.parts) :]

    def _scale(self, parts: Sequence[Candidate]) -> Array:
        """Magnitudes in units of their bounds: well conditioned."""
        return np.array([*(part.high - part.low for part in parts), *np.ones(self.size)])

    def _finished(self, on: Whitening, at: Point, base: Array, columns: Array) -> Fitted:
        found = log_evidence(on, Whitening(self.data, self.weight), at, base, columns)
        spreads = [d if p.spread is None else p.spread for p, d in zip(at.parts, found.deviations, strict=True)]
        return Fitted(
            at.parts,
            at.values,
            np.array(spreads),
            at.nuisance,
            found.met + found.prior - sum(self.paid(part) for part in at.parts),
            float(on.misfit(base).max(initial=0.0)),
            found.prior,
            float(np.nan_to_num(likelihood.lasting(on.data, on.data.value - base)).max(initial=0.0)),
        )


def _run(tasks: Sequence[Steps[T]], predict: Callable[[Sequence[Point]], Array]) -> list[T]:
    """Drive tasks to their ends, answering in one go what all of them ask for."""
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


def _moved(at: Point, step: Array) -> Array:
    """Magnitudes after a step, each within its bounds, (k,)."""
    return np.array([float(np.clip(v + s, p.low, p.high)) for p, v, s in zip(at.parts, at.values, step, strict=True)])
