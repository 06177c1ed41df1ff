"""Ordinary least squares, joint by joint, as any course on robots has it.

Where efforts are measured: what they are more than the nominal model needs, as a sum of acceleration, speed, direction
and a constant. Where there are commands only: what the nominal servo gives at the measured error, more than the nominal
model needs, as a sum of the same and of the error. Half of the seconds are fitted, the others decide: nothing is named
where the fit gains less than a fifth there, else every parameter without which a tenth more is left than with it; the
constant is never named. It knows neither a payload, nor gains of efforts, nor delays, nor play.

A regression is no baseline of a case whose truth is a regression's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.real import signals
from benchmarks.real.baselines.files import NotForThis, Recording, known, nominal, recordings, servos
from benchmarks.real.declare import REGRESSION, Case
from benchmarks.real.logs import Array

#: Of what the nominal model leaves, the least that a fit must take away; of what the fit leaves, the least that is left
#: more without a parameter that is named.
FOUND, MATTERS = 0.2, 0.1
#: Seconds that are fitted, and that decide, in turn.
TURN: Final = 2.0
#: Cut-off [Hz], and its greatest share of the rate; fastest grid [Hz].
CUTOFF, SHARE, FASTEST = 10.0, 0.15, 1000.0
#: Dry friction turns over this share of a joint's fast speed.
TURNING: Final = 0.05
#: Rows that a recording must give.
ENOUGH: Final = 20
CONSTANT: Final = "constant"
#: Below nothing there is none of these.
POSITIVE: Final = frozenset({"armature", "viscous_friction", "coulomb_friction"})


@dataclass(frozen=True)
class Rows:
    """Of one joint.

    Attributes:
        effort: (T,) measured, or of the nominal servo [N, N·m].
        needed: (T,) by the nominal model without friction.
        speed, acceleration: (T,).
        error: (T,) what the servo's stiffness makes of its error; None where efforts are measured.
        fitted: (T,) bool; the others decide.
        use: (T,) bool; not where the servo is at its limit.
    """

    effort: Array
    needed: Array
    speed: Array
    acceleration: Array
    error: Array | None
    fitted: Array
    use: Array


def answer(case: Case, folder: Path) -> dict[str, Any]:
    """What the regression says of a converted case.

    Raises:
        NotForThis: a regression gave the truth, or there is neither an effort nor a servo.
    """
    if any(cause.known_by == REGRESSION for cause in case.causes):
        raise NotForThis("its truth is a regression's")
    some = recordings(folder)
    model = nominal(folder, some)
    values: dict[str, float] = {}
    for joint, rows in _rows(model, some).items():
        wanted, columns, fitted = _problem(model, joint, rows, known(folder))
        values |= {f"{name}@{joint}": value for name, value in read_off(wanted, columns, fitted).items()}
    return {"kind": "effect" if values else "no_gap", "names": list(values), "values": values}


def read_off(wanted: Array, columns: Mapping[str, Array], fitted: Array) -> dict[str, float]:
    """Values of what matters.

    Args:
        wanted: (T,).
        columns: by effect, (T,), and the constant.
        fitted: (T,) bool: rows that are fitted; the others decide.
    """

    def left(use: Sequence[str]) -> float:
        found = signals.fit({name: columns[name][fitted] for name in (CONSTANT, *use)}, wanted[fitted])
        predicted = sum(found[name] * columns[name][~fitted] for name in (CONSTANT, *use))
        return float(np.mean((wanted[~fitted] - predicted) ** 2))

    every = [name for name in columns if name != CONSTANT]
    before, after = left(()), left(every)
    if before - after < FOUND * before:
        return {}
    chosen = [name for name in every if left([one for one in every if one != name]) - after > MATTERS * after]
    while chosen:
        found = signals.fit({name: columns[name] for name in (CONSTANT, *chosen)}, wanted)
        below = {name for name in chosen if name in POSITIVE and found[name] <= 0}
        if not below:
            return {name: found[name] + (name == "servo_stiffness") for name in chosen}
        chosen = [name for name in chosen if name not in below]
    return {}


def _problem(
    model: mujoco.MjModel, joint: str, rows: Rows, given: Sequence[Mapping[str, Any]]
) -> tuple[Array, dict[str, Array], Array]:
    """What is wanted, as a sum of which columns, and which rows are fitted."""
    way = signals.turning(rows.speed, TURNING * max(float(np.percentile(np.abs(rows.speed), 95)), 1e-9))
    dof = int(model.joint(joint).dofadr[0])
    needed = rows.needed + model.dof_damping[dof] * rows.speed + model.dof_frictionloss[dof] * way
    shapes = {
        "load_dependent_friction": np.abs(rows.effort) * way,
        "coulomb_friction": way,
        "viscous_friction": rows.speed,
    }
    for one in given:
        if one["target"] == joint:
            needed = needed + next(iter(one["parameters"].values())) * shapes[one["name"]]
    columns = {
        "armature": rows.acceleration,
        "viscous_friction": rows.speed,
        "coulomb_friction": way,
        CONSTANT: np.ones_like(way),
    }
    if rows.error is not None:
        columns["servo_stiffness"] = -rows.error
    use = rows.use.astype(bool)
    return (rows.effort - needed)[use], {name: column[use] for name, column in columns.items()}, rows.fitted[use] > 0


def _rows(model: mujoco.MjModel, some: Sequence[Recording]) -> dict[str, Rows]:
    """By joint, over all recordings."""
    moving = [
        name
        for name in (model.joint(j).name for j in range(model.njnt))
        if all(f"position.{name}" in one.columns for one in some)
    ]
    beside = {name: f"effort.{name}" for name in moving if all(f"effort.{name}" in one.columns for one in some)}
    by_servo = servos(model)
    commanded = not beside
    if commanded:
        sent = {name: f"command.{servo.actuator}" for name, servo in by_servo.items() if name in moving}
        beside = {name: column for name, column in sent.items() if all(column in one.columns for one in some)}
    if not beside:
        raise NotForThis("it has neither efforts nor a servo's commands beside positions")
    parts: dict[str, list[Rows]] = {name: [] for name in beside}
    for one in some:
        rate = min((len(one.time) - 1) / float(one.time[-1] - one.time[0]), FASTEST)
        moved = signals.motion(
            one.time,
            np.stack([one.columns[f"position.{name}"] for name in moving], axis=1),
            np.stack([one.columns[column] for column in beside.values()], axis=1),
            rate=rate,
            cutoff=min(CUTOFF, SHARE * rate),
        )
        if len(moved.time) < ENOUGH:
            continue
        needed = _needed(model, moving, moved)
        fitted = np.floor(moved.time / TURN) % 2 == 0
        for k, name in enumerate(beside):
            m = moving.index(name)
            effort, use, error = moved.beside[:, k], np.ones(len(fitted), dtype=bool), None
            if commanded:
                servo = by_servo[name]
                error = servo.stiffness * (effort - moved.position[:, m])
                effort = error - servo.damping * moved.velocity[:, m]
                use = (effort > servo.low) & (effort < servo.high)
            parts[name].append(
                Rows(effort, needed[:, m], moved.velocity[:, m], moved.acceleration[:, m], error, fitted, use)
            )
    return {name: _together(rows) for name, rows in parts.items() if rows}


def _together(parts: Sequence[Rows]) -> Rows:
    columns = {
        name: None if getattr(parts[0], name) is None else np.concatenate([getattr(part, name) for part in parts])
        for name in Rows.__dataclass_fields__
    }
    return Rows(**columns)


def _needed(model: mujoco.MjModel, joints: Sequence[str], moved: signals.Motion) -> Array:
    """Torques of a motion without friction, (T, n); other joints rest where the model has them."""
    state = mujoco.MjData(model)
    rest = model.key_qpos[0] if model.nkey else state.qpos.copy()
    q = [int(model.joint(name).qposadr[0]) for name in joints]
    d = [int(model.joint(name).dofadr[0]) for name in joints]
    damping, dry = model.dof_damping.copy(), model.dof_frictionloss.copy()
    model.dof_damping[:] = model.dof_frictionloss[:] = 0
    out = np.zeros_like(moved.position)
    for row in range(len(out)):
        state.qpos[:], state.qvel[:], state.qacc[:] = rest, 0, 0
        state.qpos[q], state.qvel[d], state.qacc[d] = (
            moved.position[row],
            moved.velocity[row],
            moved.acceleration[row],
        )
        mujoco.mj_inverse(model, state)
        out[row] = state.qfrc_inverse[d]
    model.dof_damping[:], model.dof_frictionloss[:] = damping, dry
    return out
