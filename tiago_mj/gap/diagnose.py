"""The diagnosis: recordings in, verdict out. Each stage is a function of the ones before."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

import tiago_mj
from tiago_mj.gap import (
    floor,
    hypotheses,
    locate,
    phases,
    replay,
    score,
    select,
    set_points,
    shrink,
    sizes,
    task,
    traces,
    verdict,
)
from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.effects.spec import Entry
from tiago_mj.gap.fit import Fitted
from tiago_mj.gap.inverse import diagnose_inverse
from tiago_mj.gap.next_motion import next_motion
from tiago_mj.gap.plant import Plant, plant_of
from tiago_mj.gap.predict import Predictor
from tiago_mj.gap.recording import Finding, RecordingError, Trial
from tiago_mj.gap.result import Diagnosis, Explanation, Named, Overlay, Value
from tiago_mj.gap.trials import cut

Array = NDArray[np.float64]

#: 90 % of a normal distribution lie within so many standard deviations.
NINETY: Final = 1.645
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
    usable: frozenset[str] | None = None,
    env: str | None = None,
    model: Path | None = None,
    names: Sequence[str] | None = None,
    seed: int = 0,
    threads: int = 0,
    budget: float | None = None,
    policy: str | None = None,
    trust: bool = False,
    tick: Callable[[str, int], None] = lambda stage, total: None,
) -> Diagnosis:
    """Diagnose recordings of commands and what was measured.

    Args:
        trials: of one robot.
        findings: of the lint, for the report.
        usable: channels that the lint trusts; None for all.
        env, model: what to simulate where the recordings do not say.
        names: effects to consider; None for the whole library.
        seed: of effects that draw at random and of the bootstrap.
        threads: of the simulations; the answer does not depend on it.
        budget: seconds after which the best verdict so far is given.
        policy: ``pi`` or a file, whose return the nominal and the repaired simulator predict; None: not asked.
        trust: load that file although loading runs what it holds.
        tick: told what begins.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
    """
    begun = time.monotonic()
    plant = plant_of(trials, env=env, model=model)
    asis, trials = len(trials), _cut(plant, trials)
    if len(trials) > asis:
        plant = plant_of(trials, env=env, model=model)
    splits = split([trial.name for trial in trials])
    tested = [trial for trial in trials if trial.name in splits["test"]]
    asked = None if policy is None else task.ask(plant, tested, policy, trust=trust, seed=seed)
    if not any(trial.commands for trial in trials) or _torques_along_a_motion(trials):
        tick("inverse dynamics", 1)
        return task.told(_along_the_motion(plant, trials, findings, seed, names), asked)
    on = replay.grid(plant, trials)
    data = floor.collect(plant, trials, usable)
    if not data.channels:
        raise RecordingError(
            f"{trials[0].source}: no measured column is of this robot ({', '.join(plant.joints)}): give a map file"
        )
    fitted_on = [k for k, t in enumerate(trials) if t.name not in splits["test"]]
    test = [k for k, t in enumerate(trials) if t.name in splits["test"]]
    validation = [k for k, t in enumerate(trials) if t.name in splits["validation"]]
    tick("replaying", len(trials))
    everything = list(range(len(trials)))
    nominal = replay.simulate(plant, on, [(k, ()) for k in everything], threads=threads, seed=seed)
    fine = dataclasses.replace(plant, max_timestep=plant.max_timestep / floor.FINER)
    finer = replay.simulate(fine, on, [(k, ()) for k in everything], threads=threads, seed=seed)
    as_simulated, off = floor.predicted(data, nominal), floor.off_by_step(nominal, finer)
    data = floor.with_numerics(data, as_simulated, floor.predicted(data, finer))
    # What was recorded in this very simulator is off by the same steps.
    same = score.distance(data, as_simulated) < score.distance(data, as_simulated - floor.predicted(data, off))
    fastest = np.abs(nominal.velocity).max(axis=(0, 1))
    pool = hypotheses.candidates(plant, names, fastest, sizes.sizes(plant, trials, nominal))
    seen = set_points.told(plant, on, data, nominal)
    if seen is not None:
        pool = set_points.magnitudes(plant, on, seen, pool, fitted_on)
        on, pool = set_points.with_lost(plant, on, seen, pool)
    predict = Predictor(plant, on, data, threads, seed, None if same else off)
    base = predict.all_trials([()], everything, keep=True)[0]
    phase = phases.phases(plant, on, nominal)[:, : data.value.shape[1]]
    part = floor.part(data, fitted_on)
    tones = _tones(plant, data, base)
    hums = {tone.channel for tone in tones}
    marks = _marks(plant, part, base[fitted_on])
    known = traces.betrayed([m for m in marks if m.channel not in hums], pool)
    if any(k.candidate.effect == "force_dropout" for k in known):
        data = floor.without_repeats(data)
        part = floor.part(data, fitted_on)
    ranked = select.select(
        predict,
        part,
        fitted_on,
        pool,
        hypotheses.terms(plant),
        base[fitted_on],
        known,
        steps=on.commands.shape[1] * math.ceil(plant.period / plant.max_timestep),
        out_of_time=lambda: budget is not None and time.monotonic() - begun > budget,
        tick=tick,
    )
    judged = verdict.judge(ranked, strange=bool(tones))
    best = ranked.fits[judged.rivals[0]]
    following = None
    if judged.kind == "ambiguous":
        tick("next motion", 1)
        following = next_motion(
            plant,
            trials[0],
            part,
            ranked.weight,
            [ranked.fits[k] for k in judged.rivals],
            [judged.probability[k] for k in judged.rivals],
            seed=seed,
            threads=threads,
            until=None if budget is None else begun + budget,
        )
    tick("writing", 1)
    left_open = _left_open(plant, ranked)
    if left_open:
        base = predict.all_trials([left_open[_nominal(ranked)]], everything)[0]
    repaired = base
    if best.parts:
        known_along = left_open.get(judged.rivals[0], ())
        repaired = predict.all_trials([(*best.effects(), *known_along)], everything)[0]
    where = locate.locate(data, base, phase, plant.period, seed)
    left = locate.locate(data, repaired, phase, plant.period, seed)
    explanations = [
        _explanation(predict, data, base, fit, float(p), validation or fitted_on, left_open.get(k, ()))
        for k, (fit, p) in enumerate(zip(ranked.fits, judged.probability, strict=True))
    ]
    explanations = [
        dataclasses.replace(one, evidence=verdict.option(fit, ranked).evidence)
        for one, fit in zip(explanations, ranked.fits, strict=True)
    ]
    shown = [k for k in judged.rivals if ranked.fits[k].parts or judged.kind == "no_gap"]
    if judged.kind == "no_gap":
        shown = shown[:1]
    notes = []
    if len(trials) > asis:
        notes.append(
            f"The recording was cut into {len(trials)} trials: at its rests, or where it has too few of them into "
            "parts with gaps between them."
        )
    if not test:
        notes.append("There is no test trial, so no share of the gap can be said to be closed: record more than one.")
    if any(trial.efforts for trial in trials):
        notes.append(
            "Measured efforts are not compared where commands can be replayed: servos report them in many ways."
        )
    notes += [
        f"{tone.channel} swings at about {tone.frequency:.3g} Hz (or faster, seen at this rate) by "
        f"±{tone.amplitude:.2g} even where nothing is touched: mains hum, or a vibration; no effect of the library "
        "does that."
        for tone in tones
    ]
    if not ranked.complete:
        notes.append("The time budget ran out: what is said is the best so far.")
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
        stage=_stage(best) if best.parts and judged.kind != "unknown" else locate.stage(where),
        shrink=shrink.shrink(data, base, repaired, phase, test, period=plant.period, seed=seed),
        ranking=tuple(explanations),
        findings=tuple(findings),
        next_motion=following,
        splits=splits,
        robot=plant.name,
        complete=ranked.complete,
        seed=seed,
        version=tiago_mj.__version__,
        seconds=time.monotonic() - begun,
        overlays=tuple(
            _overlay(plant, trials[k], data, base, repaired, phase, k) for k in (test or everything)[:OVERLAYS]
        ),
        notes=tuple(notes),
    )
    return task.told(found, asked, tick)


def _cut(plant: Plant, trials: Sequence[Trial]) -> Sequence[Trial]:
    """A lone long recording of a plain model as several trials; where an object is about, nobody knows how it stood in
    between."""
    if len(trials) > 1 or plant.environment is not None or not trials[0].commands:
        return trials
    return trials if _torques_along_a_motion(trials) else cut(trials[0])


def _torques_along_a_motion(trials: Sequence[Trial]) -> bool:
    """Whether what is commanded is the efforts of joints whose motion was measured.

    Nothing pulls such a joint back to where it was, so that a replay of its commands adds up every error of torque;
    along the measured motion torques are compared with torques.
    """
    return all(
        trial.sidecar.interface == "effort" and bool(trial.commands) and set(trial.commands) <= set(trial.positions)
        for trial in trials
    )


def _along_the_motion(
    plant: Plant, trials: Sequence[Trial], findings: Sequence[Finding], seed: int, names: Sequence[str] | None
) -> Diagnosis:
    """Explain the efforts along the measured motion, or the commands where they are efforts."""
    if _torques_along_a_motion(trials):
        trials = [replace(trial, efforts={**trial.commands, **trial.efforts}) for trial in trials]
    known = {plant.model.joint(j).name for j in range(plant.model.njnt)}
    joints = [name for name in dict.fromkeys(n for trial in trials for n in trial.efforts) if name in known]
    if not joints:
        raise RecordingError(
            f"{trials[0].source}: no command and no effort of a joint of this robot: nothing can be replayed; add "
            "command.<actuator>, or effort.<joint>"
        )
    return diagnose_inverse(
        tuple(trials),
        plant.model,
        joints,
        findings=findings,
        robot=plant.name,
        seed=seed,
        version=tiago_mj.__version__,
        names=names,
    )


def _tones(plant: Plant, data: floor.Data, base: Array) -> list[traces.Tone]:
    """Of the load cells, where they are predicted to feel nothing."""
    if plant.cell is None:
        return []
    nothing, noises = plant.cell.signal(np.zeros(2)), plant.cell.noises
    found = [
        traces.tone(name, data.value[:, :, c], base[:, :, c] == nothing[part], plant.period, float(noises[part]))
        for c, (name, part) in enumerate(zip(data.channels, data.part, strict=True))
        if name.startswith("force")
    ]
    return [tone for tone in found if tone is not None]


def _marks(plant: Plant, data: floor.Data, base: Array) -> list[traces.Trace]:
    known = plant.cell is not None and plant.cell.average == 1
    noises = plant.cell.noises if plant.cell is not None and known else np.zeros(2)
    return [
        traces.trace(
            name,
            data.value[:, :, c],
            phases.still(base[:, :, c]),
            float(noises[data.part[c]]) if name.startswith("force") else 0.0,
        )
        for c, name in enumerate(data.channels)
    ]


def _left_open(plant: Plant, ranked: select.Ranked) -> dict[int, tuple[Entry, ...]]:
    """What the recordings themselves say is not known of the model, as each explanation has it, by its index: neither
    a gap nor an effect, so that before and after have it, each its own. Empty where nothing is said."""
    stated = {name for name, _ in plant.known}
    if not stated:
        return {}
    shared = [term for term in hypotheses.terms(plant) if not term.per_trial]
    return {
        k: tuple(
            term.entry(float(size))
            for term, size in zip(shared, fit.nuisance, strict=False)
            if term.effect in stated and size
        )
        for k, fit in enumerate(ranked.fits)
    }


def _nominal(ranked: select.Ranked) -> int:
    """Index of the explanation that names nothing beyond what readings betray."""
    return next(k for k, fit in enumerate(ranked.fits) if len(fit.parts) == ranked.known)


def _stage(best: Fitted) -> str:
    return EFFECTS[best.parts[0].effect].stage


def _explanation(
    predict: Predictor,
    data: floor.Data,
    base: Array,
    fit: Fitted,
    probability: float,
    judged_on: Sequence[int],
    along: tuple[Entry, ...],
) -> Explanation:
    index = list(judged_on)
    gain = 0.0
    if fit.parts:
        after = predict.all_trials([(*fit.effects(), *along)], index)[0]
        gain = _gap(data, base, index) - _gap(data, after, index, rows=True)
    return Explanation(tuple(_named(predict.plant, fit, k) for k in range(len(fit.parts))), probability, gain)


def _gap(data: floor.Data, predicted: Array, trials: Sequence[int], rows: bool = False) -> float:
    """Mean squared residual in units of the floor; ``rows``: the predictions are of these trials alone."""
    index = list(trials)
    residual = (data.value[index] - (predicted if rows else predicted[index])) / data.noise
    return float(np.nanmean(residual**2))


def _named(plant: Plant, fit: Fitted, k: int) -> Named:
    part = fit.parts[k]
    declared = EFFECTS[part.effect]
    target: str | tuple[str, ...] = "all"
    if part.target is not None:
        target = part.target[0] if len(part.target) == 1 else part.target
    value, sd = float(fit.values[k]), float(fit.deviations[k])
    reach = NINETY * sd * (verdict.calibration().widens if part.spread is None else 1.0)
    low, high = max(value - reach, part.low), min(value + reach, part.high)
    parameters: dict[str, Value] = {part.parameter: Value(value, low, high, part.unit, sd)}
    for name, fixed in part.fixed:
        index = 0 if part.target is None else plant.wiring.targets.names(declared.targets).index(part.target[0])
        side = 0 if plant.wiring.targets.slide(declared.targets, index) else 1
        parameters[name] = Value(fixed, None, None, declared.parameters[name].unit[side])
    return Named(part.effect, target, parameters)


def _overlay(
    plant: Plant, trial: Trial, data: floor.Data, base: Array, repaired: Array, phase: NDArray[np.int_], k: int
) -> Overlay:
    rows = len(trial.time)
    units: Mapping[str, Callable[[int], str]] = {
        "position": lambda j: "m" if plant.wiring.targets.slides[j] else "rad",
        "velocity": lambda j: "m/s" if plant.wiring.targets.slides[j] else "rad/s",
        "force": lambda j: "sensor units",
    }

    def signals(values: Array) -> dict[str, Array]:
        return {name: values[k, :rows, c] for c, name in enumerate(data.channels)}

    return Overlay(
        trial=trial.name,
        time=trial.time,
        phases=phase[k, :rows],
        measured=signals(data.value),
        nominal=signals(base),
        repaired=signals(repaired),
        units={name: units[name.partition(".")[0]](int(j)) for name, j in zip(data.channels, data.part, strict=True)},
        floor={name: float(noise) for name, noise in zip(data.channels, data.noise, strict=True)},
    )
