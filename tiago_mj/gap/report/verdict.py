"""The verdict in plain words: the first sentence of every report."""

from __future__ import annotations

import math
from typing import Final

from tiago_mj.gap.analysis.outcome import STRANGE
from tiago_mj.gap.analysis.promises import CLOSES, LARGER_PART
from tiago_mj.gap.analysis.remainder import LEFT
from tiago_mj.gap.decision.verdict import calibration, measured_on, most_probable, wrong
from tiago_mj.gap.report.consistency import (
    NAMING,
    can_close,
    closed_accounted,
    closes,
    has_probability,
    loudest,
    repairs,
)
from tiago_mj.gap.report.part import explains_part
from tiago_mj.gap.report.pattern import apart, clauses, joints, labels
from tiago_mj.gap.report.words import MANY, begin, channel, listed, number, percent, percent_within, title
from tiago_mj.gap.result import Diagnosis, Explanation, FitQuality, Place, Stopped
from tiago_mj.io.progress import seconds

#: Alternatives up to this number are spelled out in the first sentence; of more, only the effects' names are given.
SPELLED = 2
#: A mean squared residual below this is noise, in units of the noise floor.
NOISE = 2.0
#: From this share of the highest probability on it is that ceiling, not a rival, that keeps an answer from being surer.
NEARLY = 0.98


#: How the headline of a search begins that did not come to its end, by :attr:`Stopped.why`.
ENDED: Final = {"budget": "Stopped", "interrupted": "Interrupted", "fault": "Ended by a fault of this program"}


def headline(diagnosis: Diagnosis) -> str:
    """One sentence: what is wrong, by how much, and how far the gap shrinks with it; of a search that did not come to
    its end how far it was, and what leads."""
    kind, best = diagnosis.kind, diagnosis.best
    if diagnosis.stopped is not None:
        return _stopped(diagnosis, diagnosis.stopped)
    if kind == "no_gap":
        whole = diagnosis.shrink.with_numbers
        if whole is not None and whole.closed is not None and whole.before >= NOISE and repairs(diagnosis.shrink):
            return (
                "No effect: the simulator's own numbers, moved within their tolerance, close "
                f"{percent_within(whole.closed, whole.low, whole.high)} of the gap on recordings that were kept aside; "
                "here they are."
            )
        return (
            "No gap: the simulator predicts these recordings as well as the uncertainty of its own parameters allows, "
            f"so no effect is named{_without_name(diagnosis)}."
        )
    if kind == "unknown":
        return _unknown(diagnosis)
    if kind == "ambiguous":
        return begin(f"{_either(diagnosis)}{closing(diagnosis, f'adding the {first(diagnosis)} one')}.")
    if not best.effects:
        return begin(f"there is a gap, and no effect is named{closing(diagnosis, 'the fitted parameters')}.")
    them = {1: "adding it", 2: "adding both"}.get(len(best.effects), "adding all of them")
    return begin(f"{_named(diagnosis)}{closing(diagnosis, them)}.")


def remainder(diagnosis: Diagnosis) -> str:
    """What is left after the best explanation, as a sentence; empty where nothing is."""
    if not diagnosis.complete:
        return ""
    if not diagnosis.remains:
        return within(diagnosis)
    place = main_place(diagnosis.remains_where) or _loud_place(diagnosis)
    what = "A gap above the noise is left after that" if diagnosis.best.effects else "All of the gap remains"
    return f"{what}, most of it in {place}." if place else f"{what}."


def within(diagnosis: Diagnosis) -> str:
    """What is left and yet no gap: of the simulator's own numbers and its step; empty where noise alone is left."""
    after, accounted = diagnosis.shrink.after, diagnosis.shrink.accounted
    if diagnosis.kind == "no_gap":
        return ""
    if after is not None and accounted is not None and after >= NOISE:
        return (
            f"What is left is {number(after)} times the noise, but that needs no further effect: with the simulator's "
            f"own numbers adjusted within their uncertainty, and without the error of its step, {number(accounted)} "
            "is left."
        )
    return _loud(diagnosis)


def nothing_more(diagnosis: Diagnosis) -> str:
    """That nothing is said to remain, beside the largest gap that the tables still show."""
    said = within(diagnosis) if diagnosis.kind != "no_gap" else _loud(diagnosis)
    return said or "Nothing beyond what noise and the uncertainty of nominal parameters explain."


def _loud(diagnosis: Diagnosis) -> str:
    """Where most is left of what does not count as remaining, and why it does not; empty: noise alone is left."""
    place = _loud_place(diagnosis)
    loud = loudest(diagnosis.shrink)
    if loud is None or not diagnosis.shrink.per_channel:
        return ""
    gap, accounted = loud[2].after, loud[2].accounted
    if accounted is not None and accounted < gap:
        left = f"with the simulator's own numbers adjusted within their uncertainty it is {number(accounted)}"
    else:
        left = "two correct simulators may differ by as much there"
    return f"Most is left in {place}, {number(gap)} times the noise; that needs no further effect: {left}."


def _loud_place(diagnosis: Diagnosis) -> str:
    """Channel and phase that leave most, in words; empty: noise alone is left."""
    loud = loudest(diagnosis.shrink)
    if loud is None:
        return ""
    name, phase, _ = loud
    what = channel(name) if name else "all channels"
    return f"{what} during {phase}" if phase else what


def closing(diagnosis: Diagnosis, subject: str) -> str:
    """How far the gap shrinks, as the end of a sentence."""
    shrink = diagnosis.shrink
    if shrink.closed is None or not math.isfinite(shrink.closed):
        if diagnosis.splits.get("test"):
            if diagnosis.best.effects and not can_close(diagnosis):
                return "; it shows in the readings alone, so no share of the gap can be given"
            return "; on the recordings that were kept aside there was no gap to close"
        return "; no recording was kept aside, so how much of the gap this closes is not known"
    whole = shrink.with_numbers
    both = "" if whole is None or whole.closed is None else f"; with the numbers as fitted {percent(whole.closed)}"
    if not closes(shrink):
        said = f"; yet {subject} does not close the gap on recordings that were kept aside ({percent(shrink.closed)})"
        hidden = closed_accounted(shrink)
        if hidden is None or hidden <= CLOSES:
            return said + both
        return (
            f"{said}, because the simulator's own numbers hide its effect: with those numbers as fitted it removes "
            f"{percent(hidden)} of the rest{both and f'{both} of the gap is closed'}"
        )
    closed = percent_within(shrink.closed, shrink.low, shrink.high)
    said = f"; {subject} closes {closed} of the gap on recordings that were kept aside"
    left = f"; {_floors(shrink.after)} is left there, so this is part of the cause" if part_only(diagnosis) else ""
    return f"{said}{left}{both}"


def part_only(diagnosis: Diagnosis) -> bool:
    """Whether what is named is told as a part of the cause."""
    return diagnosis.kind in NAMING and explains_part(diagnosis.shrink)


def _floors(gap: float | None) -> str:
    """A mean squared residual as a multiple of the noise's variance."""
    return f"{number(gap)} times the noise"


def _without_name(diagnosis: Diagnosis) -> str:
    """What is left where no effect is named, as the end of a sentence; empty where noise alone is."""
    before, accounted = diagnosis.shrink.before, diagnosis.shrink.accounted
    if before is None or not before > LEFT * diagnosis.shrink.floor:
        return ""
    said = f"; yet {_floors(before)} is left on recordings that were kept aside"
    if accounted is None or not accounted < before:
        return said
    return f"{said}, {number(accounted)} with its numbers adjusted within their uncertainty"


def with_numbers(diagnosis: Diagnosis) -> str:
    """The gap on the test trials before, with what is named, and with the simulator's numbers as fitted as well, as a
    sentence; empty where the repair has no such numbers, or there is no test trial."""
    shrink = diagnosis.shrink
    if shrink.with_numbers is None or shrink.before is None:
        return ""
    count = len(diagnosis.best.effects)
    them = "the effects" if count > 1 else "the effect"
    figures = [f"{number(shrink.before)} times the noise"]
    if count:
        figures.append(f"with {them} {number(shrink.after)}")
    figures.append(f"with {f'{them} and ' if count else ''}the numbers {number(shrink.with_numbers.after)}")
    return f"On recordings that were kept aside the gap is {', '.join(figures[:-1])} and {figures[-1]}."


def on_task(diagnosis: Diagnosis) -> str:
    """What the gap means for the return of a policy; empty where none was asked for."""
    task = diagnosis.shrink.task
    if task is None:
        return ""
    count = len(diagnosis.splits.get("test", ()))
    recordings = f"the {count} test recordings" if count > 1 else "the test recording"
    simulators = {"nominal": "the nominal simulator"}
    if diagnosis.repair:
        simulators["repaired"] = "the repaired one"
    measured = task.get("measured")

    def predicts(key: str) -> str:
        value = task.get(key)
        off = "" if measured is None or value is None else f", off by {number(abs(value - measured), 3)}"
        return f"{number(value, 4)}{off}"

    said = "; ".join(f"{who} predicts {predicts(key)}" for key, who in simulators.items())
    if measured is None:
        return (
            f"Return of policy {task.get('policy')} under the conditions of {recordings}: {said}. It was not "
            "measured: the recordings are not all of this policy, or do not hold what the reward is of."
        )
    return f"Return of policy {task.get('policy')} in {recordings}: {number(measured, 4)} measured; {said}."


def on_model(diagnosis: Diagnosis) -> str:
    """What the repaired model of a user's own robot holds, and how to have the rest; empty where nothing was found."""
    model = diagnosis.repaired
    if model is None or not (model.holds or model.lacks or diagnosis.numbers):
        return ""
    whole = 'tiago_mj.gap.apply(model, "calibration.yaml")'
    if model.fault:
        return f"repaired.xml could not be written ({model.fault}): {whole} simulates what was found."
    count, held = len(diagnosis.numbers), [title(name) for name in model.holds]
    if model.numbers:
        held.append(f"{model.numbers} of its own numbers as fitted" if model.numbers > 1 else "one number as fitted")
    lacks = [title(name) for name in model.lacks]
    if model.numbers < count:
        lacks.append(f"{count - model.numbers} of the numbers as fitted")
    said = [f"repaired.xml is the model with {listed(held)}."] if held else []
    if lacks:
        said.append(f"No model file can hold {listed(lacks, 'or')}: {whole} does.")
    return " ".join(said)


def main_place(places: tuple[Place, ...]) -> str:
    """Where most of an excess lies: channel and phase, in words."""
    by: dict[tuple[str, str], float] = {}
    for place in places:
        by[place.channel, place.phase] = by.get((place.channel, place.phase), 0.0) + place.share
    if not by:
        return ""
    (name, phase), share = max(by.items(), key=lambda item: item[1])
    if not share > 0:
        return ""
    return f"{channel(name)} during {phase} ({percent(share)} of it)"


def sure(diagnosis: Diagnosis) -> str:
    """What the probability of the best explanation means, or why none is given; empty: the search found none."""
    shrink, probability = diagnosis.shrink, diagnosis.best.probability
    if has_probability(diagnosis):
        of = " that this is part of the cause" if part_only(diagnosis) else ""
        rest = " It does not concern the rest of the gap." if of else ""
        return (
            f"Probability {percent(probability)}{of}: of a hundred answers given with this probability, about "
            f"{min(100 * probability, 99):.0f} name the true effect or one of its class.{rest}"
        )
    if not math.isfinite(probability) or not diagnosis.best.effects:
        return ""
    if diagnosis.kind not in NAMING:
        return "No probability is given, because no effect is named."
    if closes(shrink) is False:
        return (
            "No probability is given: what is named explains the recordings to which it was fitted, but by itself it "
            "closes nothing of the gap on those kept aside."
        )
    return (
        "No probability is given: what is named explains the recordings to which it was fitted, but may close nothing "
        f"of the gap on those kept aside ({percent_within(shrink.closed, shrink.low, shrink.high)})."
    )


def first(diagnosis: Diagnosis) -> str:
    """What the best of several explanations is called: the likelier only if it is."""
    best = diagnosis.best.probability
    if not has_probability(diagnosis) or any(one.probability > best for one in diagnosis.alternatives):
        return "first"
    return "likelier"


def ceiling(explanation: Explanation, *, replays: bool = True) -> str:
    """Why an answer that is as sure as one can be has no higher probability; empty where another one shares it."""
    most = most_probable(explanation, replays=replays)
    if not NEARLY * most <= explanation.probability <= most + 1e-6:  # an older version knew another ceiling
        return ""
    return f"Of answers like this one it is never above {percent(most)}, however clear the recordings are."


def why_ceiling(*, replays: bool = True) -> str:
    """What the highest probability of an answer rests on; ``replays``: commands were replayed."""
    by, cases = calibration(replays=replays).doubt, measured_on("doubt", replays=replays)
    nothing, one, more = (percent(wrong(effects, FitQuality(0.0, 0.0, 1.0, 1.0), by)) for effects in range(3))
    return (
        f"On {cases} simulated cases, whose effects the diagnosis was not told, some answers were wrong even with "
        f"strong evidence: about {nothing} of those that named nothing, {one} of those with one effect and {more} of "
        "those with several, and more where more than noise was left. One reason is that a cause which the library "
        "lacks can look exactly like one that it has. Every probability is therefore reduced by this share."
    )


def _named(diagnosis: Diagnosis) -> str:
    """What the best explanation says about the robot, as a clause."""
    return clauses(diagnosis.best, joints(diagnosis))


def _stopped(diagnosis: Diagnosis, stopped: Stopped) -> str:
    known = bool(stopped.tried)
    share = f"{'all' if stopped.tried == stopped.effects else f'{stopped.tried} of'} {stopped.effects} effects"
    tried = f"with {share} tried" if known else "before any effect was tried"
    leading = f"what leads so far, provisionally: {_named(diagnosis)}"
    leads = leading if diagnosis.best.effects else "nothing is named yet"
    return f"{ENDED[stopped.why]} after {seconds(stopped.seconds)} {tried}; {leads}."


def _either(diagnosis: Diagnosis) -> str:
    choices, of = diagnosis.alternatives or (diagnosis.best,), joints(diagnosis)
    common, rests = apart(choices)
    if common and any(len(choice.effects) > MANY for choice in choices):
        beside = " – or ".join(labels(rest, of) if rest.effects else "nothing more" for rest in rests)
        return f"{clauses(Explanation(common, math.nan), of)}; beside that {beside}: these recordings cannot tell which"
    if len(choices) <= SPELLED:
        # A comma, since a clause may hold an "and" of its own.
        either = " – or ".join(clauses(choice, of) or "the nominal simulator is right" for choice in choices)
        return f"either {either}: these recordings cannot tell which"
    return (
        f"one of {len(choices)} explanations holds, and these recordings cannot tell which: "
        f"{'; or '.join(labels(choice) for choice in choices)}"
    )


def _unknown(diagnosis: Diagnosis) -> str:
    place = main_place(diagnosis.remains_where or diagnosis.where)
    if diagnosis.best.evidence is not None and diagnosis.best.evidence.edge:
        return begin(
            f"the gap would be explained if {_named(diagnosis)}, but that is at the bound of what is possible: "
            "another cause, which is not in the library, is likelier."
        )
    if diagnosis.best.effects:
        s = "s" if len(diagnosis.best.effects) == 1 else ""
        if can_close(diagnosis) and closes(diagnosis.shrink) is False:
            what = labels(diagnosis.best, joints(diagnosis))
            return begin(
                f"{what} explain{s} the recordings that were fitted, and close{s} nothing of the gap "
                f"on those that were kept aside ({percent(diagnosis.shrink.closed)}): no cause is named."
            )
        if can_close(diagnosis) and closes(diagnosis.shrink) and (diagnosis.shrink.closed or 0) < LARGER_PART:
            what = labels(diagnosis.best, joints(diagnosis))
            where = f"; most of what is left lies in {place}" if place else ""
            return begin(
                f"{what} explain{s} the recordings that were fitted, and close{s} only "
                f"{percent(diagnosis.shrink.closed)} of the gap on those that were kept aside: no cause is named"
                f"{where}."
            )
        if not diagnosis.remains:
            return begin(f"{_named(diagnosis)}, {_why_not(diagnosis)}.")
        what = f"{_named(diagnosis)}, but that is not all: the rest of the gap is explained by no known effect"
    elif any(STRANGE in note for note in diagnosis.notes):
        what = "the readings show something that no known effect causes"
    else:
        what = "there is a gap that no known effect explains"
    return begin(f"{what}{f'; most of it lies in {place}' if place else ''}.")


def _why_not(diagnosis: Diagnosis) -> str:
    """Why what leaves no gap is not named, as the end of a sentence."""
    if any(STRANGE in note for note in diagnosis.notes):
        return "but the readings also show something that no known effect causes"
    return "but no explanation is probable enough to be named, although this one leaves no gap"
