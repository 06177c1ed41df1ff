"""Which effects a recording excites, and which of them it cannot tell apart.

An effect's signature is the change that it makes to the nominal prediction, in units of floor and tolerance, less what
the nominal model's own uncertain numbers could make as well: with responses A of the nuisances (in their deviations)

    d² = s's − b' (1 + A'A)⁻¹ b,   b = A's.

Two effects are told apart by what is left of one signature once the other has taken as much of it as it can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.detectors.readings import only_read_off
from tiago_mj.gap.inference import hypotheses, likelihood, noise_model
from tiago_mj.gap.inference.fit import NUISANCE_STEP
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation import replay, sizes, stability
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.io import mujoco_log
from tiago_mj.recordings.recording import RecordingError, Trial

Array = NDArray[np.float64]

#: Length of a signature that is clear: five standard deviations, a Bayes factor of e^12.
CLEAR: Final = 5.0
#: What cannot be told apart is asked of signatures that are so many times as long as a clear one, or at the default.
FIRM: Final = 2.0
#: Errors of a model last for at least so long [s], whatever this recording's noise: samples in between count once.
CORRELATED: Final = 0.1
#: Trials that are looked at: those in which most moves.
TRIALS: Final = 3


@dataclass(frozen=True)
class Excited:
    """Excitation of one effect, on all its targets or on one.

    Attributes:
        effect: name.
        parameter, unit: of its magnitude.
        smallest: value nearest to the identity that would be clear in this recording; None if none within bounds is.
        distance: length of the signature at the effect's default, in standard deviations.
        target: on which it is; None: on all of its targets.
        by_readings: whether it is measured on the readings alone (grids, repeats, noise), whatever the motion.
    """

    effect: str
    parameter: str
    unit: str
    smallest: float | None
    distance: float
    by_readings: bool = False
    target: str | None = None

    @property
    def visible(self) -> bool:
        """Whether some magnitude would be clearly visible."""
        return self.smallest is not None or self.by_readings

    @property
    def said(self) -> str:
        """Effect, and the target where it is meant on one."""
        return self.effect if self.target is None else f"{self.effect} on {self.target}"


@dataclass(frozen=True)
class Preflight:
    """Excited effects of recordings, and groups of them that cannot be distinguished.

    Attributes:
        robot: that was simulated.
        trials: number of recordings that were looked at.
        effects: in the library's order.
        alike: sets of effects that cannot be told apart at their default magnitudes, in these trials alone; where one
            target is meant, ``EFFECT on TARGET``.
        notes: what was not looked at, a sentence each.
    """

    robot: str
    trials: int
    effects: tuple[Excited, ...]
    alike: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def preflight(
    plant: Plant,
    trials: Sequence[Trial],
    *,
    usable: noise_model.Usable | None = None,
    threads: int = 0,
) -> Preflight:
    """Excitation of every effect by the commands of recordings, from simulations.

    Args:
        plant: the nominal simulator.
        trials: recordings.
        usable: channels that the lint trusts, of all trials or by their sources; None for all.
        threads: of the simulations.

    Raises:
        RecordingError: nothing was commanded, or nothing measured is of this robot.
    """
    if not any(trial.commands for trial in trials):
        raise RecordingError(f"{trials[0].source}: no command column: nothing can be replayed; add command.<actuator>")
    on = replay.grid(plant, trials)
    data = noise_model.collect(plant, trials, usable)
    if not data.channels:
        raise RecordingError(
            f"{trials[0].source}: no measured column is of this robot ({', '.join(plant.joints)}): give a map file"
        )
    predict = Predictor(plant, on, data, threads)
    everything = predict.all_trials([()], list(range(len(trials))), keep=True)[0]
    moved = np.nanstd(everything, axis=1).sum(axis=1)
    chosen = sorted(int(k) for k in np.argsort(-moved)[:TRIALS])
    base, part = everything[chosen], noise_model.select_trials(data, chosen)
    thinned = np.minimum(likelihood.independence(part, base), np.sqrt(min(plant.period / CORRELATED, 1.0)))
    nominal = _nominal(plant, on, threads)
    fastest = np.abs(nominal.velocity).max(axis=(0, 1))
    pool = [c for c in hypotheses.candidates(plant, None, fastest, sizes.sizes(plant, trials, nominal)) if not c.target]
    found, alike = signatures(predict, pool, chosen, thinned)
    return Preflight(plant.name, len(trials), found, alike)


def signatures(
    predict: Predictor, pool: Sequence[Candidate], trials: Sequence[int], weight: Array, *, firm: bool = False
) -> tuple[tuple[Excited, ...], tuple[tuple[str, ...], ...]]:
    """What each candidate changes, and which of those that are seen are alike.

    Args:
        predict: of explanations.
        pool: candidates; of those with the same effect and targets the one that is seen best counts.
        trials: indices of those that are looked at.
        weight: square root of what a sample of each channel counts for, (C,).
        firm: whether effects that are seen, but not at their default, are compared at :data:`FIRM` times what is clear.
    """
    chosen, part = list(trials), noise_model.select_trials(predict.data, trials)
    base = predict.all_trials([()], chosen, keep=True)[0]
    terms = sorted(hypotheses.terms(predict.plant), key=lambda term: term.per_trial)
    on_their_own = np.array([term.per_trial for term in terms], dtype=bool)
    responses = (predict.all_trials([(term.entry(NUISANCE_STEP),) for term in terms], chosen) - base) / NUISANCE_STEP
    frame = likelihood.frame(part, weight, responses, on_their_own)
    unfitted = only_read_off()
    found: dict[Label, Excited] = {}
    shapes: dict[str, Array] = {}
    with mujoco_log.counted():  # of models that are tried, which are not the user's
        for candidate in pool:
            if candidate.effect in unfitted:
                found[candidate.label] = Excited(
                    candidate.effect, candidate.parameter, candidate.unit, None, 0.0, by_readings=True
                )
                continue
            one, shape = _excited(predict, frame, candidate, chosen, base)
            if candidate.label not in found or one.distance > found[candidate.label].distance:
                length = max(float(np.linalg.norm(shape)), 1e-12)
                found[candidate.label], shapes[one.said] = one, shape * max(1.0, FIRM * CLEAR / length if firm else 0.0)
    seen = [one.said for one in found.values() if one.smallest is not None and (firm or one.distance >= CLEAR)]
    return tuple(found.values()), _alike(seen, shapes)


def _nominal(plant: Plant, on: replay.Grid, threads: int) -> replay.Signals:
    """The nominal replay, one row a trial."""
    nominal = replay.simulate(plant, on, [(k, ()) for k in range(len(on.trials))], replay.Run(threads))
    stability.check_nominal(plant, on, nominal)
    return nominal


def _excited(
    predict: Predictor, frame: likelihood.Frame, candidate: Candidate, trials: Sequence[int], base: Array
) -> tuple[Excited, Array]:
    """An effect's distances over its magnitudes, and its signature at the simulated magnitude nearest to its
    default."""
    values = np.array(sorted({*candidate.grid, _default(predict.plant, candidate)}))
    change = predict.all_trials([(candidate.entry(float(v)),) for v in values], trials) - base
    white = likelihood.whiten(frame.data, likelihood.mean_visible_change(frame.data, change), frame.weight).reshape(
        len(values), -1
    )
    left = white - linalg.cho_solve(frame.factor, frame.columns.T @ white.T).T @ frame.columns.T
    distance = np.sqrt(np.maximum((white * left).sum(axis=1), 0.0))
    at = int(np.argmin(np.abs(values - _default(predict.plant, candidate))))
    return (
        Excited(
            candidate.effect, candidate.parameter, candidate.unit, _smallest(candidate, values, distance),
            float(distance[at]), target=None if candidate.target is None else candidate.target[0],
        ),
        left[at],
    )  # fmt: skip


def _default(plant: Plant, candidate: Candidate) -> float:
    declared, targets = EFFECTS[candidate.effect], plant.wiring.targets
    parameter = declared.parameters[candidate.parameter]
    value = parameter.default[targets.side(declared.targets, targets.first(declared.targets, candidate.target))]
    if parameter.nominal is not None:
        value *= candidate.high / max(b for b in parameter.bounds[0] if np.isfinite(b))
    return float(np.clip(value, candidate.low, candidate.high))


def _smallest(candidate: Candidate, values: Array, distance: Array) -> float | None:
    """Magnitude nearest to that without effect, on either side, at which the signature is clear."""
    finite = bool(np.isfinite(candidate.identity))
    origin = candidate.identity if finite else candidate.high  # a limit: from loose to tight
    found = []
    for sign in (1.0, -1.0):
        side = sign * (values - origin) >= 0 if finite or sign < 0 else np.zeros(len(values), dtype=bool)
        size = np.abs(values[side] - origin)
        order = np.argsort(size)
        sizes, clear = size[order], np.maximum.accumulate(distance[side][order]) if side.any() else distance[side]
        if not len(sizes) or clear[-1] < CLEAR:
            continue
        k = int(np.argmax(clear >= CLEAR))
        low, at = (0.0, 0.0) if k == 0 else (float(sizes[k - 1]), float(clear[k - 1]))
        found.append(sign * (low + (float(sizes[k]) - low) * (CLEAR - at) / (float(clear[k]) - at)))
    return origin + min(found, key=abs) if found else None


def _alike(names: Sequence[str], shapes: dict[str, Array]) -> tuple[tuple[str, ...], ...]:
    """Groups of effects that cannot be distinguished: the difference of their signatures is not clear."""
    groups: list[set[str]] = []
    for k, a in enumerate(names):
        for b in names[k + 1 :]:
            x, y = shapes[a], shapes[b]
            size = max(float(np.linalg.norm(x) * np.linalg.norm(y)), 1e-12)
            left = np.sqrt(max(1 - (float(x @ y) / size) ** 2, 0.0))
            if max(np.linalg.norm(x), np.linalg.norm(y)) * left < CLEAR:
                touching = [g for g in groups if a in g or b in g]
                groups = [g for g in groups if g not in touching] + [{a, b}.union(*touching)]
    return tuple(tuple(sorted(g)) for g in groups)
