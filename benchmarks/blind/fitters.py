"""Black-box fitters on the same cases: every parameter of a list at once, by ``mujoco.sysid`` or by CMA-ES.

    python -m benchmarks.blind.fitters DIR --method sysid|cma [--cases N]

They fit the recordings of a run with the blind check's own nominal simulation and write an answer of the diagnosis's
form to ``cases/NNN/baselines/NAME.json``; the next ``python -m benchmarks.blind`` of that folder scores them beside the
diagnosis. A fitter names nothing by itself. What is taken for its answer is the reading that a user would make of the
fit: the parameter that the fit cannot do without on a trial that it has not seen; a second one where it matters nearly
as much; nothing where the fit gains little.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.blind import cases, reality, robots
from benchmarks.blind.dictionary import ARM, GRIPPER, PLAIN
from benchmarks.blind.effects import commands, friction, things
from benchmarks.blind.effects.base import Effect, World
from tiago_mj.io import atomic, extra
from tiago_mj.models import names

Array = NDArray[np.float64]

#: Trials that are fitted, and one that decides what mattered. The test trials are the oracle's.
FITTED: Final = (0, 2)
DECIDING: Final = (3,)
#: Least share of the loss that a fit must take away to have found something.
FOUND: Final = 0.2
#: A second parameter is named where it matters this much of the first.
SECOND: Final = 0.5
#: Size of every parameter, by setting; of factors, of their logarithm.
SIZES: Final[Mapping[str, Mapping[str, float]]] = {
    GRIPPER: {
        "servo_stiffness": 0.15,
        "viscous_friction": 20.0,
        "coulomb_friction": 1.0,
        "armature": 0.2,
        "contact_stiffness": 0.4,
        "contact_damping": 0.5,
        "object_mass": 0.4,
        "object_size": 1e-3,
        "object_offset": 2e-3,
        "force_gain": 0.15,
        "force_bias": 0.05,
        "encoder_bias": 3e-4,
        "command_delay": 0.02,
    },
    ARM: {
        "servo_stiffness": 0.15,
        "viscous_friction": 10.0,
        "coulomb_friction": 1.0,
        "armature": 0.3,
        "payload": 0.3,
        "encoder_bias": 3e-3,
        "command_delay": 0.02,
    },
    PLAIN: {
        "servo_stiffness": 0.15,
        "viscous_friction": 0.3,
        "coulomb_friction": 0.05,
        "armature": 0.01,
        "payload": 0.1,
        "encoder_bias": 0.01,
        "command_delay": 0.02,
    },
}
FACTORS: Final = frozenset({"servo_stiffness", "contact_stiffness", "contact_damping", "object_mass", "force_gain"})
#: Below nothing there is none of these.
POSITIVE: Final = frozenset({"coulomb_friction", "armature", "payload", "command_delay"})
PARAMETER: Final[Mapping[str, str]] = {
    **dict.fromkeys(FACTORS, "factor"),
    "viscous_friction": "damping",
    "coulomb_friction": "force",
    "armature": "mass",
    "payload": "mass",
    "object_size": "radius",
    "object_offset": "distance",
    "force_bias": "offset",
    "encoder_bias": "offset",
    "command_delay": "seconds",
}
_BUILDERS: Final[Mapping[str, type[Effect]]] = {
    "viscous_friction": friction.ViscousFriction,
    "armature": commands.Armature,
    "payload": things.Payload,
    "contact_stiffness": things.ContactStiffness,
    "contact_damping": things.ContactDamping,
    "object_mass": things.ObjectMass,
    "object_size": things.ObjectSize,
    "object_offset": things.ObjectOffset,
}


class _Delays(Effect):
    """Another delay in every simulation."""

    def __init__(self, seconds: Array) -> None:
        super().__init__({}, [])
        self._seconds = seconds

    def latency(self, world: World) -> Array:
        return np.tile(self._seconds[:, None], (1, world.q.shape[1]))


class Problem:
    """A case to fit: its recordings, and the nominal simulation of them with any parameters."""

    def __init__(self, folder: Path, setting: str) -> None:
        files = sorted(folder.glob("*.parquet"))
        tables = [pq.read_table(path) for path in files]
        self.side = [json.loads(path.with_suffix(".json").read_text()) for path in files]
        self.setting = setting
        self.names = tuple(SIZES[setting])
        jitter = robots.Jitter(np.random.default_rng(0), 0.0)
        self.nominal = robots.robot_of(setting, jitter, folder=folder)
        joints = self.nominal.joints
        wanted = [f"{kind}.{joint}" for kind in ("position", "velocity") for joint in joints]
        if self.nominal.pads is not None:
            wanted += [f"force.{side}" for side in names.SIDES]
        self.measured = np.stack([_columns(table, wanted) for table in tables])
        self.commands = np.stack([_columns(table, [f"command.{joint}" for joint in joints]) for table in tables])
        parts = [*self.nominal.noise, np.full(len(self.nominal.units), robots.FORCE_NOISE)]
        self.sigma = np.concatenate(parts)
        initial = self.side[0]["initial"]["set_point"]
        self.start = np.array([initial[joint] for joint in joints])

    def values(self, z: Array) -> dict[str, float]:
        """Parameters of a point of the search, (n,), whose origin is the nominal model."""
        out = {}
        for name, x in zip(self.names, z, strict=True):
            size = SIZES[self.setting][name]
            x = float(np.clip(x, 0.0 if name in POSITIVE else -8.0, 8.0))
            out[name] = float(np.exp(size * x)) if name in FACTORS else size * x
        return out

    def residuals(self, points: Array, trials: tuple[int, ...]) -> Array:
        """Residuals over the noise, (points, trials, T, channels), for points (k, n)."""
        values = [self.values(z) for z in points]
        several, count = [self._robot(v) for v in values], len(trials)
        delays = np.repeat([v["command_delay"] for v in values], count)
        index = list(trials)
        first = self.side[0]
        setup = reality.Setup(
            interface="direct" if self.setting == PLAIN else first["interface"],
            rate=float(first["rate_hz"]),
            rows=self.commands.shape[1] - 1,
            offsets=np.full(len(values) * count, first.get("object", {}).get("offset_m", 0.0)),
            start=np.tile(self.start, (len(values) * count, 1)),
            noise_seed=0,
            silent=True,
        )
        plan = np.tile(self.commands[index], (len(values), 1, 1))
        got = reality.run_built(robots.stack(several, count), [_Delays(delays)], setup, plan)
        q = got.position + np.repeat([v["encoder_bias"] for v in values], count)[:, None, None]
        x = got.force + np.repeat([v.get("force_bias", 0.0) for v in values], count)[:, None, None]
        predicted = np.concatenate([q, got.velocity, x], axis=2)
        shape = (len(values), count, *predicted.shape[1:])
        return (predicted.reshape(shape) - self.measured[index]) / self.sigma

    def loss(self, points: Array, trials: tuple[int, ...]) -> Array:
        """Mean squared residual of every point, (k,)."""
        return np.mean(self.residuals(points, trials) ** 2, axis=(1, 2, 3))

    def _robot(self, values: Mapping[str, float]) -> robots.Robot:
        robot = replace(self.nominal, model=copy.copy(self.nominal.model))
        columns = list(range(len(robot.joints)))
        robot.stiffness = robot.stiffness * values["servo_stiffness"]
        robot.units = robot.units * values.get("force_gain", 1.0)
        robot.model.dof_frictionloss[robot.dof] += values["coulomb_friction"]
        for name, builder in _BUILDERS.items():
            if name in values:
                builder({PARAMETER[name]: values[name]}, columns).build(robot)
        robot.model.dof_damping[:] = np.maximum(robot.model.dof_damping, 0.0)
        return robot


def _columns(table: Any, wanted: list[str]) -> Array:
    return np.stack([np.array(table[name].to_pylist(), dtype=np.float64) for name in wanted], axis=1)


def cma(problem: Problem) -> Array:
    """CMA-ES over all parameters."""
    library = extra.load("cma", "this baseline", "blind")
    options = {"popsize": 12, "maxiter": 40, "seed": 1, "verbose": -9}
    search = library.CMAEvolutionStrategy(np.zeros(len(problem.names)), 0.7, options)
    while not search.stop():
        points = np.array(search.ask())
        search.tell(list(points), list(np.log(problem.loss(points, FITTED)) + 1e-3 * np.mean(points**2, axis=1)))
    return np.array(search.result.xbest)


def sysid(problem: Problem) -> Array:
    """``mujoco.sysid.optimize`` (bounded least squares) over all parameters."""
    extra.load("colorama", "mujoco.sysid", "blind")  # without what its extra brings it loads, and holds nothing
    toolbox = extra.load("mujoco.sysid", "this baseline", "blind")
    wanted = toolbox.ParameterDict()
    for name in problem.names:
        low = -0.02 if name in POSITIVE else -8.0
        wanted.add(toolbox.Parameter(name, 0.0, low, 8.0))

    def residual(x: Array, _: Any) -> tuple[list[Array], None, None]:
        points = np.asarray(x).reshape(len(problem.names), -1).T
        flat = problem.residuals(points, FITTED).reshape(len(points), -1).T
        return [flat if np.ndim(x) > 1 else flat[:, 0]], None, None

    with contextlib.redirect_stdout(io.StringIO()):  # its optimizer tells every iteration
        _, result = toolbox.optimize(wanted, residual, verbose=False, max_iters=25)
    return np.asarray(result.x).ravel()


METHODS: Final[Mapping[str, Callable[[Problem], Array]]] = {"cma": cma, "sysid": sysid}


def answer(problem: Problem, method: str) -> dict[str, Any]:
    """What a user would read off a fit, in the form of a diagnosis."""
    begun = time.monotonic()
    z = METHODS[method](problem)
    origin = np.zeros_like(z)
    without = np.tile(z, (len(z), 1))
    np.fill_diagonal(without, 0.0)
    deciding = problem.loss(np.array([origin, z, *without]), DECIDING)
    nominal, fitted, worse = float(deciding[0]), float(deciding[1]), deciding[2:] - deciding[1]
    test = tuple(cases.TEST)
    before, after = (float(x) for x in problem.loss(np.array([origin, z]), test))
    effects: list[dict[str, Any]] = []
    if nominal > 1.1 and (nominal - fitted) / nominal > FOUND and worse.max() > 0:
        order = np.argsort(-worse)
        chosen = [order[0], *(k for k in order[1:2] if worse[k] > SECOND * worse[order[0]])]
        values = problem.values(z)
        for k in chosen:
            name = problem.names[k]
            said = {"value": values[name], "low": None, "high": None, "unit": ""}
            effects.append({"name": name, "target": "all", "parameters": {PARAMETER[name]: said}})
    closed = None if before <= 1.1 else 1 - (max(after, 1.0) - 1) / (before - 1)
    verdict = {"kind": "effect" if effects else "no_gap", "effects": effects, "probability": None}
    return {
        "verdict": {**verdict, "alternatives": [], "not_excited": []},
        "shrink": {"before": before, "after": after, "closed": closed},
        "seconds": time.monotonic() - begun,
    }


def main() -> None:
    """Fit the cases of a run."""
    parser = argparse.ArgumentParser(description="Fit every parameter at once: baselines of the blind check.")
    parser.add_argument("run", type=Path, metavar="DIR", help="folder of a run of python -m benchmarks.blind")
    parser.add_argument("--method", choices=tuple(METHODS), required=True)
    parser.add_argument("--cases", type=int, metavar="N", help="only the first ones")
    given = parser.parse_args()
    folders = sorted((given.run / "cases").iterdir())[: given.cases]
    for folder in folders:
        path = folder / "baselines" / f"{given.method}.json"
        if path.exists():
            continue
        recordings = folder / "recordings"
        robot = json.loads(next(recordings.glob("*.json")).read_text())["robot"]
        setting = PLAIN if robot.endswith(".xml") else ARM if robot == cases.ARM_ENVIRONMENT else GRIPPER
        said = answer(Problem(recordings, setting), given.method)
        atomic.write_text(path, json.dumps(said, indent=1) + "\n")
        named = " + ".join(e["name"] for e in said["verdict"]["effects"]) or "no gap"
        print(f"case {folder.name}: {named}, closed {said['shrink']['closed']}, {said['seconds']:.0f} s", flush=True)


if __name__ == "__main__":
    main()
