"""A few magnitudes at once, simulated: by CMA-ES, or by ``mujoco.sysid``.

Stiffness of the servo, viscous and dry friction, armature and a delay of the commands are fitted to the positions of a
single joint under commands, in MuJoCo. Of two seconds in turn, two are fitted and two decide. The reading is that of
the blind check's fitters: nothing where the fit gains less than a fifth, else the parameter that the fit cannot do
without, and a second one where it matters half as much.
"""

from __future__ import annotations

import contextlib
import copy
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from mujoco import rollout

from benchmarks.real.baselines.files import NotForThis, Recording, known, nominal, recordings, servos
from benchmarks.real.declare import Case
from benchmarks.real.logs import Array
from tiago_mj.io import extra

#: Least share of the loss that a fit must take away, and what a second parameter must matter of the first.
FOUND, SECOND = 0.2, 0.5
TURN: Final = 2.0
NAMES: Final = ("servo_stiffness", "viscous_friction", "coulomb_friction", "armature", "command_delay")
#: Below nothing there is none of these.
POSITIVE: Final = ("coulomb_friction", "armature", "command_delay")
#: Sizes: the logarithm of a factor; a share of the servo's own effort and of the inertia; seconds.
FACTOR, OF_EFFORT, OF_INERTIA, DELAY = 0.3, 0.3, 0.3, 0.01


class Problem:
    """A case to fit."""

    def __init__(self, folder: Path) -> None:
        self.some: list[Recording] = recordings(folder)
        self.model = nominal(folder, self.some)
        by_joint = servos(self.model)
        columns = self.some[0].columns
        if self.model.nq != 1 or len(by_joint) != 1:
            raise NotForThis("it is no single joint with a servo")
        (self.joint, self.servo), *_ = by_joint.items()
        if f"command.{self.servo.actuator}" not in columns or f"position.{self.joint}" not in columns:
            raise NotForThis("it has no commands beside positions")
        if known(folder):
            raise NotForThis("its nominal simulator has effects that no model file holds")
        self.scales = self._scales()

    def _scales(self) -> dict[str, float]:
        efforts, speeds = [], []
        for one in self.some:
            q, u = one.columns[f"position.{self.joint}"], one.columns[f"command.{self.servo.actuator}"]
            v = np.gradient(q, one.time)
            efforts.append(self.servo.stiffness * (u - q) - self.servo.damping * v)
            speeds.append(v)
        effort = float(np.sqrt(np.mean(np.concatenate(efforts) ** 2)))
        speed = float(np.sqrt(np.mean(np.concatenate(speeds) ** 2)))
        state, inertia = mujoco.MjData(self.model), np.zeros((1, 1))
        mujoco.mj_forward(self.model, state)
        mujoco.mj_fullM(self.model, state, inertia)
        return {
            "servo_stiffness": FACTOR,
            "viscous_friction": OF_EFFORT * effort / speed,
            "coulomb_friction": OF_EFFORT * effort,
            "armature": OF_INERTIA * float(inertia[0, 0]),
            "command_delay": DELAY,
        }

    def values(self, z: Array) -> dict[str, float]:
        """Parameters of a point, (n,), whose origin is the nominal model."""
        out = {}
        for name, x in zip(NAMES, z, strict=True):
            size = float(np.clip(x, 0.0 if name in POSITIVE else -8.0, 8.0)) * self.scales[name]
            out[name] = float(np.exp(size)) if name == "servo_stiffness" else size
        return out

    def residuals(self, points: Array, *, fitted: bool) -> Array:
        """Measured less simulated positions, (points, rows), of the rows that are fitted or of those that decide."""
        values = [self.values(z) for z in points]
        models = [self._model(one) for one in values]
        step = float(self.model.opt.timestep)
        parts = []
        for one in self.some:
            grid = np.arange(0.0, one.time[-1] + step, step)
            sent = one.columns[f"command.{self.servo.actuator}"]
            middle = grid + step / 2  # a command that comes within a step acts from its beginning
            rows = [np.searchsorted(one.time, middle - v["command_delay"], side="right") - 1 for v in values]
            control = np.stack([sent[np.maximum(k, 0)] for k in rows])
            began = one.sidecar.get("initial", {})
            start = np.zeros((len(points), 3))  # time, position, speed
            start[:, 1] = began.get("position", {}).get(self.joint, one.columns[f"position.{self.joint}"][0])
            state, _ = rollout.rollout(models, mujoco.MjData(self.model), start, control[:, :, None])
            use = (np.floor(one.time / TURN) % 2 == 0) == fitted
            measured = one.columns[f"position.{self.joint}"][use]
            times = grid + step
            got = np.stack([np.interp(one.time[use], times, row) for row in state[:, :, 1]])
            parts.append(np.nan_to_num(got - measured, nan=1e3, posinf=1e3, neginf=-1e3))
        return np.concatenate(parts, axis=1)

    def loss(self, points: Array, *, fitted: bool) -> Array:
        """Mean squared residual of every point, (k,)."""
        return np.asarray(np.mean(self.residuals(points, fitted=fitted) ** 2, axis=1))

    def _model(self, values: dict[str, float]) -> mujoco.MjModel:
        model = copy.copy(self.model)
        model.actuator_gainprm[0, 0] *= values["servo_stiffness"]
        model.actuator_biasprm[0, 1] *= values["servo_stiffness"]
        model.dof_damping[0] = max(model.dof_damping[0] + values["viscous_friction"], 0.0)
        model.dof_frictionloss[0] += values["coulomb_friction"]
        model.dof_armature[0] += values["armature"]
        return model


def by_cma(case: Case, folder: Path) -> dict[str, Any]:
    """CMA-ES: 300 simulations.

    Raises:
        NotForThis: it is no single joint under commands.
    """
    del case
    problem = Problem(folder)
    library = extra.load("cma", "this baseline", "blind")
    options = {"popsize": 10, "maxiter": 30, "seed": 1, "verbose": -9}
    search = library.CMAEvolutionStrategy(np.zeros(len(NAMES)), 0.7, options)
    while not search.stop():
        points = np.array(search.ask())
        costs = np.log(problem.loss(points, fitted=True)) + 1e-3 * np.mean(points**2, axis=1)
        search.tell(list(points), list(costs))
    return read_off(problem, np.array(search.result.xbest))


def by_sysid(case: Case, folder: Path) -> dict[str, Any]:
    """``mujoco.sysid.optimize``, bounded least squares.

    Raises:
        NotForThis: it is no single joint under commands.
    """
    del case
    problem = Problem(folder)
    for name in ("absl", "colorama", "tabulate"):  # without what its extra brings it loads, and holds nothing
        extra.load(name, "mujoco.sysid", "blind")
    toolbox = extra.load("mujoco.sysid", "this baseline", "blind")
    wanted = toolbox.ParameterDict()
    for name in NAMES:
        wanted.add(toolbox.Parameter(name, 0.0, -0.02 if name in POSITIVE else -8.0, 8.0))
    unit = float(np.sqrt(problem.loss(np.zeros((1, len(NAMES))), fitted=True)[0]))

    def residual(x: Array, _: Any) -> tuple[list[Array], None, None]:
        points = np.asarray(x).reshape(len(NAMES), -1).T
        flat = problem.residuals(points, fitted=True).T / unit
        return [flat if np.ndim(x) > 1 else flat[:, 0]], None, None

    with contextlib.redirect_stdout(io.StringIO()):  # its optimizer tells every iteration
        _, result = toolbox.optimize(wanted, residual, verbose=False, max_iters=25)
    return read_off(problem, np.asarray(result.x).ravel())


def read_off(problem: Problem, z: Array) -> dict[str, Any]:
    """What a user would read off a fit."""
    without: Sequence[Array] = [np.where(np.arange(len(z)) == k, 0.0, z) for k in range(len(z))]
    deciding = problem.loss(np.array([np.zeros_like(z), z, *without]), fitted=False)
    before, after, worse = float(deciding[0]), float(deciding[1]), deciding[2:] - deciding[1]
    values: dict[str, float] = {}
    if before - after > FOUND * before and worse.max() > 0:
        every = problem.values(z)
        for k in np.argsort(-worse)[:2]:
            if worse[k] > SECOND * worse.max():
                values[f"{NAMES[k]}@{problem.joint}"] = every[NAMES[k]]
    return {"kind": "effect" if values else "no_gap", "names": list(values), "values": values}
