"""The comparison: two sets of recordings in, what changed between them out. Each stage is a function of the ones
before."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

import tiago_mj
from tiago_mj.change import lost as lost_share
from tiago_mj.change import search
from tiago_mj.change.reference import Reference, measured_on_readings, spread
from tiago_mj.change.result import AFTER, BEFORE, Change, Comparison, Explanation, Kind, Side, Which
from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.effects.spec import arrays
from tiago_mj.gap import pipeline
from tiago_mj.gap.ahead import Ahead
from tiago_mj.gap.analysis import outcome, promises
from tiago_mj.gap.compared import Compared
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.detectors.readings import NAMED_DEVIATIONS, Known
from tiago_mj.gap.parts import Named, Value, target_of
from tiago_mj.gap.request import Request, SoFar
from tiago_mj.gap.search import ranking
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.session import Session, session
from tiago_mj.io import mujoco_log
from tiago_mj.io.quantities import NINETY
from tiago_mj.recordings.recording import RecordingError, Trial

#: What a search's verdict is called here.
KINDS: Final[Mapping[str, Kind]] = {
    "no_gap": "nothing_changed",
    "effect": "changed",
    "ambiguous": "ambiguous",
    "unknown": "unknown_change",
}
#: Trials of each set that the detectors look at before anything is fitted. Halved and doubled, none of 12 answers
#: about pairs of sessions changes (varied_pairs.json).
LOOKED_AT: Final = 2
#: What is said of a change that leaves more than what recordings scatter by.
PART: Final = "This is a part of the change: {left:.3g} times what recordings scatter by is left of the difference."
#: Explanations that are listed.
LISTED: Final = 12


@dataclass(frozen=True)
class Sets:
    """Two sets of recordings as one session.

    Attributes:
        session: of all trials.
        before, after: indices of each set's.
    """

    session: Session
    before: tuple[int, ...]
    after: tuple[int, ...]

    @property
    def both(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Indices, the earlier set's first."""
        return self.before, self.after


def renamed(trials: Sequence[Trial], which: str) -> list[Trial]:
    """Trials whose names say which set they are of: both sets may have the same names."""
    return [replace(trial, name=f"{which}:{trial.name}", source=f"{which}/{trial.source}") for trial in trials]


def compare(before: Sequence[Trial], after: Sequence[Trial], **asked: Any) -> Comparison:
    """Compare two sets of recordings of one robot.

    Args:
        before, after: their trials, as :func:`renamed` names them.
        asked: fields of :class:`tiago_mj.gap.request.Request`, each of which may be left out.

    Raises:
        RecordingError: the sets hold nothing that can be compared; one line.
    """
    request, begun = Request(**asked), time.monotonic()
    if not before or not after:
        raise RecordingError(f"the set {BEFORE if not before else AFTER} has no recording: give a folder of each")
    so_far = SoFar(Ahead(request.tick))
    with mujoco_log.counted() as warned:
        sets = _sets(before, after, request)
        compared = pipeline.beside_nominal(sets.session, request, so_far)
        sets = _of_names(compared.session)
        which, known, found = search.explained(compared, sets.both, request.deadline)
        measured = [measured_on_readings(compared, some) for some in sets.both]
        lost = lost_share.counted(compared, known, sets.both)
    reading = _differing([(*one, *other) for one, other in zip(measured, lost, strict=True)])
    answer = _answer(compared, sets, known, found, reading=reading, in_before=bool(which))
    return replace(
        answer,
        findings=(*request.findings, *compared.findings),
        notes=(*answer.notes, *compared.notes, *mujoco_log.sentences(warned)),
        seed=request.seed,
        seconds=time.monotonic() - begun,
    )


def _sets(before: Sequence[Trial], after: Sequence[Trial], request: Request) -> Sets:
    whole = session([*before, *after], env=request.env, model=request.model, given=request.given)
    sets = _of_names(whole)
    looked = [whole.trials[k].name for some in sets.both for k in spread(some, LOOKED_AT)]
    rest = [trial.name for trial in whole.trials if trial.name not in looked]
    return replace(sets, session=replace(whole, splits={"train": (*looked,), "validation": (), "test": (*rest,)}))


def _of_names(whole: Session) -> Sets:
    first, second = (
        tuple(k for k, trial in enumerate(whole.trials) if trial.name.startswith(f"{which}:"))
        for which in (BEFORE, AFTER)
    )
    return Sets(whole, first, second)


def _differing(measured: Sequence[Sequence[Known]]) -> tuple[Change, ...]:
    """Effects that were measured in one set and not in the other, or by another amount.

    Args:
        measured: of each set, on its readings alone or by counting its lost commands.
    """
    first, second = ({one.candidate.label: one for one in some} for some in measured)
    out = []
    for label in dict.fromkeys((*first, *second)):
        one, other = first.get(label), second.get(label)
        if one is not None and other is not None:
            error = float(np.hypot(one.deviation, other.deviation))
            if abs(one.value - other.value) <= NAMED_DEVIATIONS * error:
                continue
        out.append(_of_reading(one, other))
    return tuple(out)


def _of_reading(one: Known | None, other: Known | None) -> Change:
    """A change from one measured value to another; None: the effect is not there."""
    there = other or one
    assert there is not None
    candidate, none = there.candidate, there.candidate.identity
    values = [none if known is None else known.value for known in (one, other)]
    more: Which = AFTER if other is not None and (one is None or other.value > one.value) else BEFORE
    error = float(np.hypot(0.0 if one is None else one.deviation, 0.0 if other is None else other.deviation))
    size, reach = abs(values[1] - values[0]), NINETY * error
    amount = Value(size, max(size - reach, 0.0), size + reach, candidate.unit, error)
    return Change(
        candidate.effect, target_of(candidate.target), candidate.parameter, more, amount, values[0], values[1], {}
    )


def _answer(
    compared: Compared,
    sets: Sets,
    known: Reference,
    found: search.Found,
    *,
    reading: tuple[Change, ...],
    in_before: bool,
) -> Comparison:
    """What is said.

    Args:
        compared, sets, known, found: of the stages before.
        reading: changes that were measured in each set.
        in_before: whether effects of the ranking act in the earlier set.
    """
    ranked, plant = found.ranked, compared.session.plant
    decided = verdict.judge(ranked)
    as_part = larger_part(ranked, decided) if plant.environment is None else decided
    judged = _without_what_both_have(found, as_part)
    nothing = next(fit for fit in ranked.fits if not fit.parts)
    explanations = []
    for fit, probability in zip(ranked.fits, judged.probability, strict=True):
        told = tuple(
            _change(plant, known, outcome.named(plant, fit, k), BEFORE if in_before else AFTER)
            for k in range(len(fit.parts))
        )
        evidence = float(fit.evidence - nothing.evidence)
        explanations.append(Explanation((*reading, *told), float(probability), evidence, ranking.discrepancy(fit)))
    kind = KINDS[judged.kind]
    reference: Which = AFTER if in_before else BEFORE
    if reading and kind == "nothing_changed":
        kind = "changed"
    rivals = tuple(explanations[k] for k in judged.rivals)
    order = sorted(range(len(explanations)), key=lambda k: -explanations[k].probability)
    return Comparison(
        kind=kind,
        probability=rivals[0].probability,
        best=rivals[0],
        alternatives=rivals,
        ranking=tuple(explanations[k] for k in order[:LISTED]),
        before=_side(sets, 0),
        after=_side(sets, 1),
        common=tuple(_named(entry) for entry in known.found),
        reference=reference,
        same_commands=found.paired,
        robot=plant.name,
        findings=(),
        notes=() if as_part is decided else (PART.format(left=rivals[0].left),),
        complete=ranked.complete,
        physics_steps=ranked.predict.physics_steps,
        seconds=0.0,
        seed=0,
        version=tiago_mj.__version__,
    )


def larger_part(ranked: Ranked, judged: verdict.Judged) -> verdict.Judged:
    """The verdict of a user's own model, where the best explanation fails and yet leaves less than half of what both
    sets differ by: it is named, as a diagnosis names it (:data:`tiago_mj.gap.analysis.promises.LARGER_PART`).

    Args:
        ranked: the search.
        judged: its verdict.
    """
    best, nothing = ranked.fits[judged.rivals[0]], next(fit for fit in ranked.fits if not fit.parts)
    most = (1 - promises.LARGER_PART) * ranking.discrepancy(nothing)
    if judged.kind != "unknown" or ranking.discrepancy(best) >= most:
        return judged
    return promises.as_part(judged, [verdict.option(fit, ranked) for fit in ranked.fits])


def _without_what_both_have(found: search.Found, judged: verdict.Judged) -> verdict.Judged:
    """The verdict without changes whose effects explain both sets as well where they act in both.

    A change stands where its evidence exceeds that by :data:`tiago_mj.gap.search.ranking.MIN_EVIDENCE_GAIN_NATS`.
    """
    fits = found.ranked.fits
    rivals = [k for k in judged.rivals if fits[k].parts]
    if not rivals or judged.kind == "unknown":
        return judged
    gains = search.gains_of_change(found, rivals)
    kept = [k for k, gain in zip(rivals, gains, strict=True) if gain > ranking.MIN_EVIDENCE_GAIN_NATS]
    if kept:
        one_class = len({verdict.classes_of(fits[k]) for k in kept}) == 1
        kind = "effect" if judged.kind == "ambiguous" and one_class else judged.kind
        return replace(judged, kind=kind, rivals=tuple(kept))
    nothing = next(k for k, fit in enumerate(fits) if not fit.parts)
    probability = judged.probability.copy()
    by = verdict.temperature_of([fit.misfit for fit in fits], verdict.calibration())
    probability[nothing] = judged.sure / (1 + np.exp(max(gains) / by))
    probability[rivals] = judged.sure - probability[nothing]
    return replace(judged, kind="no_gap", rivals=(nothing,), probability=probability)


def _change(plant: Plant, known: Reference, one: Named, acts_in: Which) -> Change:
    """An effect of the ranking as a change from one set to the other."""
    names = list(one.parameters)
    parameter, amount = names[0], one.parameters[names[0]]
    entry = Entry(one.name, one.targets, {parameter: amount.value})
    base = _together(plant, one.name, known.found, parameter, entry)
    more = _together(plant, one.name, (*known.found, entry), parameter, entry)
    before, after = (more, base) if acts_in == BEFORE else (base, more)
    form = {name: one.parameters[name] for name in names[1:]}
    return Change(one.name, one.target, parameter, acts_in, amount, before, after, form)


def _together(plant: Plant, name: str, entries: Sequence[Entry], parameter: str, there: Entry) -> float | None:
    """A parameter of an effect where an entry acts, of several entries together; None: no limit."""
    declared, targets = EFFECTS[name], plant.wiring.targets
    values = getattr(arrays(declared, [entries], targets), parameter)[0]
    names = targets.names(declared.targets)
    mine = [k for k, target in enumerate(names) if there.target is None or target in there.target]
    value = float(np.mean(values[mine]))
    return value if np.isfinite(value) else None


def _named(entry: Entry) -> Named:
    """An effect that both sets have, without intervals."""
    declared = EFFECTS[entry.name].parameters
    values: Mapping[str, Value] = {
        key: Value(float(value), None, None, declared[key].unit[0] if key in declared else "-")
        for key, value in entry.parameters.items()
    }
    return Named(entry.name, target_of(entry.target), values)


def _side(sets: Sets, k: int) -> Side:
    trials = sets.session.trials
    return Side(tuple(trials[index].name.partition(":")[2] for index in sets.both[k]))


def with_places(found: Comparison, folders: tuple[Path, Path], recorded: tuple[str, str]) -> Comparison:
    """With where the sets were read, and when they were recorded."""
    sides = (found.before, found.after)
    first, second = (
        replace(side, folder=folder.name, recorded=day)
        for side, folder, day in zip(sides, folders, recorded, strict=True)
    )
    return replace(found, before=first, after=second)
