"""A case made again and made ready to be fitted, as a diagnosis does it up to its search; and what is true of it."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import Made
from benchmarks.blind.dictionary import PLAIN
from benchmarks.experiments.kept_cases import Kept
from tiago_mj.gap.detectors import readings, ripples, set_points
from tiago_mj.gap.detectors.readings import Known
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.likelihood import NUISANCE_BOUND
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import Predictor, predictor
from tiago_mj.gap.search.beginning import SENSITIVITY_DEVIATION, SENSITIVITY_DRAWS
from tiago_mj.gap.simulation import sizes
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.gap.simulation.session import split
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings

Array = NDArray[np.float64]


@dataclass
class Opened:
    """A case that can be fitted.

    Attributes:
        kept: which.
        made: the reality that it was recorded in.
        plant: the nominal simulator.
        predict: simulations.
        data, base: measured, and the nominal predictions, of all trials.
        trials: those that a diagnosis fits.
        pool: candidates of the whole library.
        terms: nominal numbers, those that trials share first.
        known: what the readings betray by themselves.
        seen: what the servos' motion says.
        steps: physics steps of a trial.
    """

    kept: Kept
    made: Made
    plant: Plant
    predict: Predictor
    data: Data
    base: Array
    trials: list[int]
    pool: tuple[Candidate, ...]
    terms: tuple[Term, ...]
    known: tuple[Known, ...]
    seen: ServoMotion | None
    steps: int

    def part(self) -> tuple[Data, Array]:
        """Measured and predicted, of the trials that are fitted."""
        return noise_model.select_trials(self.data, self.trials), self.base[self.trials]

    def candidates(self, name: str, target: tuple[str, ...] | None) -> list[Candidate]:
        """Candidates of an effect on targets, one for each of their fixed numbers and forms."""
        return [c for c in self.pool if c.label == (name, target)]


def open_case(kept: Kept) -> Opened:
    """Record a case again and prepare it; on one thread."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        made = cases.simulate(kept.case, _with_model(kept, root))
        made.folder = None
        recordings.write(made, root)
        read = read_recordings([root])
        plant = plant_of(read.trials)
        robot = made.robot
        findings = (*read.findings, *lint.inspect_all(read.trials, plant))
        usable = frozenset.intersection(*(lint.usable(trial, findings) for trial in read.trials))
    trials = read.trials
    names = split([trial.name for trial in trials])
    fitted_on = [k for k, t in enumerate(trials) if t.name not in names["test"]]
    predict, nominal = predictor(plant, trials, usable, threads=1)
    data = predict.data
    fastest = np.abs(nominal.velocity).max(axis=(0, 1))
    pool = hypotheses.candidates(plant, None, fastest, sizes.sizes(plant, trials, nominal))
    seen = set_points.servo_motion(plant, predict.on, data, nominal)
    if seen is not None:
        pool = set_points.magnitudes(plant, predict.on, seen, pool, fitted_on)
    base = predict.all_trials([()], list(range(len(trials))), keep=True)[0]
    untouched = set_points.untouched(data, nominal, data.value.shape[1])
    part = noise_model.select_trials(data, fitted_on)
    share = set_points.shares(plant, seen)
    pool = ripples.with_periods(plant, part, base[fitted_on], untouched[fitted_on], share, pool)
    hums = {tone.channel for tone in readings.tones(plant, data, base)}
    marks = readings.of_channels(plant, part, base[fitted_on])
    known = readings.measured_on_readings([m for m in marks if m.channel not in hums], pool)
    if any(k.candidate.effect == "force_dropout" for k in known):
        data = noise_model.without_repeats(data)
    terms = tuple(sorted(hypotheses.terms(plant), key=lambda term: term.per_trial))
    steps = predict.on.commands.shape[1] * math.ceil(plant.period / plant.max_timestep)
    made.robot = robot
    return Opened(kept, made, plant, predict, data, base, fitted_on, pool, terms, known, seen, steps)


def _with_model(kept: Kept, root: Path) -> Path:
    if kept.case.setting == PLAIN:
        (root / robots.PLAIN_FILE).write_text(robots.PLAIN)
    return root


def true_parts(opened: Opened) -> tuple[tuple[Candidate, ...], Array]:
    """The case's own effects as candidates whose fixed numbers are the true ones, and their true magnitudes; without
    what the readings betray.

    Raises:
        ValueError: the library has no such effect for this robot.
    """
    parts, values = [], []
    betrayed = {k.candidate.effect for k in opened.known}
    for effect in opened.kept.case.effects:
        if effect.name in betrayed:
            continue
        target = None if effect.target == "all" else tuple(effect.target)
        mine = opened.candidates(effect.name, target)
        if not mine:
            raise ValueError(f"{opened.kept.name}: no candidate for {effect.name} on {effect.target}")
        true = {**effect.parameters}
        chosen = min(mine, key=lambda c: sum(abs(np.log(true[n] / v)) for n, v in c.fixed if n in true and v))
        fixed = tuple((name, true.get(name, value)) for name, value in chosen.fixed)
        parts.append(replace(chosen, fixed=fixed))
        values.append(float(np.clip(true[chosen.parameter], chosen.low, chosen.high)))
    return tuple(parts), np.array(values)


def true_nuisance(opened: Opened, fitter: Fitter) -> Array:
    """What the real robot's numbers are in deviations of the nominal model's, (size,), as far as both have them."""
    case, real, setup = opened.kept.case, opened.made.robot, opened.made.setup
    with tempfile.TemporaryDirectory() as folder:
        root = _with_model(opened.kept, Path(folder))
        nominal = robots.robot_of(case.setting, robots.Jitter(np.random.default_rng(0), 0.0), folder=root)
        real = cases.real_robot(case, root)
    joints, dof = list(real.joints), real.dof
    tool = opened.plant.wiring.tool
    plain = case.setting == PLAIN  # its link's mass is a number of its own, a finger's is part of its inertia
    own = "dof_armature" if plain else "dof_M0"
    inertia = getattr(real.model, own) - getattr(nominal.model, own)
    out = np.zeros(fitter.size)
    for k, term in enumerate(fitter.terms):
        name = (term.target or ("",))[0]
        j = joints.index(name) if name in joints else -1
        value = {
            "servo_stiffness": lambda j=j: real.stiffness[j] / nominal.stiffness[j],
            "servo_damping": lambda j=j: real.damping[j] - nominal.damping[j],
            "viscous_friction": lambda j=j: real.model.dof_damping[dof[j]] - nominal.model.dof_damping[dof[j]],
            "armature": lambda j=j: inertia[dof[j]],
            "force_limit": lambda j=j: min(real.limit[j], nominal.limit[j]),
            "payload": lambda: plain * (real.model.body_subtreemass[tool] - nominal.model.body_subtreemass[tool]),
            "contact_stiffness": lambda: real.item.stiffness / nominal.item.stiffness,
            "contact_damping": lambda: real.item.damping / nominal.item.damping,
            "contact_friction": lambda: real.item.friction / nominal.item.friction,
            "object_mass": lambda: real.item.mass / nominal.item.mass,
            "object_size": lambda: (real.item.width - nominal.item.width) / 2,
            "force_gain": lambda name=name: (
                real.units[("right", "left").index(name)] / nominal.units[("right", "left").index(name)]
            ),
            "object_offset": lambda: setup.offsets[list(fitter.trials)] - case.offset,
        }.get(term.effect)
        of_object = term.effect.startswith(("contact_", "object_", "force_gain"))
        if value is None or (of_object and real.item is None):
            continue
        away = np.atleast_1d(value())
        for place, one in zip(
            fitter.nuisance_indices(k), np.broadcast_to(away, len(fitter.nuisance_indices(k))), strict=True
        ):
            out[place] = np.clip(term.deviations(float(one)), -NUISANCE_BOUND, NUISANCE_BOUND)
    return out


def judge(opened: Opened, predict: Predictor, weight: Array, trials: Sequence[int]) -> Fitter:
    """What all explanations of a case are compared by: one weight, one tolerance, all nominal numbers."""
    rows = [opened.trials.index(t) for t in trials]
    data = noise_model.select_trials(opened.part()[0], rows)
    shape = (len(opened.terms), *data.value.shape)
    given = tuple(k.candidate.entry(k.value) for k in opened.known)
    return Fitter(predict, tuple(trials), data, weight, opened.terms, np.zeros(shape), given)


def with_scatter(fitter: Fitter, fit: Fitted) -> Fitter:
    """With the tolerance of how far predictions part that nothing tells apart, as a search has it."""
    rng = np.random.default_rng(fitter.predict.seed)
    moved = fit.nuisance + SENSITIVITY_DEVIATION * rng.standard_normal((SENSITIVITY_DRAWS, fitter.size))
    points = [Point(fit.parts, fit.values, one) for one in (fit.nuisance, *moved)]
    return replace(fitter, data=noise_model.with_scatter(fitter.data, fitter.predictions(points)))
