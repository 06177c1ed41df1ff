"""The verdict in plain words: the first sentence of every report."""

from __future__ import annotations

import math

from tiago_mj.gap.decision.verdict import calibration, measured_on
from tiago_mj.gap.report.words import begin, channel, clauses, interval_percent, labels, listed, number, percent, title
from tiago_mj.gap.result import Diagnosis, Explanation, Place

#: Alternatives up to this number are spelled out in the first sentence; of more, only the effects' names are given.
SPELLED = 2
#: A mean squared residual below this is noise, in units of the noise floor.
NOISE = 2.0
#: From this share of the highest probability on it is that ceiling, not a rival, that keeps an answer from being surer.
NEARLY = 0.98
#: A larger share than this of the gap has to close before a report says that it does.
CLOSES = 0.02


def headline(diagnosis: Diagnosis) -> str:
    """One sentence: what is wrong, by how much, and how far the gap shrinks with it."""
    kind, best = diagnosis.kind, diagnosis.best
    if kind == "no_gap":
        return (
            "No gap: the simulator predicts these recordings as well as the uncertainty of its own parameters allows, "
            "so no effect is named."
        )
    if kind == "unknown":
        return _unknown(diagnosis)
    if kind == "ambiguous":
        return begin(f"{_either(diagnosis)}{closing(diagnosis, 'adding the likelier one')}.")
    if not best.effects:
        return begin(f"there is a gap, and no effect is named{closing(diagnosis, 'the fitted parameters')}.")
    them = {1: "adding it", 2: "adding both"}.get(len(best.effects), "adding all of them")
    return begin(f"{clauses(best)}{closing(diagnosis, them)}.")


def remainder(diagnosis: Diagnosis) -> str:
    """What is left after the best explanation, as a sentence; empty where nothing is."""
    if not diagnosis.remains:
        return within(diagnosis)
    place = main_place(diagnosis.remains_where)
    what = "A gap above the noise is left after that" if diagnosis.best.effects else "All of the gap remains"
    return f"{what}, most of it in {place}." if place else f"{what}."


def within(diagnosis: Diagnosis) -> str:
    """What is left and yet no gap: of the simulator's own numbers and its step; empty where noise alone is left."""
    after, accounted = diagnosis.shrink.after, diagnosis.shrink.accounted
    if diagnosis.kind == "no_gap" or after is None or accounted is None or after < NOISE:
        return ""
    return (
        f"What is left, {number(after)} times the noise, is no further effect: with the simulator's own numbers moved "
        f"within what they are known to, and without the error of its step, {number(accounted)} is left."
    )


def closing(diagnosis: Diagnosis, subject: str) -> str:
    """How far the gap shrinks, as the end of a sentence."""
    shrink = diagnosis.shrink
    if shrink.closed is None or not math.isfinite(shrink.closed):
        if diagnosis.splits.get("test"):
            return "; on the recordings that were kept aside there was no gap to close"
        return "; no recording was kept aside, so how much of the gap this closes is not known"
    if shrink.closed < CLOSES:
        return f"; yet {subject} does not close the gap on recordings that were kept aside"
    between = interval_percent(shrink.low, shrink.high)
    closed = f"{percent(shrink.closed)} ({between} %)" if between else percent(shrink.closed)
    return f"; {subject} closes {closed} of the gap on recordings that were kept aside"


def on_task(diagnosis: Diagnosis) -> str:
    """What the gap means for the return of a policy; empty where none was asked for."""
    task = diagnosis.shrink.task
    if task is None:
        return ""
    count = len(diagnosis.splits.get("test", ()))
    recordings = f"the {count} test recordings" if count > 1 else "the test recording"
    simulators = {"nominal": "the nominal simulator"}
    if diagnosis.best.effects:
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
    if model is None or not (model.holds or model.lacks):
        return ""
    whole = 'tiago_mj.gap.apply(model, "calibration.yaml")'
    if model.fault:
        return f"repaired.xml could not be written ({model.fault}): {whole} simulates what was found."
    said = [f"repaired.xml is the model with {listed([title(name) for name in model.holds])}."] if model.holds else []
    if model.lacks:
        said.append(f"No model file can hold {listed([title(name) for name in model.lacks], 'or')}: {whole} does.")
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


def sure(explanation: Explanation) -> str:
    """What a probability means."""
    return (
        f"Probability {percent(explanation.probability)}: of a hundred answers given with this probability, about "
        f"{100 * explanation.probability:.0f} name the true effect or one of its class."
    )


def ceiling(explanation: Explanation) -> str:
    """Why an answer that is as sure as one can be has no higher probability; empty where another one shares it."""
    most = 1 - calibration().lapse
    if not NEARLY * most <= explanation.probability <= most + 1e-6:  # an older version knew another ceiling
        return ""
    return f"It is never above {percent(most)}, however clear the recordings are."


def why_ceiling() -> str:
    """What the highest probability of an answer rests on."""
    lapse, cases = calibration().lapse, int(measured_on("lapse"))
    return (
        f"On {cases} simulated cases, whose effects the diagnosis was not told, about {percent(lapse)} of the answers "
        "would have been wrong however sure the evidence was: a cause that the library lacks can look exactly like one "
        f"that it has. So this share is taken off every probability, and {percent(1 - lapse)} is the most."
    )


def _either(diagnosis: Diagnosis) -> str:
    choices = diagnosis.alternatives or (diagnosis.best,)
    if len(choices) <= SPELLED:
        # A comma, since a clause may hold an "and" of its own.
        either = " – or ".join(clauses(choice) or "the nominal simulator is right" for choice in choices)
        return f"either {either}: these recordings cannot tell which"
    return (
        f"one of {len(choices)} explanations holds, and these recordings cannot tell which: "
        f"{'; or '.join(labels(choice) for choice in choices)}"
    )


def _unknown(diagnosis: Diagnosis) -> str:
    place = main_place(diagnosis.remains_where or diagnosis.where)
    if diagnosis.best.evidence is not None and diagnosis.best.evidence.edge:
        return begin(
            f"the gap would be explained if {clauses(diagnosis.best)}, but that is at the bound of what is possible: "
            "another cause, which is not in the library, is likelier."
        )
    if diagnosis.best.effects:
        what = f"{clauses(diagnosis.best)}, but that is not all: the rest of the gap is explained by no known effect"
    else:
        what = "there is a gap that no known effect explains"
    return begin(f"{what}{f'; most of it lies in {place}' if place else ''}.")
