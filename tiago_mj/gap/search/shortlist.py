"""Which explanations go on: the lists between the passes of a search, the best first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import Label
from tiago_mj.gap.search import starts
from tiago_mj.gap.search.screen import Screened

#: Single effects fitted to the trials of the first pass, the same where time has run out, and number refitted to all
#: trials. Chosen by hand; no ablation.
MAX_SINGLES: Final = 10
MIN_SINGLES: Final = 3
MAX_REFITTED_SINGLES: Final = 4
#: Where the first pass gains this much [nats], effects that gain less than this share of the most are not fitted. Of 46
#: cases the right one was the best in 30, never behind 0.9 of it but where little was gained, and once 0.6.
DECISIVE_GAIN_NATS: Final = 10.0
MIN_SHARE_OF_BEST_GAIN: Final = 0.4
#: Where no gain is decisive, effects whose gain is this much below the largest are not fitted, apart from the first few
#: [nats]. Chosen by hand; no ablation.
MAX_GAIN_DEFICIT_NATS: Final = 5.0
#: Further single effects within this of the best are refitted to all trials, too [nats]. Chosen by hand; no ablation.
TIE_NATS: Final = 2.0
#: Where the nominal model is adequate, a single effect is refitted only where its extrapolated evidence on all trials
#: exceeds the nominal model's by this [nats]. Chosen by hand; no ablation.
MIN_EXPECTED_GAIN_NATS: Final = 1.0
#: Fits of one explanation begun at different places end this far apart where contacts are (five contact cases of the
#: blind check, three starts each: 50 to 200): what is farther behind than that is not fitted to more trials [nats].
HOPELESS_DEFICIT_NATS: Final = 200.0
#: Evidence that another effect must add to be worth showing [nats]: a Bayes factor of 150, "very strong" (Kass &
#: Raftery 1995).
MIN_EVIDENCE_GAIN_NATS: Final = 5.0
#: Discrepancy that noise alone leaves; below it, less is no better.
NOISE_DISCREPANCY: Final = 1.0
#: Smallest distance of a magnitude from its identity at which an effect is reported, whatever its evidence
#: [deviations]: ten nats correspond to 4.5. Of 111 effects that were rightly named on unseen recordings the nearest was
#: at 3.5.
MIN_MAGNITUDE_DEVIATIONS: Final = 2.5


def by_evidence(fits: Sequence[Fitted]) -> list[Fitted]:
    """The likeliest first."""
    return sorted(fits, key=lambda f: -f.evidence)


def best_nominal(fits: Sequence[Fitted]) -> Fitted:
    """The best without effects."""
    return max((f for f in fits if not f.parts), key=lambda f: f.evidence)


def unique_by_labels(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best of fits of the same effects on the same targets: found twice, an explanation is no likelier."""
    best: dict[frozenset[object], Fitted] = {}
    for fit in fits:
        best.setdefault(frozenset(part.label for part in fit.parts), fit)
    return list(best.values())


def unique_by_classes(fits: Sequence[Fitted]) -> list[Fitted]:
    """The first fit of every set of effect classes: others of the same classes have similar predictions."""
    best: dict[frozenset[str], Fitted] = {}
    for fit in fits:
        best.setdefault(frozenset(EFFECTS[part.effect].gap_class for part in fit.parts), fit)
    return list(best.values())


def singles_to_fit(screened: Sequence[Screened], count: int, moved: Sequence[Label] = ()) -> list[Screened]:
    """The best of every effect, then of every effect and target; no more than half of them of one class, so that rivals
    get their chance. Beyond ``count`` the effects, by label, that change what the nominal model's numbers were moved
    for: beside those numbers they gain nothing."""
    out: list[Screened] = []
    seen: set[object] = set()
    classes: dict[str, int] = {}
    first = dict.fromkeys(s.candidate.effect for s in screened)
    leaders = {effect: next(s for s in screened if s.candidate.effect == effect) for effect in first}
    most = max((s.gain for s in screened), default=0.0)
    for s in (*leaders.values(), *screened):
        gap_class = EFFECTS[s.candidate.effect].gap_class
        if (
            s.gain
            < max(MIN_SHARE_OF_BEST_GAIN * most if most > DECISIVE_GAIN_NATS else most - MAX_GAIN_DEFICIT_NATS, 0.0)
            and len(out) >= MIN_SINGLES
        ):
            continue
        if s.candidate.label in seen or classes.get(gap_class, 0) >= count // 2:
            continue
        seen.add(s.candidate.label)
        classes[gap_class] = classes.get(gap_class, 0) + 1
        out.append(s)
        if len(out) == count:
            break
    return out + [next(s for s in screened if s.candidate.label == label) for label in moved if label not in seen]


def singles_to_refit(fits: Sequence[Fitted], times: float) -> list[Fitted]:
    """Of single effects, best first: the first few, and whatever cannot be told from the best; without those that are
    hopelessly behind it when so many times as many trials are met as well as these."""
    near = [f for k, f in enumerate(fits) if k < MAX_REFITTED_SINGLES or f.evidence > fits[0].evidence - TIE_NATS]
    return [
        f
        for f in near
        if extrapolated_evidence(f, times) > extrapolated_evidence(fits[0], times) - HOPELESS_DEFICIT_NATS
    ]


def extrapolated_evidence(fit: Fitted, times: float) -> float:
    """Evidence for an explanation if it met so many times as many trials as well as these [nats]."""
    return times * (fit.evidence - fit.prior) + fit.prior


def expected_to_beat_nominal(fits: Sequence[Fitted], none: Fitted, times: float) -> list[Fitted]:
    """Those that would be likelier than ``none``, a nominal model that leaves nothing to explain, if they met so many
    times as many trials as well as these."""
    return [
        f for f in fits if extrapolated_evidence(f, times) - extrapolated_evidence(none, times) > MIN_EXPECTED_GAIN_NATS
    ]


def reportable(fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations of which every effect is significant, and which have more evidence and no larger discrepancy than
    those by subsets of their effects."""
    each = {frozenset(p.label for p in f.parts): f for f in fits}
    out = []
    for f in fits:
        labels = frozenset(p.label for p in f.parts)
        fewer = [other for parts, other in each.items() if parts and parts < labels]
        adds = all(
            f.evidence - other.evidence > MIN_EVIDENCE_GAIN_NATS
            and discrepancy(f) <= max(discrepancy(other), NOISE_DISCREPANCY)
            for other in fewer
        )
        if adds and all(_is_significant(f, k) for k in range(len(f.parts))):
            out.append(f)
    return out


def discrepancy(fit: Fitted) -> float:
    """Discrepancy of an explanation: the larger of its mean squares by samples and over blocks (1 is expected)."""
    return max(fit.misfit, fit.lasting)


def _is_significant(fit: Fitted, part: int) -> bool:
    """Whether a magnitude is not next to none; what is drawn at random is told by what was drawn, not by how often."""
    candidate = fit.parts[part]
    return (
        bool(candidate.selection_penalty)
        or candidate.spread is not None
        or starts.differs_from_identity(fit, part, MIN_MAGNITUDE_DEVIATIONS)
    )
