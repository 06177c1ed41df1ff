"""The diagnosis: recordings in, verdict out. Each stage is a function of the ones before."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

import tiago_mj
from tiago_mj import mujoco_log
from tiago_mj.effects import Entry
from tiago_mj.gap.analysis import held_out, locate, outcome, place, promises, shrink, task
from tiago_mj.gap.analysis.remainder import remainder
from tiago_mj.gap.data.recording import Finding, Trial
from tiago_mj.gap.data.trials import cut_long
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.design.next_motion import next_motion
from tiago_mj.gap.detectors import readings, ripples, set_points
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor, predictor
from tiago_mj.gap.report.repaired import with_model
from tiago_mj.gap.result import Diagnosis, Explanation
from tiago_mj.gap.search import select
from tiago_mj.gap.search.select import Ranked, Tick
from tiago_mj.gap.simulation import phases, sizes
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.gap.torque import diagnose_inverse
from tiago_mj.gap.torque.way import along_a_motion, efforts_along, torques_along_a_motion

Array = NDArray[np.float64]

#: Trials drawn in the report.
OVERLAYS: Final = 1


def split(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Train, validation and test trials: about 60, 20 and 20 %, spread over the session; one trial is for training
    alone."""
    count = len(names)
    test = set(range(count - 1, 0, -5)) if count > 1 else set()
    rest = [k for k in range(count) if k not in test]
    validation = set(rest[len(rest) - 1 : 0 : -4]) if len(rest) > 2 else set()
    return {
        "train": tuple(names[k] for k in rest if k not in validation),
        "validation": tuple(names[k] for k in sorted(validation)),
        "test": tuple(names[k] for k in sorted(test)),
    }


def diagnose(
    trials: Sequence[Trial],
    *,
    findings: Sequence[Finding] = (),
    usable: noise_model.Usable | None = None,
    env: str | None = None,
    model: Path | None = None,
    names: Sequence[str] | None = None,
    given: Sequence[Entry] = (),
    seed: int = 0,
    threads: int = 0,
    budget: float | None = None,
    policy: str | None = None,
    trust: bool = False,
    tick: Tick = lambda stage, total, done=0: None,
) -> Diagnosis:
    """Diagnose recordings of commands and what was measured.

    Args:
        trials: of one robot.
        findings: of the lint, for the report.
        usable: channels that the lint trusts, of all trials or by their sources; None for all.
        env, model: what to simulate where the recordings do not say.
        names: effects to consider; None for the whole library.
        given: effects that are known already: part of the nominal simulator, and of what is found beside them.
        seed: of effects that draw at random and of the bootstrap.
        threads: of the simulations; the answer does not depend on it.
        budget: seconds after which the best verdict so far is given.
        policy: ``pi`` or a file, whose return the nominal and the repaired simulator predict; None: not asked.
        trust: load that file although loading runs what it holds.
        tick: told what begins.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
    """
    with mujoco_log.counted() as warned:
        found = _diagnosed(
            trials, findings, usable, env, model, names, given, seed, threads, budget, policy, trust, tick
        )
    return replace(found, notes=(*found.notes, *mujoco_log.sentences(warned)))


def _diagnosed(
    trials: Sequence[Trial],
    findings: Sequence[Finding],
    usable: noise_model.Usable | None,
    env: str | None,
    model: Path | None,
    names: Sequence[str] | None,
    given: Sequence[Entry],
    seed: int,
    threads: int,
    budget: float | None,
    policy: str | None,
    trust: bool,
    tick: Tick,
) -> Diagnosis:
    """See :func:`diagnose`."""
    begun = time.monotonic()
    plant = plant_of(trials, env=env, model=model, given=given)
    asis, trials = len(trials), _cut(plant, trials)
    if len(trials) > asis:
        plant = plant_of(trials, env=env, model=model, given=given)
    splits = split([trial.name for trial in trials])
    tested = [trial for trial in trials if trial.name in splits["test"]]
    asked = None if policy is None else task.ask(plant, tested, policy, trust=trust, seed=seed)
    if along_a_motion(plant, trials):
        tick("inverse dynamics", 1)
        return task.told(with_model(_along_the_motion(plant, trials, findings, seed, names), plant), asked)
    fitted_on = [k for k, t in enumerate(trials) if t.name not in splits["test"]]
    test = [k for k, t in enumerate(trials) if t.name in splits["test"]]
    validation = [k for k, t in enumerate(trials) if t.name in splits["validation"]]
    tick("replaying", len(trials))
    replaying = time.monotonic()
    everything = list(range(len(trials)))
    predict, nominal = predictor(plant, trials, usable, threads=threads, seed=seed)
    on, data = predict.on, predict.data
    fastest = np.abs(nominal.velocity).max(axis=(0, 1))
    pool = hypotheses.candidates(plant, names, fastest, sizes.sizes(plant, trials, nominal))
    seen = set_points.told(plant, on, data, nominal)
    if seen is not None:
        pool = set_points.magnitudes(plant, on, seen, pool, fitted_on)
    base = predict.all_trials([()], everything, keep=True)[0]
    untouched = set_points.untouched(data, nominal, data.value.shape[1])
    share = set_points.shares(plant, seen)
    pool = ripples.with_periods(
        plant, noise_model.part(data, fitted_on), base[fitted_on], untouched[fitted_on], share, pool
    )
    phase = phases.phases(plant, on, nominal)[:, : data.value.shape[1]]
    part = noise_model.part(data, fitted_on)
    tones = readings.tones(plant, data, base)
    hums = {tone.channel for tone in tones}
    marks = readings.of_channels(plant, part, base[fitted_on])
    known = readings.betrayed([m for m in marks if m.channel not in hums], pool)
    if any(k.candidate.effect == "force_dropout" for k in known):
        data = noise_model.without_repeats(data)
    part = noise_model.part(data, fitted_on)
    # What follows the search simulates about as much as what came before it.
    reserve = time.monotonic() - replaying
    ranked = select.select(
        predict,
        part,
        fitted_on,
        pool,
        hypotheses.terms(plant),
        base[fitted_on],
        known,
        seen,
        steps=on.commands.shape[1] * math.ceil(plant.period / plant.max_timestep),
        out_of_time=lambda: budget is not None and time.monotonic() - begun > budget - reserve,
        tick=tick,
    )
    placed, ranked = _unless_ended(ranked, partial(place.refined, plant, ranked, part, fitted_on), None)
    ranked = placed or ranked
    left_open = outcome.left_open(plant, ranked)
    # Before and after are what the simulator itself does: as the environment with these effects, or the repaired model.
    simulator, by = ranked.predict.as_simulated(), verdict.calibration()
    base = simulator.all_trials([left_open.get(outcome.nominal(ranked), ())], everything)[0]
    judging = [k for k in validation if k not in ranked.astray]
    gains, beaten = held_out.validated(plant, simulator, data, base, ranked.fits, judging or fitted_on, by.fails, seed)
    options = [verdict.option(fit, ranked) for fit in ranked.fits]
    judged = verdict.judge(ranked, strange=bool(tones), beaten=beaten if judging else None)
    judged = promises.standing(judged, options, by)
    best = ranked.fits[judged.rivals[0]]
    following = None
    if judged.kind == "ambiguous":
        tick("next motion", 1)
        rivals = [ranked.fits[k] for k in judged.rivals], [judged.probability[k] for k in judged.rivals]
        until = None if budget is None else begun + budget
        choose = partial(
            next_motion, plant, trials[0], part, ranked.weight, *rivals, seed=seed, threads=threads, until=until
        )
        following, ranked = _unless_ended(ranked, choose, None)
    tick("writing", 1)
    repair = partial(_repaired, simulator, ranked, left_open, data, base)
    close = partial(shrink.shrink, data, base, phase=phase, test=test, period=plant.period, seed=seed)
    leave = partial(remainder, plant, ranked.predict, data, weight=ranked.weight, test=test)
    repaired = repair(judged.rivals[0])
    closing = close(repaired)
    said: tuple[str, ...] = ()
    if test:
        rest = leave(fit=best)
        aside = promises.Aside(closing.closed, rest.gap, rest.misfit, held_out.can_close(best))
        kept, said = promises.aside(judged, aside, options, by)
        if kept.rivals[0] != judged.rivals[0]:
            best, repaired = ranked.fits[kept.rivals[0]], repair(kept.rivals[0])
            closing, rest = close(repaired), leave(fit=best)
        judged, closing = kept, replace(closing, accounted=rest.gap)
        said += held_out.spoiled(plant, ranked.predict, data, best, trials, splits, seed)
    where = locate.locate(data, base, phase, plant.period, seed)
    left = locate.locate(data, repaired, phase, plant.period, seed)
    explanations = outcome.explanations(plant, ranked, judged.probability, gains)
    shown = [k for k in judged.rivals if ranked.fits[k].parts or judged.kind == "no_gap"]
    if judged.kind == "no_gap":
        shown = shown[:1]
    found = Diagnosis(
        kind=judged.kind,
        best=Explanation((), explanations[judged.rivals[0]].probability, 0.0)
        if judged.kind == "no_gap"
        else explanations[judged.rivals[0]],
        alternatives=tuple(explanations[k] for k in shown),
        remains=judged.remains and judged.kind != "no_gap",
        remains_where=tuple(place for place in left[:5] if place.share > 0) if judged.remains else (),
        not_excited=ranked.not_excited,
        where=where,
        stage=outcome.stage(best) if best.parts and judged.kind != "unknown" else locate.stage(where),
        shrink=closing,
        ranking=tuple(explanations[k] for k in _ranked(judged)),
        findings=tuple(findings),
        next_motion=following if judged.kind == "ambiguous" else None,
        splits=splits,
        robot=plant.name,
        complete=ranked.complete,
        seed=seed,
        version=tiago_mj.__version__,
        seconds=time.monotonic() - begun,
        overlays=tuple(
            outcome.overlay(plant, trials[k], data, base, repaired, phase, k) for k in (test or everything)[:OVERLAYS]
        ),
        notes=said
        + outcome.notes(
            trials,
            tones,
            astray=ranked.astray,
            cut_from=asis if len(trials) > asis else 0,
            tested=bool(test),
            complete=ranked.complete,
            ended=ranked.ended,
            diverged=ranked.predict.tally,
            splits=splits,
            slides=[name for name, slides in zip(plant.joints, plant.wiring.targets.slides, strict=True) if slides],
        ),
        given=plant.given,
        ended=ranked.ended,
    )
    return task.told(with_model(found, plant), asked, tick)


def _repaired(
    simulator: Predictor, ranked: Ranked, left_open: Mapping[int, tuple[Entry, ...]], data: Data, base: Array, best: int
) -> Array:
    """What the simulator predicts with an explanation, by its index, (ntrials, T, C)."""
    fit = ranked.fits[best]
    if not fit.parts:
        return base
    return simulator.all_trials([(*fit.effects(), *left_open.get(best, ()))], range(len(data.value)))[0]


def _ranked(judged: verdict.Judged) -> list[int]:
    """Indices of the explanations: those that are not ruled out, the best first, then the others by probability."""
    rest = [k for k in range(len(judged.probability)) if k not in judged.rivals]
    return [*judged.rivals, *sorted(rest, key=lambda k: -judged.probability[k])]


T = TypeVar("T")


def _unless_ended(ranked: Ranked, work: Callable[[], T], otherwise: T) -> tuple[T, Ranked]:
    """What a stage after the search gives, or else something; and the search, which says so if something ended that."""
    try:
        return work(), ranked
    except (Exception, KeyboardInterrupt) as fault:
        return otherwise, replace(ranked, complete=False, ended=ranked.ended or fault)


def _cut(plant: Plant, trials: Sequence[Trial]) -> Sequence[Trial]:
    """Long recordings of a plain model as several trials; where an object is about, nobody knows how it stood in
    between."""
    if plant.environment is not None or not trials[0].commands or torques_along_a_motion(plant, trials):
        return trials
    return cut_long(trials)


def _along_the_motion(
    plant: Plant, trials: Sequence[Trial], findings: Sequence[Finding], seed: int, names: Sequence[str] | None
) -> Diagnosis:
    """Explain the efforts along the measured motion, or the commands where they are efforts."""
    trials, joints = efforts_along(plant, trials)
    return diagnose_inverse(
        trials,
        plant.model,
        joints,
        findings=findings,
        robot=plant.name,
        seed=seed,
        version=tiago_mj.__version__,
        names=names,
        given=plant.given,
    )
