"""Whether what the best explanation of efforts leaves speaks against numbers that count as exact.

A model's centres of mass and the constants of its motors are mostly right, and a search that may adjust them all the
same loses small loads among them. Where they are wrong, a search that may not adjust them puts encoders and motors in
their place. So they count as exact until what is left beside the best explanation is far more probable with than
without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import Term, terms
from tiago_mj.gap.inference.points import NUISANCE_STEP
from tiago_mj.gap.search import ranking
from tiago_mj.gap.torque.flexible import NOISES, functions, integrated, noise_beside
from tiago_mj.gap.torque.measured import Array
from tiago_mj.gap.torque.predictor import EffortPredictor

#: From this on numbers are doubted [nats]: a Bayes factor of 150, "very strong" (Kass & Raftery 1995).
DOUBTED: Final = 5.0
#: Share by which a magnitude is made smaller for the response to it.
SHRUNK: Final = 0.3
#: What a report then says.
SAID: Final = (
    "What the best explanation left is far more probable where links' centres of mass are known to 5 % of their reach "
    "and torque constants to 5 %, so they were adjusted within that, whatever is named."
)


def doubts(predict: EffortPredictor, trials: Sequence[int], best: Fitted) -> float:
    """Logarithm of how many times as probable the doubted numbers make what an explanation leaves [nats].

    Of a linear model of what is left in each channel, with the uncertain numbers, with and without free functions of
    position, speed and time, whichever noise there is; rows count for less by how correlated is what they leave.

    Args:
        predict: predictions, and what was measured.
        trials: indices of those that may be looked at.
        best: the explanation.
    """
    data, some, effects = predict.data, list(trials), best.effects()
    usual = [term for term in terms(predict.plant) if not term.per_trial]
    named = {(entry.name, entry.target) for entry in effects}
    known = {(term.effect, term.target) for term in usual} | named
    more = [t for t in terms(replace(predict.plant, doubted=True)) if (t.effect, t.target) not in known]
    usual = [term for term in usual if (term.effect, term.target) not in named]

    def beside(asked: Sequence[Term]) -> Array:
        changed = predict.all_trials([(*effects, term.entry(NUISANCE_STEP)) for term in asked], some)
        return (changed - base) / NUISANCE_STEP

    base = predict.all_trials([effects], some)[0]
    own = np.concatenate([beside(usual), _shrunk(predict, some, best, base)])
    other, gap = beside(more), data.value[some] - base
    gained = 0.0
    for c in range(len(data.channels)):
        seen = np.isfinite(gap[..., c])
        size = float(np.sqrt(np.mean(gap[..., c][seen] ** 2))) if seen.any() else 0.0
        if not size:
            continue
        free = functions(predict, some, c)
        usually = [own[..., c], np.concatenate([own[..., c], size / np.sqrt(len(free)) * free])]
        doubted = [np.concatenate([one, other[..., c]]) for one in usually]
        rest = np.full(seen.shape, np.nan)
        rest[seen] = noise_beside(gap[..., c][seen], [one[:, seen] for one in doubted])[1]
        counts = 1 / (ranking.SAMPLES_PER_INDEPENDENT * integrated(rest))
        before, after = (
            np.logaddexp.reduce([_evidence(gap[..., c][seen], one[:, seen], counts) for one in models])
            for models in (usually, doubted)
        )
        gained += float(after - before)
    return gained


def _shrunk(predict: EffortPredictor, trials: Sequence[int], best: Fitted, base: Array) -> Array:
    """What the whole of each magnitude does, to first order, (k, ntrials, T, C)."""
    fewer = []
    for k, part in enumerate(best.parts):
        values = np.array(best.values)
        values[k] += SHRUNK * (part.identity - values[k])
        fewer.append(replace(best, values=values).effects())
    return (predict.all_trials(fewer, trials) - base) / SHRUNK


def _evidence(gap: Array, columns: Array, counts: float) -> float:
    """Log evidence of a linear model with normal weights of deviation 1 and a noise of any size (Bishop 2006, section
    3.5), rows counting as so many each.

    Args:
        gap: (n,).
        columns: (k, n).
        counts: of a row.
    """
    tried = np.sqrt(np.mean(gap**2)) * NOISES
    axes, stretch, _ = np.linalg.svd(columns.T, full_matrices=False)
    along, power = counts * (axes.T @ gap) ** 2, counts * stretch**2
    rest = max(counts * float(gap @ gap) - float(along.sum()), 0.0)
    total = power + tried[:, None] ** 2
    sizes = np.log(total).sum(axis=1) + (counts * len(gap) - len(power)) * 2 * np.log(tried)
    each = -0.5 * (sizes + (along / total).sum(axis=1) + rest / tried**2)
    return float(np.logaddexp.reduce(each) - np.log(len(tried)))
