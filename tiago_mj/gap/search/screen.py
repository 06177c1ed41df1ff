"""Screening: log likelihood of every effect at a grid of magnitudes, each added to a given explanation.

All are simulated on the trial that is predicted worst, the best of them on the other screening trials (successive
halving; Karnin, Koren & Somekh 2013). Predictions between two magnitudes of the grid are interpolated linearly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation.replay import sensor_only

Array = NDArray[np.float64]

#: Magnitudes between two of a candidate's grid at which its prediction is drawn as a straight line.
INTERPOLATED_MAGNITUDES: Final = 3
#: And so many more, each where the likelihood's peak is by those around the best: it may be far narrower than a grid.
PEAK_REFINEMENTS: Final = 3
#: Predictions that are made at once.
BATCH_SIZE: Final = 64
#: Share of the settings (an effect and its fixed parameters) that go on from one trial to all. Halved and doubled,
#: none of 16 answers about hinges changes (varied.json).
KEPT_SHARE: Final = 0.5


@dataclass(frozen=True)
class Screened:
    """A candidate after screening.

    Attributes:
        candidate: effect, targets, fixed parameters.
        value: its best magnitude of the grid.
        gain: log-likelihood over that of what it is tried beside.
        values: magnitudes that were looked at, (k,).
        changes: its predictions minus those without it, at those, (k, ntrials, T, C).
        visible: root mean square of the change in units of floor and tolerance, at its largest magnitude.
        selection_penalty: what it cost to choose what was drawn, part of the gain [nats].
    """

    candidate: Candidate
    value: float
    gain: float
    values: tuple[float, ...]
    changes: Array
    visible: float
    selection_penalty: float = 0.0


@dataclass(frozen=True)
class FirstPass:
    """Result of screening.

    Attributes:
        on_all: candidates that were tried on all trials, best first.
        dropped: those that gained too little on one, best first.
    """

    on_all: tuple[Screened, ...]
    dropped: tuple[Screened, ...] = ()


def screen(
    fitter: Fitter,
    pool: Sequence[Candidate],
    point: Point,
    how_far: Callable[[int, int], None] = lambda total, done: None,
    tried: Callable[[Iterable[str]], None] = lambda names: None,
) -> FirstPass:
    """Log likelihood of every candidate at every magnitude of its grid, relative to that without it.

    An effect on one joint or sensor is not simulated by itself: its channels are taken from the simulation in which all
    targets have the effect, the others from that without, as fingers hardly affect each other. What is promising is
    simulated properly later.

    Args:
        fitter: of the trials; asked between portions whether time is out: what was not simulated by then is left out.
        pool: candidates.
        point: effects and nominal numbers beside which the pool is tried.
        how_far: told between portions how many magnitudes there are, and how many were simulated.
        tried: told which effects were simulated, at one magnitude at least.
    """
    base = fitter.predictions([point], keep=True)[0]
    if len(fitter.trials) == 1 or not fitter.predict.replays:  # torques of one trial cost as much as those of all
        return FirstPass(tuple(_screened(fitter, pool, point, base, how_far, tried)))
    worst = worst_predicted(base, fitter.data, 1)
    alone, point_alone = fitter.part(worst), replace(point, nuisance=fitter.of(worst, point.nuisance))
    first = _screened(alone, pool, point_alone, base[worst], how_far, tried)
    simulated = [s.candidate for s in first if not sensor_only(s.candidate.entry(s.candidate.high))]
    settings = list(dict.fromkeys((c.effect, c.fixed) for c in simulated))
    dropped = set(settings[int(np.ceil(KEPT_SHARE * len(settings))) :])  # what only measures otherwise costs nothing
    kept = [s.candidate for s in first if (s.candidate.effect, s.candidate.fixed) not in dropped]
    rest = [s for s in first if (s.candidate.effect, s.candidate.fixed) in dropped]
    return FirstPass(tuple(_screened(fitter, kept, point, base, how_far, tried)), tuple(rest))


def scored_beside(fitter: Fitter, point: Point, base: Array) -> likelihood.Frame:
    """What effects are scored by that are tried beside an explanation: the nominal numbers may move, and its own
    magnitudes, each with a prior as wide as it is large.

    Held, a magnitude that stands for a part of what is missing leaves little to gain: of a hinge with 0.039 kg·m² of
    rotor inertia and readings 0.8 % short, inertia alone is fitted as 0.032, and beside that the scale gains nothing.

    Args:
        fitter: of the trials.
        point: the explanation.
        base: predictions there, (ntrials, T, C).
    """
    sizes = [
        abs(v - p.identity) if np.isfinite(p.identity) else abs(v)
        for p, v in zip(point.parts, point.values, strict=True)
    ]
    own = fitter.responses_to_magnitudes(point, base) * np.array(sizes)[:, None, None, None]
    none = np.zeros(len(sizes))
    return likelihood.frame(
        fitter.data,
        fitter.weight,
        np.concatenate([own, fitter.responses]),
        np.concatenate([none.astype(bool), fitter.per_trial]),
        np.concatenate([none, point.nuisance]),
    )


def misfit_by_trial(data: Data, predicted: Array) -> Array:
    """Sum of squares of each trial's softened residual, (ntrials,)."""
    white = likelihood.scaled(data, likelihood.residual(data, predicted))
    out: Array = (likelihood.soften(white) ** 2).sum(axis=(1, 2))
    return out


def worst_predicted(predicted: Array, data: Data, count: int) -> list[int]:
    """Indices of the trials with the largest residuals, ascending."""
    return sorted(int(k) for k in np.argsort(-misfit_by_trial(data, predicted))[:count])


def _screened(
    fitter: Fitter,
    pool: Sequence[Candidate],
    point: Point,
    base: Array,
    how_far: Callable[[int, int], None],
    tried: Callable[[Iterable[str]], None],
) -> list[Screened]:
    """One entry a candidate, best first; ``base`` is the prediction without them, (ntrials, T, C)."""
    on = scored_beside(fitter, point, base)
    runs: dict[tuple[str, tuple[tuple[str, float], ...], float], Array] = {}
    # On all targets at once, also what was read off one of them alone.
    asked = [((c.effect, c.fixed, v), k, c) for c in pool for k, v in enumerate(_in_screening_order(c.grid))]
    once = {key: (k, c) for key, k, c in reversed(asked)}
    ordered = sorted(once.items(), key=lambda item: item[1][0])
    wanted = [(replace(c, target=None), key[2]) for key, (_, c) in ordered]
    for first in range(0, len(wanted), BATCH_SIZE):
        if first and fitter.out_of_time():
            break
        how_far(len(wanted), first)
        portion = wanted[first : first + BATCH_SIZE]
        predicted = fitter.predictions([point.with_effect(c, value) for c, value in portion], keep=True)
        for (c, value), one in zip(portion, predicted, strict=True):
            runs[(c.effect, c.fixed, value)] = one
        tried(c.effect for c, _ in portion)
    nominal = likelihood.log_likelihood(on, base)
    out = []
    for c in pool:
        values = [v for v in c.grid if (c.effect, c.fixed, v) in runs]
        if not values:
            continue
        stack = np.stack([runs[(c.effect, c.fixed, v)] for v in values])
        if c.target is not None:
            mine = channels_of_targets(fitter.predict, c)
            stack = np.where(mine, stack, base)
        if _grows_from_nothing(c):
            values, stack = [*values, c.identity], np.concatenate([stack, base[None]])
        values, stack, found = _with_refined_peak(on, *_interpolated(values, stack))
        found = found - fitter.selection_penalty(c)
        best = int(np.argmax(found))
        change = stack - base
        white = likelihood.scaled(on.data, likelihood.mean_visible_change(on.data, change))
        out.append(
            Screened(
                c,
                values[best],
                float(found[best] - nominal),
                tuple(values),
                change,
                float(np.sqrt(np.mean(white**2, axis=(1, 2, 3)).max())),
                fitter.selection_penalty(c),
            )
        )
    return sorted(out, key=lambda s: -s.gain)


def _grows_from_nothing(c: Candidate) -> bool:
    """Whether a magnitude below the smallest of the grid gives a smaller effect; not where a detector drew or measured
    it."""
    return c.low <= c.identity <= c.high and c.identity not in c.grid and not c.selection_penalty


def _in_screening_order(grid: Sequence[float]) -> list[float]:
    """Magnitudes in the order of simulation, those half-way to a bound first, so that every effect is simulated once
    before any is twice."""
    middle = (len(grid) - 1) * 0.75
    return [grid[k] for k in sorted(range(len(grid)), key=lambda k: abs(k - middle))]


def _interpolated(values: Sequence[float], stack: Array) -> tuple[list[float], Array]:
    """Magnitudes and predictions with those between them, interpolated linearly.

    Without them an effect whose magnitude lies between two points of the grid would rank behind a worse one whose
    magnitude is a point of the grid.
    """
    order = np.argsort(values)
    at, there = np.asarray(values)[order], stack[order]
    share = np.arange(INTERPOLATED_MAGNITUDES + 1) / (INTERPOLATED_MAGNITUDES + 1)
    dense = at[:-1, None] + share * np.diff(at)[:, None]
    lines = there[:-1, None] + share[:, None, None, None] * np.diff(there, axis=0)[:, None]
    return (
        [*dense.ravel().tolist(), float(at[-1])],
        np.concatenate([lines.reshape(-1, *stack.shape[1:]), there[-1:]]),
    )


def _with_refined_peak(on: likelihood.Frame, values: list[float], stack: Array) -> tuple[list[float], Array, Array]:
    """Ascending magnitudes, predictions and log likelihoods, with a finer grid around the largest log likelihood.

    An encoder whose scale is 0.6 % off lay between the points 0 and 0.8 % and gained nothing at either (blind check,
    seed 9, case 110): the better a joint is measured, the narrower the peak.
    """
    found = likelihood.log_likelihood(on, stack)
    for _ in range(PEAK_REFINEMENTS):
        best = int(np.argmax(found))
        if not 0 < best < len(values) - 1:
            break
        (a, b, c), (low, high, right) = values[best - 1 : best + 2], found[best - 1 : best + 2]
        rise, fall = (high - low) * (c - b), (high - right) * (b - a)
        if not rise + fall > 0:
            break
        peak = b + 0.5 * (rise * (c - b) - fall * (b - a)) / (rise + fall)
        after = best + 1 if peak > b else best
        share = (peak - values[after - 1]) / (values[after] - values[after - 1])
        there = stack[after - 1] + share * (stack[after] - stack[after - 1])
        values = [*values[:after], float(peak), *values[after:]]
        stack = np.insert(stack, after, there, axis=0)
        found = np.insert(found, after, likelihood.log_likelihood(on, there[None])[0])
    return values, stack, found


def channels_of_targets(predict: Predictor, candidate: Candidate) -> NDArray[np.bool_]:
    """Mask of the channels of a candidate's targets, (C,)."""
    targets = predict.plant.wiring.targets
    kind = EFFECTS[candidate.effect].targets
    assert candidate.target is not None
    sides = set()
    for name in candidate.target:
        index = targets.names(kind).index(name)
        sides.add(targets.actuated[index] if kind == "command" else index)
    mine = []
    for channel, part in zip(predict.data.channels, predict.data.part, strict=True):
        sensor = channel.startswith("force.")
        if kind == "sensor":
            mine.append(sensor and part in sides)
        elif sensor:  # a finger's load cell belongs to its joint, by order: right, left
            joints = len(targets.joint) - len(targets.sensor)
            mine.append(joints + part in sides)
        else:
            mine.append(part in sides)
    return np.array(mine)
