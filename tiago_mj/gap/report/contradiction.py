"""No result contradicts itself: checked before it is drawn or written.

:func:`contradictions` says what does not go together, and :func:`checked` is what every writer takes: reconciled, and
with a note where something is left. Arithmetic that is wrong (a share below 0, a trial in two splits) gives way to
nothing: it is a fault, and told as one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import STAGES
from tiago_mj.gap.analysis.shrink import NOTHING
from tiago_mj.gap.report.consistency import NAMING, can_close, closes, is_known, must_remain, reconciled, refuted
from tiago_mj.gap.report.part import explains_part
from tiago_mj.gap.result import CARRIERS, KINDS, SHAPES, Diagnosis, Shrink, identity

#: Shares and sums agree to this: files have six digits, and intervals of shares are to a hundredth.
AGREE: Final = 2e-3
#: Begins the note on what could not be reconciled.
FAULT: Final = "A fault of this program: what this report says does not go together"


def checked(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis that does not contradict itself, or that says in a note that it does. Once is enough."""
    found = reconciled(diagnosis)
    wrong = contradictions(found)
    if not wrong or any(note.startswith(FAULT) for note in found.notes):
        return found
    return replace(found, notes=(*found.notes, f"{FAULT} ({'; '.join(wrong)})."))


def contradictions(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What does not go together in a diagnosis, one clause each; empty where everything does. What is not known
    contradicts nothing."""
    checks = (_verdict, _probabilities, _left, _closings, _intervals, _shares, _gains, _trials)
    return tuple(said for check in checks for said in check(diagnosis))


def _verdict(d: Diagnosis) -> Iterator[str]:
    if d.kind not in KINDS:
        yield f"{d.kind} is no verdict"
    if d.kind == "no_gap" and d.best.effects:
        yield "there is no gap, and yet effects are named"
    if d.kind in NAMING and not d.best.effects:
        yield f"the verdict is {d.kind}, and no effect is named"
    if d.kind in NAMING and d.best.evidence is not None and d.best.evidence.edge:
        yield "what is named is at the bound of what is possible"
    names = [identity(one) for one in d.alternatives]
    if d.kind == "ambiguous" and len(set(names)) < 2:
        yield "the verdict is ambiguous, and there is one explanation"
    if len(set(names)) < len(names):
        yield "an alternative is told twice"
    if names and names[0] != identity(d.best):
        yield "the first of the alternatives is not the best explanation"
    if d.next_motion is not None and d.kind != "ambiguous":
        yield "a next motion is to decide where nothing is ambiguous"
    if d.stage is not None and d.stage not in STAGES:
        yield f"{d.stage} is no stage of the signal chain"
    if named := sorted({e.name for one in (d.best, *d.alternatives) for e in one.effects} & set(d.not_excited)):
        yield f"{named[0]} is named, and said not to be excited"


def _probabilities(d: Diagnosis) -> Iterator[str]:
    every = [("the best", d.best), *(("an alternative", a) for a in d.alternatives), *(("a row", r) for r in d.ranking)]
    for what, one in every:
        if is_known(one.probability) and not 0 <= one.probability <= 1:
            yield f"{what} has a probability of {one.probability:.3g}"
    by_class: dict[frozenset[str], float] = {}
    for one in d.ranking:
        classes = frozenset(EFFECTS[e.name].gap_class if e.name in EFFECTS else e.name for e in one.effects)
        by_class.setdefault(classes, one.probability)
    if math.fsum(p for p in by_class.values() if is_known(p)) > 1 + AGREE:
        yield "the probabilities of all classes are more than 1 together"
    row = next((one for one in d.ranking if identity(one) == identity(d.best)), None)
    both = (d.best.probability, d.best.probability if row is None else row.probability)
    if is_known(*both) and abs(both[1] - both[0]) > AGREE:
        yield "the best has another probability in the ranking"
    if d.kind in NAMING and refuted(d):
        yield "what is named with a probability closes nothing on trials that were kept aside"


def _left(d: Diagnosis) -> Iterator[str]:
    if d.verdict.part and not (d.kind in NAMING and explains_part(d.shrink)):
        yield "what is named is told as part of the cause, and leaves nothing"
    if d.kind == "no_gap" and d.remains:
        yield "there is no gap, and yet something remains"
    if d.remains_where and not d.remains:
        yield "nothing remains, and yet a place of it is told"
    if not d.remains and must_remain(d):
        yield "a gap above the noise is left, and not said to remain"
    yield from _shape(d)


def _shape(d: Diagnosis) -> Iterator[str]:
    shape = d.residual_shape
    if shape is None:
        return
    if not (d.remains or d.kind == "unknown"):
        yield "nothing remains, and yet the shape of it is told"
    if shape.name not in SHAPES or shape.runner_up not in (None, *SHAPES):
        yield f"{shape.name} or {shape.runner_up} is no shape"
    if shape.carrier not in CARRIERS:
        yield f"{shape.carrier} carries no residual"
    if set(shape.stages) - set(STAGES) or (d.kind == "unknown" and shape.stage != d.stage):
        yield f"what is left sits in {shape.stages}, and the stage is {d.stage}"
    if any(is_known(one) and not 0 <= (one or 0.0) <= 1 for one in (shape.share, shape.runner_up_share)):
        yield "a shape explains a share of what is left that is not between 0 and 1"


def _closings(d: Diagnosis) -> Iterator[str]:
    shrink = d.shrink
    for what, before, after, closed, _, _ in _parts(shrink):
        for side, gap in (("before", before), ("after", after)):
            if gap is not None and is_known(gap) and gap < 0:
                yield f"{what} has a gap of {gap:.3g} {side}"
        if before is None or after is None or not is_known(before, after):
            continue
        if not d.best.effects and abs(after - before) > AGREE * max(before, 1.0):
            yield f"nothing is named, and yet the gap of {what} changes from {before:.3g} to {after:.3g}"
        if closed is None or not is_known(closed):
            continue
        excess = before - shrink.floor
        if excess <= NOTHING * (1 - AGREE):
            yield f"{what} has no gap to close, and {closed:.3g} of it is closed"
            continue
        share = 1 - (max(after, shrink.floor) - shrink.floor) / excess
        if abs(share - closed) > AGREE * max(1.0, abs(share), 1e-2 * before / excess):
            yield f"{closed:.3g} of the gap of {what} is closed, but {before:.4g} and {after:.4g} say {share:.3g}"
    if shrink.with_numbers is not None and not d.numbers:
        yield "there are no numbers as fitted, and yet it is told what they leave"
    if d.best.effects and closes(shrink) is False and not can_close(d):
        yield "what need not close any of the gap is told to close nothing"


def _intervals(d: Diagnosis) -> Iterator[str]:
    for what, _, _, closed, low, high in _parts(d.shrink):
        yield from _within(f"the closed share of {what}", closed, low, high)
    whole = d.shrink.with_numbers
    if whole is not None:
        yield from _within("the closed share with numbers", whole.closed, whole.low, whole.high)
    for number in d.numbers:
        yield from _within(f"{number.parameter} of {number.name}", number.value, number.low, number.high)
    for place in (*d.where, *d.remains_where):
        yield from _within(f"the gap of {place.channel} during {place.phase}", place.gap, place.low, place.high)
    for one in (d.best, *d.alternatives, *d.ranking):
        for effect in one.effects:
            for key, value in effect.parameters.items():
                yield from _within(f"{key} of {effect.name}", value.value, value.low, value.high)


def _shares(d: Diagnosis) -> Iterator[str]:
    for name, places in (("the gap", d.where), ("what remains", d.remains_where)):
        shares = [place.share for place in places if is_known(place.share)]
        total = math.fsum(shares)
        if any(not -AGREE <= share <= 1 + AGREE for share in shares):
            yield f"a share of {name} is not between 0 and 1"
        if total > 1 + AGREE or (places is d.where and shares and AGREE < total < 1 - AGREE):
            yield f"the shares of {name} are {total:.3g} together"


def _gains(d: Diagnosis) -> Iterator[str]:
    for one in d.ranking:
        if not one.effects and is_known(one.validation_gain) and abs(one.validation_gain) > AGREE:
            yield f"the nominal simulator, nothing added, has a validation gain of {one.validation_gain:.3g}"


def _trials(d: Diagnosis) -> Iterator[str]:
    names = [name for trials in d.splits.values() for name in trials]
    if len(set(names)) < len(names):
        yield "a trial is in two splits"
    test, shrink = d.splits.get("test", ()), d.shrink
    if not test and any(is_known(x) for x in (shrink.before, shrink.after, shrink.closed)):
        yield "no trial was kept aside, and yet a gap is told of those"
    played = set((shrink.task or {}).get("trials") or {})
    if played - set(test):
        yield "a return is told of a trial that was not kept aside"
    counted = re.match(r"(\d+) test trials", shrink.resampled)
    if counted and test and int(counted[1]) != len(test):
        yield f"{counted[1]} test trials were drawn, of {len(test)}"
    if d.complete and d.stopped is not None:
        yield "the search came to its end, and was ended before"


def _parts(
    shrink: Shrink,
) -> Iterable[tuple[str, float | None, float | None, float | None, float | None, float | None]]:
    """(what, before, after, closed, low, high) of everything that has a gap before and after."""
    yield "all channels", shrink.before, shrink.after, shrink.closed, shrink.low, shrink.high
    groups = [("", shrink.per_channel), ("", shrink.per_phase)]
    groups += [(f"{name} during ", places) for name, places in shrink.per_place.items()]
    for prefix, parts in groups:
        for name, one in parts.items():
            yield prefix + name, one.before, one.after, one.closed, one.low, one.high


def _within(what: str, value: float | None, low: float | None, high: float | None) -> Iterator[str]:
    if value is None or not is_known(value):
        return
    slack = 1e-5 * max(abs(value), 1e-9)
    if (low is not None and value < low - slack) or (high is not None and value > high + slack):
        yield f"{what}, {value:.4g}, is not within its interval"
