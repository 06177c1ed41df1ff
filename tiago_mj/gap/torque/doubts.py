"""Whether recorded efforts speak against numbers of the model that count as exact, or leave the choice.

A model's centres of mass and the constants of its motors are mostly right, and a search that may adjust them all the
same loses small loads among them. Where they are wrong, a search that may not adjust them puts encoders and motors in
their place. So they count as exact until what is left beside the best explanation is far more probable with than
without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS, Effect, Entry
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import terms
from tiago_mj.gap.inference.points import NUISANCE_STEP
from tiago_mj.gap.search import ranking
from tiago_mj.gap.torque.flexible import NOISES, functions, integrated, noise_beside, regression
from tiago_mj.gap.torque.measured import Array, clear
from tiago_mj.gap.torque.predictor import EffortPredictor

#: From this on numbers are doubted, and one explanation is as good as another up to this [nats]: a Bayes factor of 150,
#: "very strong" (Kass & Raftery 1995).
DECISIVE: Final = 5.0
#: Stages of effects that turn readings.
READINGS: Final = ("timing", "joint_sensor")
#: Share by which a magnitude is made smaller for the response to it.
SHRUNK: Final = 0.3
#: What a report says where numbers were doubted, and where they were not and could stand for what is named.
SAID: Final = (
    "Links' centres of mass within 5 % of their reach, torque constants within 5 % and springs of cables within 2 % of "
    "the effort explain far more of what the best explanation left, or as much as effects that stood in for them: they "
    "were adjusted within that, whatever is named."
)
IMITATED: Final = (
    "Links' centres of mass and torque constants counted as exact. Known to 5 % (of the reach) only, they would "
    "explain these recordings as well as what is named: where the model is no better, state it as the recordings' "
    "uncertainty and ask again."
)


@dataclass(frozen=True)
class Linear:
    """A linear model of efforts.

    Attributes:
        gap: what it has to explain, (ntrials, T, C) [N, N·m].
        columns: what each of its numbers does at one deviation, (k, ntrials, T, C) [N, N·m].
    """

    gap: Array
    columns: Array


def doubted(predict: EffortPredictor, trials: Sequence[int], best: Fitted) -> bool:
    """Whether what an explanation leaves is far more probable with the doubted numbers than without; or whether they
    explain about as much in the place of its effects on encoders and clocks, and of those that are doubted numbers
    themselves, each of which has its price, beside the others.

    Args:
        predict: predictions, and what was measured.
        trials: indices of those that may be looked at.
        best: the explanation.
    """
    exact = _beside(predict, trials, best, doubted=False)
    kept = [k for k, part in enumerate(best.parts) if not _stands_in(EFFECTS[part.effect])]
    fewer = replace(best, parts=tuple(best.parts[k] for k in kept), values=best.values[kept])
    if _gained(predict, trials, exact, _beside(predict, trials, best, doubted=True)) > DECISIVE:
        return True
    saved = ranking.MIN_EVIDENCE_GAIN_NATS * (len(best.parts) - len(kept))
    if not saved or not kept:
        return False
    return _gained(predict, trials, exact, _beside(predict, trials, fewer, doubted=True)) + saved > -DECISIVE


def _stands_in(declared: type[Effect]) -> bool:
    """Whether an effect may stand for numbers that are doubted."""
    return declared.stage in READINGS or declared.doubted_prior is not None


def imitated(predict: EffortPredictor, trials: Sequence[int], best: Fitted) -> bool:
    """Whether the doubted numbers alone explain about as much as an explanation without them; arguments as of
    :func:`doubted`."""
    nominal = replace(best, parts=(), values=np.zeros(0))
    named = _beside(predict, trials, best, doubted=False)
    return _gained(predict, trials, named, _beside(predict, trials, nominal, doubted=True)) > -DECISIVE


def _beside(predict: EffortPredictor, trials: Sequence[int], best: Fitted, *, doubted: bool) -> Linear:
    """The uncertain numbers beside an explanation whose magnitudes may move by all that they are."""
    some, effects = list(trials), best.effects()
    base = predict.all_trials([effects], some)[0]
    named = {(entry.name, target) for entry in effects for target in entry.target or (None,)}
    known = [
        term
        for term in terms(replace(predict.plant, doubted=doubted))
        if not term.per_trial and not named & {(term.effect, target) for target in (None, *(term.target or ()))}
    ]
    moved = predict.all_trials([(*effects, term.entry(NUISANCE_STEP)) for term in known], some)
    numbers = [(moved - base) / NUISANCE_STEP]
    if best.parts:
        numbers.append((predict.all_trials(_each_shrunk(best), some) - base) / SHRUNK)
    gap = np.where(clear(predict.data)[some], predict.data.value[some] - base, np.nan)
    return Linear(gap, np.concatenate(numbers))


def _each_shrunk(best: Fitted) -> list[tuple[Entry, ...]]:
    """An explanation with each of its magnitudes in turn a little closer to none."""
    out = []
    for k, part in enumerate(best.parts):
        values = np.array(best.values)
        values[k] += SHRUNK * (part.identity - values[k])
        out.append(replace(best, values=values).effects())
    return out


def _gained(predict: EffortPredictor, trials: Sequence[int], one: Linear, other: Linear) -> float:
    """Logarithm of how many times as probable another model makes the recordings [nats]: with and without free
    functions of position, speed and time, whichever noise there is. Rows count for less by how correlated is what the
    other model leaves."""
    gained = 0.0
    for c in range(len(predict.data.channels)):
        seen = np.isfinite(one.gap[..., c])
        each = [(linear.gap[..., c][seen], linear.columns[..., c][:, seen]) for linear in (one, other)]
        sizes = [float(np.sqrt(np.mean(gap**2))) if gap.size else 0.0 for gap, _ in each]
        if not min(sizes):
            continue
        free = functions(predict, trials, c)[:, seen]
        free *= sizes[0] / np.sqrt(len(free))
        models = [[columns, np.concatenate([columns, free])] for _, columns in each]
        rest = np.full(seen.shape, np.nan)
        rest[seen] = noise_beside(each[1][0], models[1])[1]
        counts = 1 / (ranking.SAMPLES_PER_INDEPENDENT * integrated(rest))
        tried = np.geomspace(NOISES[0] * min(sizes), NOISES[-1] * max(sizes), len(NOISES))
        before, after = (
            np.logaddexp.reduce(np.concatenate([regression(gap, columns, tried, counts)[0] for columns in several]))
            for (gap, _), several in zip(each, models, strict=True)
        )
        gained += float(after - before)
    return gained
