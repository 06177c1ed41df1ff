"""How fast a gap is diagnosed: a 5-parameter fit beside MuJoCo's own ``mujoco.sysid``, and whole diagnoses.

    pip install 'tiago-mj[gap,bench]'
    python benchmarks/diagnosis_speed.py fit
    python benchmarks/diagnosis_speed.py diagnose

``fit``: ten grasps of 300 steps are recorded with five numbers of the gripper off, drawn anew for each of the sets, and
both tools look for the five in one run: same model, same recordings with their sensor noise, same start, bounds and
standard deviations of the samples, all processors for both. Predictions of both at the truth are compared first: they
must be of the same simulator. ``mujoco.sysid`` is given what it offers, several ways:

* ``documented``: modifiers of an MjSpec, one rollout a trial, its own optimizer and defaults, as its README shows;
* ``mujoco``: a ``build_model`` that writes the five into a copy of the compiled model, which saves compiling; all
  trials and all columns of the Jacobian in one parallel rollout; parameters in units of their range, differences over
  a share of it (``eps``), since contacts begin and end at single physics steps; ``x_scale="jac"``;
* ``scipy``: the same with SciPy's optimizer and MuJoCo's parallel Jacobian, without ``x_scale``.

Ours is the diagnosis' own fit, once without the nominal model's uncertainty, as sysid has none, and once with it
(``with nuisances``, begun where the fit without them ended). ``documented`` is run on the first set alone. Errors are
shares of the true values. A cost is half the sum of squares of the whitened residual beyond that at the truth: noise is
fitted a little, so the best is below 0.

``diagnose``: the command in a process of its own, whole library of effects, ten trials of 300 steps, with one effect
and with two: seconds and peak memory; whether ``--jobs 1`` says the same; how well ``--time-budget`` is kept.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # BLAS must not fight the rollouts
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium
import mujoco
import numpy as np
from machine import save
from numpy.typing import NDArray

import tiago_mj  # noqa: F401
from tiago_mj.effects.transmission.friction import STICKING_SOLIMP, STICKING_SOLREF
from tiago_mj.gap.inference import hypotheses, likelihood, noise_model
from tiago_mj.gap.inference.fit import Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.models import compliance, names, scene
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.recordings.recording import Trial
from tiago_mj.rollout.policies import make_policy

Array = NDArray[np.float64]

TRIALS = 10
#: What is off, between which values: all are MuJoCo model fields or a gain, so that sysid can express them.
OFF = {
    "coulomb_friction": ("force", 1.0, 3.0),
    "viscous_friction": ("damping", 20.0, 80.0),
    "servo_stiffness": ("factor", 0.6, 0.9),
    "contact_stiffness": ("factor", 0.3, 0.8),
    "contact_damping": ("factor", 1.5, 4.0),
}
#: A start on a bound is moved inwards by this share of the range: mujoco.sysid advises so (``move_off_bound``).
OFF_BOUND = 0.05
#: Ours is told that it begins far off: magnitudes are moved by 2 % of their range at least, as sysid's ``eps``.
FROM_FAR: dict[str, Any] = {"iterations": 25, "settled": 0.01, "reach": 0.02}
EPS = (0.01, 0.02)
ONE = {"coulomb_friction": {"force": 3.0}}
TWO = {"coulomb_friction": {"force": 3.0}, "command_delay": {"seconds": 0.03}}


@dataclass(frozen=True)
class Case:
    """A set of recordings, what is to be found, and what both tools are given."""

    plant: Plant
    on: replay.Grid
    data: noise_model.Data
    weight: Array
    base: Array
    parts: tuple[Candidate, ...]
    terms: tuple[Term, ...]
    truth: Array
    start: Array
    predict: Predictor

    def bounds(self) -> tuple[Array, Array]:
        return np.array([p.low for p in self.parts]), np.array([p.high for p in self.parts])

    def cost(self, predicted: Array) -> float:
        """Half the sum of squares of the whitened residual, which both minimise."""
        return float(0.5 * (likelihood.whiten(self.data, self.data.value - predicted, self.weight) ** 2).sum())

    def predicted(self, values: Array) -> Array:
        entries = tuple(p.entry(float(v)) for p, v in zip(self.parts, values, strict=True))
        predicted: Array = self.predict.all_trials([entries], range(TRIALS))[0]
        return predicted


def recordings(effects: dict[str, dict[str, float]], seed: int) -> list[Trial]:
    plan = Plan("tiago_mj/GripperTactile-v0", {}, effects, None, "pi")
    return list(record(plan, lambda env: make_policy("pi", env, seed=seed, trust=False), episodes=TRIALS, seed=seed))


def make_case(seed: int) -> Case:
    rng = np.random.default_rng(seed)
    truth = np.array([rng.uniform(low, high) for _, low, high in OFF.values()])
    effects = {name: {OFF[name][0]: float(v)} for name, v in zip(OFF, truth, strict=True)}
    trials = recordings(effects, 1000 * seed)
    plant = plant_of(trials)
    on, data = replay.grid(plant, trials), noise_model.collect(plant, trials)
    data = replace(data, common=np.zeros_like(data.common), block=1)  # sysid knows errors of single samples only
    predict = Predictor(plant, on, data)
    base = predict.all_trials([()], range(TRIALS))[0]
    pool = {c.effect: c for c in hypotheses.candidates(plant, OFF) if c.target is None}
    parts = tuple(pool[name] for name in OFF)
    low, high = (np.array([getattr(p, side) for p in parts]) for side in ("low", "high"))
    start = np.clip([p.identity for p in parts], low + OFF_BOUND * (high - low), high - OFF_BOUND * (high - low))
    weight = likelihood.independence(data, base)
    terms = tuple(sorted(hypotheses.terms(plant), key=lambda term: term.per_trial))
    return Case(plant, on, data, weight, base, parts, terms, truth, start, predict)


def ours(case: Case, terms: Sequence[Term] = ()) -> Callable[[], tuple[Array, int]]:
    """A fit, ready to run: values (5,) and the number of simulations."""
    chosen, predict = Subset.of(range(TRIALS)), Predictor(case.plant, case.on, case.data)

    def run() -> tuple[Array, int]:
        predict.runs = 0
        alone = Fitter(predict, chosen, case.data, case.weight, (), np.zeros((0, *case.base.shape)), **FROM_FAR)
        fitted = alone.fit_all([Start(case.parts, case.start)])[0]
        if terms:  # as the diagnosis does: from a fit nearby, with the nuisances' responses around it
            responses = predict.all_trials([(term.entry(1.0),) for term in terms], chosen) - case.base
            whole = Fitter(predict, chosen, case.data, case.weight, tuple(terms), responses, **FROM_FAR)
            whole = whole.linearized_at(Point(case.parts, fitted.values, np.zeros(whole.size)))
            fitted = whole.fit_all([Start(case.parts, fitted.values)])[0]
        return fitted.values, predict.runs

    return run


class Sysid:
    """The same problem for ``mujoco.sysid``.

    Args:
        case: the recordings.
        fields: write into a copy of the compiled model instead of compiling a changed spec.
        batched: all trials and all columns in one rollout.
        settings: of ``mujoco.sysid.optimize``.
    """

    def __init__(self, case: Case, *, fields: bool, batched: bool, normalised: bool = False, **settings: Any) -> None:
        from mujoco import sysid

        self.case, self.batched, self.settings, self.runs = case, batched, settings, 0
        plant = case.plant
        assert plant.environment is not None
        assert plant.cell is not None
        arguments = {key: value for key, value in plant.environment.items() if key != "id"}
        self.spec, _ = scene.build_spec(gymnasium.make(plant.environment["id"], **arguments).unwrapped._scene)  # type: ignore[attr-defined]
        self.item = plant.starts[case.on.trials[0].name].item
        assert self.item is not None
        self.substeps = round(plant.period / plant.model.opt.timestep)
        low, high = case.bounds()
        self.unit = high - low if normalised else np.ones(len(low))
        self.params = sysid.ParameterDict()
        for k, name in enumerate(OFF):
            modify = None if fields else _plain(getattr(self, f"_{name}", None))
            self.params.add(
                sysid.Parameter(name, *(v[k] / self.unit[k] for v in (case.start, low, high)), modifier=modify)
            )
        model = plant.model
        states, controls, measured = [], [], []
        time = np.arange(case.on.commands.shape[1] * self.substeps + 1) * model.opt.timestep
        mapping = sysid.TimeSeries.compute_all_sensor_mapping(model)
        for k, trial in enumerate(case.on.trials):
            begin = plant.starts[trial.name]
            states.append(sysid.create_initial_state(model, begin.qpos, begin.qvel, begin.set_point))
            held = np.repeat(case.on.commands[k], self.substeps, axis=0)
            controls.append(sysid.TimeSeries(time, np.vstack([held, held[-1:]])))  # the last one is not applied
            # What the cells measured is compared in `_compare`, in the recordings' own units: here is only the trial.
            measured.append(sysid.TimeSeries(time[:1], np.full((1, model.nsensordata), float(k)), mapping))
        group = sysid.ModelSequences("gripper", self.spec, [t.name for t in case.on.trials], states, controls, measured)
        if batched:
            group.measured_rollout = [group.measured_rollout]  # a rollout takes a list, too
        self._residual = sysid.build_residual_fn(
            models_sequences=[group],
            build_model=self._model if fields else self._compiled,
            modify_residual=self._compare,
            n_threads=os.cpu_count() or 1,
            resample_true=False,
        )
        self._sysid = sysid

    def __call__(self) -> tuple[Array, int]:
        """Values (5,) and the number of simulations."""
        self.runs = 0
        found, _ = self._sysid.optimize(self.params, self._columns, verbose=False, **self.settings)
        return found.as_vector() * self.unit, self.runs

    def residual(self, values: Array) -> Array:
        return np.concatenate(self._columns(values / self.unit, self.params.copy())[0])

    def _columns(self, x: Array, params: Any) -> Any:
        self.runs += TRIALS * (x.shape[1] if x.ndim > 1 else 1)
        residuals, predicted, measured = self._residual(x, params)
        if self.batched and x.ndim > 1:  # (rows, columns · trials) of a rollout of several trials
            whole = residuals[0].reshape(-1, x.shape[1], TRIALS)
            residuals = [whole.transpose(2, 0, 1).reshape(-1, x.shape[1])]
        return residuals, predicted, measured

    def _compare(self, params: Any, predicted: Any, measured: Any, model: Any, return_all: bool, **more: Any) -> Any:
        """Whitened residual of a trial, (T, C): what :class:`Fitter` minimises."""
        case, plant = self.case, self.case.plant
        assert plant.pads is not None
        assert plant.cell is not None
        trial, rows = int(measured.data[0, 0]), slice(self.substeps - 1, None, self.substeps)
        state = more["state"][rows, 1:]
        position, velocity = state[:, plant.wiring.qpos], state[:, plant.model.nq + plant.wiring.dof]
        reading = plant.cell.signal(plant.pads.read(predicted.data[rows]))
        signals = {"position": position, "velocity": velocity, "force": reading}
        values = np.stack(
            [signals[kind][:, part] for kind, part in zip(case.data.kinds, case.data.part, strict=True)], axis=-1
        )
        white = (case.data.value[trial, 1:] - values) / case.data.sigma[trial, 1:] * case.weight
        return np.where(np.isfinite(case.data.value[trial, 1:]), white, 0.0), measured, measured

    def _model(self, params: Any, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """The five fields in a copy of the nominal model."""
        model, wiring = copy.copy(self.case.plant.model), self.case.plant.wiring
        model.dof_frictionloss[wiring.dof] += self._value(params["coulomb_friction"])
        model.dof_solimp[wiring.dof], model.dof_solref[wiring.dof] = STICKING_SOLIMP, STICKING_SOLREF
        model.dof_damping[wiring.dof] += self._value(params["viscous_friction"])
        model.actuator_gainprm[wiring.actuators, 0] *= self._value(params["servo_stiffness"])
        model.actuator_biasprm[wiring.actuators, 1] *= self._value(params["servo_stiffness"])
        return self._soft(model, self._value(params["contact_stiffness"]), self._value(params["contact_damping"]))

    def _compiled(self, params: Any, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """The spec with the modifiers applied; the contact's law needs the compiled masses."""
        model = self._sysid.apply_param_modifiers(params, spec)
        return self._soft(model, self._value(params["contact_stiffness"]), self._value(params["contact_damping"]))

    def _value(self, parameter: Any) -> float:
        return float(parameter.value[0] * self.unit[list(OFF).index(parameter.name)])

    def _soft(self, model: mujoco.MjModel, stiffness: float, damping: float) -> mujoco.MjModel:
        assert self.item is not None
        asked = compliance.Compliance(self.item.stiffness * stiffness, self.item.damping * damping)
        points, step = scene.CONTACT_POINTS[self.item.shape], model.opt.timestep
        for side in names.SIDES:
            pair = model.pair(f"{side}_pad_object").id
            bodies = model.geom_bodyid[[model.pair_geom1[pair], model.pair_geom2[pair]]]
            weight = float(model.body_invweight0[bodies, 0].sum())
            least = compliance.least_impedance(asked, weight, contact_points=points, timestep=step)
            impedance = max(float(least), compliance.DEFAULT_IMPEDANCE)
            compliance.set_pair_compliance(model, pair, asked, impedance=impedance, contact_points=points)
        return model

    def _coulomb_friction(self, spec: mujoco.MjSpec, parameter: Any) -> None:
        for name in names.FINGERS:
            spec.joint(name).frictionloss = self._value(parameter)
            spec.joint(name).solimp_friction, spec.joint(name).solref_friction = STICKING_SOLIMP, STICKING_SOLREF

    def _viscous_friction(self, spec: mujoco.MjSpec, parameter: Any) -> None:
        for name, dof in zip(names.FINGERS, self.case.plant.wiring.dof, strict=True):
            spec.joint(name).damping[0] = self.case.plant.model.dof_damping[dof] + self._value(parameter)

    def _servo_stiffness(self, spec: mujoco.MjSpec, parameter: Any) -> None:
        for name, index in zip(names.FINGERS, self.case.plant.wiring.actuators, strict=True):
            gain = self.case.plant.model.actuator_gainprm[index, 0] * self._value(parameter)
            spec.actuator(name).gainprm[0], spec.actuator(name).biasprm[1] = gain, -gain


def _plain(method: Any) -> Any:
    """A function of a method: parameters are copied deeply, and what a method is bound to cannot be."""
    return None if method is None else lambda spec, parameter: method(spec, parameter)


def fit(seeds: Sequence[int]) -> dict[str, Any]:
    rows = []
    for seed in seeds:
        case = make_case(seed)
        at_truth = case.predicted(case.truth)
        white = likelihood.whiten(case.data, case.data.value - at_truth, case.weight)[:, 1:]
        fast: dict[str, Any] = {"fields": True, "batched": True, "normalised": True}
        runs: dict[str, Callable[[], tuple[Array, int]]] = {
            "ours": ours(case),
            "ours with nuisances": ours(case, case.terms),
        }
        if seed == seeds[0]:  # slow, and lost where it begins
            runs["documented"] = Sysid(case, fields=False, batched=False, optimizer="mujoco")
        for eps in EPS:
            runs[f"mujoco {eps}"] = Sysid(case, **fast, eps=eps, x_scale="jac", optimizer="mujoco")
            runs[f"scipy {eps}"] = Sysid(case, **fast, diff_step=eps, optimizer="scipy_parallel_fd")
        for name, run in runs.items():
            if isinstance(run, Sysid):
                difference = float(np.abs(run.residual(case.truth) - white.ravel()).max())
                if difference > 1e-9:
                    raise RuntimeError(f"{name} simulates something else: residuals differ by {difference:.2g}")
        for name, run in runs.items():
            begun = time.perf_counter()
            values, simulations = run()
            seconds = time.perf_counter() - begun
            row: dict[str, Any] = {
                "seed": seed,
                "tool": name,
                "seconds": seconds,
                "simulations": simulations,
                "cost": case.cost(case.predicted(values)) - case.cost(at_truth),
                "errors": dict(zip(OFF, np.abs(values / case.truth - 1).round(5).tolist(), strict=True)),
                "load": os.getloadavg()[0],
            }
            rows.append(row)
            print(
                f"{seed} {name:20}{row['seconds']:7.2f} s{simulations:7d}  cost {row['cost']:10.2f}",
                row["errors"],
                flush=True,
            )
    table: dict[str, Any] = {}
    for name in dict.fromkeys(row["tool"] for row in rows):
        mine = [row for row in rows if row["tool"] == name]
        errors = np.array([list(row["errors"].values()) for row in mine])
        table[name] = {
            "seconds": float(np.median([row["seconds"] for row in mine])),
            "simulations": float(np.median([row["simulations"] for row in mine])),
            "cost": float(np.median([row["cost"] for row in mine])),
            "errors": dict(zip(OFF, np.median(errors, axis=0).round(5).tolist(), strict=True)),
            "worst_error": float(np.median(errors.max(axis=1))),
        }
    for name, entry in table.items():
        entry["seconds_of_ours"] = entry["seconds"] / table["ours"]["seconds"]
        print(f"{name:20}{entry['seconds']:7.2f} s, {entry['seconds_of_ours']:5.2f} of ours", entry["errors"])
    return {"off": {k: list(v) for k, v in OFF.items()}, "settings": FROM_FAR, "median": table, "rows": rows}


def diagnose() -> dict[str, Any]:
    out: dict[str, Any] = {"load": os.getloadavg()[0]}
    with tempfile.TemporaryDirectory() as folder:
        for name, effects in (("one effect", ONE), ("two effects", TWO)):
            where = Path(folder) / name.replace(" ", "_")
            command = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", str(TRIALS)]
            answers: dict[str, Any] = {}
            _command([*command, "--effects", json.dumps(effects), "--out", str(where)])
            for label, more in (("all", []), ("jobs 1", ["--jobs", "1"]), ("budget 5 s", ["--time-budget", "5"])):
                seconds, memory = _command(
                    ["diagnose", str(where), "--out", str(where) + label.replace(" ", "_"), *more]
                )
                said = json.loads((Path(str(where) + label.replace(" ", "_")) / "diagnosis.json").read_text())
                row = {"seconds": seconds, "peak_mb": memory, "load": os.getloadavg()[0], "verdict": said["verdict"]}
                answers[label] = _timeless(said)
                if label == "jobs 1":
                    row["same"] = answers[label] == answers["all"]
                out[f"{name}, {label}"] = row
                print(f"{name}, {label}:", row, flush=True)
    return out


def _command(words: Sequence[str]) -> tuple[float, float]:
    """Seconds and peak memory [MB] of ``tiago-mj`` in a process of its own."""
    begun = time.perf_counter()
    child = subprocess.Popen([sys.executable, "-m", "tiago_mj.cli", *words], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"tiago-mj {' '.join(words)} ended with {child.returncode}")
    return time.perf_counter() - begun, usage.ru_maxrss / 1024


def _timeless(said: Any) -> Any:
    """Without what may differ between two runs: how long they took, and the command itself."""
    if isinstance(said, dict):
        return {k: _timeless(v) for k, v in said.items() if k not in ("seconds", "command")}
    return [_timeless(v) for v in said] if isinstance(said, list) else said


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("part", choices=("fit", "diagnose"))
    parser.add_argument("--seeds", type=int, default=3, help="sets of recordings")
    parser.add_argument("--first", type=int, default=11, help="seed; settings of all tools were chosen on 1 to 3")
    arguments = parser.parse_args()
    results = fit(range(arguments.first, arguments.first + arguments.seeds)) if arguments.part == "fit" else diagnose()
    print("saved", save(f"diagnosis_speed_{arguments.part}", results).name)


if __name__ == "__main__":
    main()
