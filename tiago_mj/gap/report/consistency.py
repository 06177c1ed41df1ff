"""What a result says of the gap, and what gives way where two things of it cannot stand beside each other.

:func:`reconciled` is the one place where a verdict gives way to what is beside it. Writers take a result that is
:func:`tiago_mj.gap.report.contradiction.checked`.

What gives way to what:

    an effect that closes nothing on trials kept aside, by itself or with the simulator's own numbers as they were
    fitted, is not named: what it explains is told as what is known (``unknown``)
    an effect at the bound of what is possible is not named (``unknown``)
    "no gap" that leaves more than noise with everything accounted for is ``unknown``, where no contact is measured
    a verdict that names nothing, or one of a set, is what its effects and alternatives make it
    what is named leaves more than noise and a share of the gap on trials kept aside: it is told as a part of the cause
    with "no gap" nothing remains; only what is ambiguous has a next motion
    what is left has a shape only where something is; with "unknown" the stage is that of the shape
    what is unknown and has no effect, or leaves more than noise with everything accounted for, remains
    that nothing is closed is not told of effects that show in the readings alone: they need not close any of it
    gains are against the nominal simulator as it was fitted, which itself gains nothing
    what is named was excited
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.analysis.promises import CLOSES, MIN_NAMED_PROBABILITY
from tiago_mj.gap.analysis.remainder import LEFT
from tiago_mj.gap.analysis.shrink import gone
from tiago_mj.gap.decision.verdict import most_probable
from tiago_mj.gap.report.part import explains_part
from tiago_mj.gap.result import (
    Closing,
    Diagnosis,
    Explanation,
    Remains,
    ResidualShape,
    Shrink,
    identity,
)

#: Kinds of a verdict that names effects.
NAMING: Final = ("effect", "ambiguous")


# What a result says ---------------------------------------------------------------------------------------------------


def can_close(diagnosis: Diagnosis) -> bool:
    """Whether what is named has to close some of the gap if it is right: not what is drawn at random, and not what was
    measured on the readings alone, and so is part of every explanation."""
    rows = [set(identity(one)) for one in diagnosis.ranking]
    everywhere = set.intersection(*rows) if len(rows) > 1 else set()
    known = [EFFECTS[e.name] for e in diagnosis.best.effects if e.name in EFFECTS]
    by_chance = any(declared.by_chance for declared in known)
    # What rounds readings does no more than its grid: of one alone a closed share says nothing.
    rounds = bool(known) and all(declared.rounds for declared in known)
    return not (by_chance or rounds) and any((e.name, e.target) not in everywhere for e in diagnosis.best.effects)


def closes(shrink: Shrink) -> bool | None:
    """Whether a gap is closed on trials that were kept aside, by more than counts as nothing; None: not known."""
    return None if not is_known(shrink.closed) else (shrink.closed or 0.0) > CLOSES


def repairs(shrink: Shrink) -> bool | None:
    """Whether the whole repair, effects and numbers as fitted, closes a gap on trials that were kept aside; None: not
    known."""
    whole = shrink.with_numbers
    return closes(shrink) if whole is None or whole.closed is None else whole.closed > CLOSES


def closed_accounted(shrink: Shrink) -> float | None:
    """Share of the squared residual that is gone with the model's own numbers as fitted, before and after, in units of
    the noise or, where that is more, of noise and tolerance; None: not known."""
    before, after = shrink.accounted_before, shrink.accounted
    if before is None or after is None or not is_known(before, after):
        return None
    share = gone(before, after)
    return share if shrink.weighed is None else max(share, shrink.weighed)


def has_probability(diagnosis: Diagnosis) -> bool:
    """Whether a page gives the probability of a cause: where one is named, and where trials were kept aside on which
    there is a gap, it closes some of that for sure."""
    shrink = diagnosis.shrink
    if diagnosis.kind not in NAMING or not diagnosis.best.effects or not is_known(diagnosis.best.probability):
        return False
    return closes(shrink) is not False and not (is_known(shrink.low) and (shrink.low or 0.0) <= 0)


def loudest(shrink: Shrink) -> tuple[str, str, Closing] | None:
    """(channel, phase, gap) of what leaves most after the repair, if that is more than noise; empty: all of them."""
    parts = [
        *(("", phase, one) for phase, one in shrink.per_phase.items()),
        *((channel, "", one) for channel, one in shrink.per_channel.items()),
        *((channel, phase, one) for channel, places in shrink.per_place.items() for phase, one in places.items()),
    ]
    loud = [part for part in parts if part[2].after > LEFT * shrink.floor]
    return max(loud, key=lambda part: part[2].after, default=None)


# What gives way -------------------------------------------------------------------------------------------------------


def reconciled(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis in which what cannot stand beside each other has given way, as this module's head says."""
    found = _with_its_kind(diagnosis)
    if found.kind == "no_gap":
        found = found.with_verdict(remains=Remains(False, found.remains_where))
    if found.kind != "ambiguous":
        found = replace(found, next_motion=None)
    if found.best.effects and not can_close(found) and closes(found.shrink) is False:
        found = replace(found, shrink=_closing_nothing(found.shrink))
    if not found.remains and must_remain(found):
        found = found.with_verdict(remains=Remains(True, found.remains_where))
    if found.residual_shape is not None:
        found = _with_its_shape(found, found.residual_shape)
    named = {effect.name for one in (found.best, *found.alternatives) for effect in one.effects}
    return found.with_verdict(
        alternatives=_best_first(found),
        remains=found.verdict.remains if found.remains else Remains(),
        part=found.kind in NAMING and explains_part(found.shrink),
        not_excited=tuple(name for name in found.not_excited if name not in named),
    )


def _with_its_shape(diagnosis: Diagnosis, shape: ResidualShape) -> Diagnosis:
    """With the shape of what is left only where something is, and a stage that goes with it where nothing is named."""
    if not (diagnosis.remains or diagnosis.kind == "unknown"):
        return replace(diagnosis, residual_shape=None)
    return replace(diagnosis, stage=shape.stage) if diagnosis.kind == "unknown" else diagnosis


def must_remain(diagnosis: Diagnosis) -> bool:
    """Whether a gap is left that has to be said to remain."""
    if diagnosis.kind == "no_gap" or not diagnosis.complete:
        return False
    nothing = diagnosis.kind == "unknown" and not diagnosis.best.effects
    return nothing or leaves_more(diagnosis.shrink)


def leaves_more(shrink: Shrink) -> bool:
    """Whether more than noise is left on trials that were kept aside, with the model's own numbers as fitted."""
    return shrink.accounted is not None and is_known(shrink.accounted) and shrink.accounted > LEFT


def leaves_a_gap(shrink: Shrink) -> bool:
    """Whether the nominal model with its own numbers as fitted leaves a gap, so that "no gap" is no answer.

    Not where contact forces are measured: the numbers of a contact, fitted to few grasps, do not predict another one to
    the noise of a force. Four cases of the slow tests without a visible effect (seed 12, three grasps of 1 s at 240 Hz)
    left 5.7 to 9.2 noise variances.
    """
    return leaves_more(shrink) and not any(channel.startswith("force.") for channel in shrink.per_channel)


def _with_its_kind(diagnosis: Diagnosis) -> Diagnosis:
    """With the kind that its effects, its alternatives and the trials kept aside allow."""
    best = diagnosis.best
    if diagnosis.kind not in NAMING:
        gap = diagnosis.kind == "no_gap" and (best.effects or leaves_a_gap(diagnosis.shrink))
        return diagnosis.with_verdict(kind="unknown") if gap else diagnosis
    if not best.effects or refuted(diagnosis) or (best.evidence is not None and best.evidence.edge):
        return diagnosis.with_verdict(kind="unknown")
    if diagnosis.kind == "ambiguous" and len({identity(one) for one in (best, *diagnosis.alternatives)}) < 2:
        likely = not best.probability < MIN_NAMED_PROBABILITY * most_probable(best, replays=diagnosis.replays)
        return diagnosis.with_verdict(kind="effect" if likely else "unknown")
    return diagnosis


def refuted(diagnosis: Diagnosis) -> bool:
    """Whether what is named with a probability closes nothing on trials kept aside, whatever is accounted for."""
    shrink = diagnosis.shrink
    if closes(shrink) is not False or not is_known(diagnosis.best.probability) or not can_close(diagnosis):
        return False
    return (closed_accounted(shrink) or 0.0) <= CLOSES


def _closing_nothing(shrink: Shrink) -> Shrink:
    """Before and after, without shares that are closed."""

    def without(parts: Mapping[str, Closing]) -> dict[str, Closing]:
        return {name: replace(one, closed=None, low=None, high=None) for name, one in parts.items()}

    return replace(
        shrink,
        closed=None,
        low=None,
        high=None,
        per_channel=without(shrink.per_channel),
        per_phase=without(shrink.per_phase),
        per_place={name: without(places) for name, places in shrink.per_place.items()},
    )


def _best_first(diagnosis: Diagnosis) -> tuple[Explanation, ...]:
    """Alternatives, each once, the best first; none where there was none."""
    if not diagnosis.alternatives:
        return ()
    names = [identity(one) for one in diagnosis.alternatives]
    best = identity(diagnosis.best)
    found = {best: diagnosis.alternatives[names.index(best)] if best in names else diagnosis.best}
    for name, one in zip(names, diagnosis.alternatives, strict=True):
        found.setdefault(name, one)
    return tuple(found.values())


def is_known(*values: float | None) -> bool:
    """Whether all of them are numbers, and finite."""
    return all(value is not None and math.isfinite(value) for value in values)
