"""Between the rounds of a search: what samples tell, what an explanation leaves, and which fits go on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import ensemble, second_parameter, shortlist, starts
from tiago_mj.gap.search.extend import MIN_PREDICTED_GAIN_NATS

Array = NDArray[np.float64]

#: Model errors repeat from trial to trial: so many samples count as one, beyond their correlation in time. Chosen by
#: hand; no ablation.
SAMPLES_PER_INDEPENDENT: Final = 2.0
#: Discrepancy (mean squared residual of the worst channel, by samples or over blocks, 1 expected) above which another
#: effect is sought. Chosen by hand; no ablation.
INADEQUATE_DISCREPANCY: Final = 4.0
#: Discrepancy up to which an explanation is adequate (1 is expected; true explanations leave 0.7 to 3 where nominal
#: numbers are 3 to 5 % off).
ADEQUATE_DISCREPANCY: Final = 1.2
#: Log-prior below which the nuisances of an adequate fit may stand for an effect [nats]: adequate nominal models
#: without one have -3 to -14.
MIN_LOG_PRIOR_NATS: Final = -18.0
#: Explanations, the best first, that are fitted with responses linearized at themselves. Chosen by hand; no ablation.
MAX_RELINEARIZED: Final = 3
#: Further rounds of relinearization for explanations between ADEQUATE_DISCREPANCY and HOPELESS_DISCREPANCY, as long as
#: a round gains MIN_ROUND_GAIN_NATS [nats]: with slipping contacts each round moves a short way. Chosen by hand; no
#: ablation.
MAX_FURTHER_ROUNDS: Final = 6
MIN_ROUND_GAIN_NATS: Final = 3.0
HOPELESS_DISCREPANCY: Final = 2 * INADEQUATE_DISCREPANCY
#: An ensemble fit is made where the discrepancy of the best explanation lies between the first and the last of these
#: and below the given share of the nominal model's: the fit may then have ended early. Of kept cases of the blind check
#: four with the right name were unknown for that, with shares of 0.00003 to 0.0057, and six of 38 whose effect the
#: library lacks had such a share.
ENSEMBLE_MIN_DISCREPANCY: Final = 2.0
ENSEMBLE_MAX_SHARE_OF_NOMINAL: Final = 0.006
ENSEMBLE_MAX_DISCREPANCY: Final = 8 * INADEQUATE_DISCREPANCY


def sample_weight(data: Data, predicted: Array) -> Array:
    """Square root of the weight of a sample of each channel, given the residuals of a prediction, (C,)."""
    return likelihood.independence(data, predicted) / np.sqrt(SAMPLES_PER_INDEPENDENT)


def frame(fitter: Fitter, at: Point) -> likelihood.Frame:
    """What likelihoods of some trials are told by, beside nominal numbers."""
    return likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, at.nuisance)


def is_adequate(fit: Fitted, most: float = ADEQUATE_DISCREPANCY) -> bool:
    """Whether the discrepancy is at most ``most`` and the log-prior exceeds :data:`MIN_LOG_PRIOR_NATS`."""
    return not leaves_gap(fit, most) and fit.prior > MIN_LOG_PRIOR_NATS


def leaves_gap(fit: Fitted, most: float = INADEQUATE_DISCREPANCY) -> bool:
    """Whether the discrepancy exceeds ``most``; by default, whether it calls for another effect."""
    return shortlist.discrepancy(fit) > most


def nominal_and_best(fits: Sequence[Fitted]) -> list[Fitted]:
    """The nominal model and the best explanations, each once."""
    best = shortlist.unique_by_labels(shortlist.by_evidence([f for f in fits if f.parts]))
    return [shortlist.best_nominal(fits), *best[: shortlist.MAX_REFITTED_SINGLES]]


def without_departing_trials(everywhere: Fitter, fits: list[Fitted], at: Array) -> tuple[Fitter, list[Fitted], Array]:
    """The same without excluded trials: those in which a motion departs from what the best explanation predicts. No
    parameter of the model reproduces such a motion, and it would bias the fits of all explanations."""
    best = everywhere.predictions([starts.point_of(shortlist.by_evidence(fits)[0])])[0]
    departing = likelihood.departing_trials(everywhere.data, everywhere.data.value - best)
    if not departing.any() or everywhere.out_of_time():
        return everywhere, fits, at
    kept = [k for k, one in enumerate(departing) if not one]
    rest = everywhere.part(kept)
    begin = [Start(f.parts, f.values, everywhere.of(kept, f.nuisance)) for f in nominal_and_best(fits)]
    return rest, rest.fit_all(begin), everywhere.of(kept, at)


def relinearized(everywhere: Fitter, fits: Sequence[Fitted], size: int = 0) -> list[Fitted]:
    """The same, with what draws lead the best to, and with the nuisances' responses around each where that may decide:
    near the best, of so many effects at least, and the best by fewer effects; not where the best is no more than a
    nominal number a little off."""
    best, nominal = shortlist.by_evidence(fits)[0], shortlist.best_nominal(fits)
    if best.evidence - nominal.evidence < MIN_PREDICTED_GAIN_NATS and is_adequate(nominal):
        return list(fits)
    fits = [*fits, *_ensemble_fits(everywhere, best, nominal)]
    best = shortlist.by_evidence(fits)[0]
    least = best.evidence - (
        starts.LOCAL_OPTIMUM_NATS if leaves_gap(best, ADEQUATE_DISCREPANCY) else starts.NEAR_BEST_NATS
    )
    near = shortlist.unique_by_labels(
        shortlist.by_evidence([f for f in fits if len(f.parts) >= max(size, 1) and f.evidence > least])
    )
    near = near[:MAX_RELINEARIZED]
    begin = [(starts.restart(f), ADEQUATE_DISCREPANCY) for f in near]
    # Nuisance parameters fitted without the effect may have absorbed it: a local optimum. So start at zero, too.
    begin += [(Start(f.parts, f.values, np.zeros(everywhere.size)), ADEQUATE_DISCREPANCY) for f in near[:1]]
    # What is left of fewer effects must not look like another one because their fit stopped short.
    for f in [f for f in shortlist.by_evidence(fits) if 0 < len(f.parts) < len(best.parts)][:1]:
        begin.append((Start(f.parts, f.values, f.nuisance, ((f.values, best.nuisance),)), 0.0))
    return [*fits, *_relinearized_in_rounds(everywhere, begin)]


def _ensemble_fits(everywhere: Fitter, best: Fitted, nominal: Fitted) -> list[Fitted]:
    """What draws lead the best explanation to, where something is touched, it fails, and yet explains nearly all."""
    drawn = bool(best.parts) and everywhere.per_trial.any() and not everywhere.out_of_time()
    if drawn and ENSEMBLE_MIN_DISCREPANCY < shortlist.discrepancy(best) < min(
        ENSEMBLE_MAX_DISCREPANCY, ENSEMBLE_MAX_SHARE_OF_NOMINAL * shortlist.discrepancy(nominal)
    ):
        return [ensemble.fitted(everywhere, best)]
    return []


def _relinearized_in_rounds(everywhere: Fitter, begin: Sequence[tuple[Start, float]]) -> list[Fitted]:
    """Fits with the nuisances' responses around where each begins, and again around where it ended, until it leaves no
    more than its number or a round brings little; side by side."""
    best: dict[int, Fitted] = {}
    going = {k: start for k, (start, _) in enumerate(begin)}
    for _ in range(MAX_FURTHER_ROUNDS + 1):
        fitters = everywhere.linearized_at_each([starts.point_of(start) for start in going.values()])
        there = zip(going, everywhere.fit_each(fitters, list(going.values())), strict=True)
        better = {k: fit for k, fit in there if k not in best or fit.evidence >= best[k].evidence + MIN_ROUND_GAIN_NATS}
        best |= better
        unfinished = [
            k for k, fit in better.items() if leaves_gap(fit, begin[k][1]) and not leaves_gap(fit, HOPELESS_DISCREPANCY)
        ]
        going = {k: starts.restart(better[k]) for k in unfinished}
        if not going or everywhere.out_of_time():
            break
    return list(best.values())


def refined(everywhere: Fitter, fits: Sequence[Fitted], others: Sequence[Fitted]) -> list[Fitted]:
    """Of some explanations with better second numbers and forms."""
    best = shortlist.by_evidence(others)[0]
    return second_parameter.refined(everywhere, fits, best, fails=leaves_gap(best))
