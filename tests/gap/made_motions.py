"""Made-up recordings of motion and effort without commands, and their diagnosis along that motion.

They come from forward simulations of their own: a tracking controller moves the joints, MuJoCo's constraint solver
makes the friction, and noise is added, so nothing of the diagnosis takes part in making the data.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from tiago_mj.effects import Entry
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.result import Diagnosis, Explanation, Value
from tiago_mj.models.files import model_file
from tiago_mj.recordings.recording import Sidecar, Trial

RATE, TIMESTEP = 100, 0.002
STICKS = {"solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0), "solref": (0.002, 1.0)}

PENDULUM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="swing" axis="0 1 0" damping="0.05" frictionloss="0.02" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01" mass="0.1"/>
      <body name="tip" pos="0 0 -0.3"><geom type="sphere" size="0.03" mass="0.5"/></body>
    </body>
  </worldbody>
  <actuator><motor name="swing" joint="swing"/></actuator>
</mujoco>
"""
ARM = tuple(f"arm_{i}_joint" for i in range(1, 5))

Pull = Callable[[mujoco.MjData, float], np.ndarray]


def pendulum() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(PENDULUM)


def robot() -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_path(str(model_file("robots/tiago_ta11.xml")))
    model.opt.timestep = TIMESTEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return model


def record(
    model: mujoco.MjModel,
    joints: tuple[str, ...],
    *,
    spread: float = 0.6,
    seconds: float = 20.0,
    noise: float = 0.01,
    pull: Pull | None = None,
    seed: int = 0,
) -> Trial:
    """What a logger on the arm sees: position and drive torque, while each joint follows three slow sines of its own.

    ``pull`` is a torque on the joints that is not the drives', as a cable would exert it.
    """
    model.body_gravcomp[:] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in joints:
        dof = model.joint(joint).dofadr[0]
        model.dof_solimp[dof], model.dof_solref[dof] = STICKS["solimp"], STICKS["solref"]
    model.actuator_gainprm[:] = 0
    model.actuator_biasprm[:] = 0
    data, ideal = mujoco.MjData(model), mujoco.MjData(model)
    if model.nkey:
        data.qpos[:] = model.key_qpos[0]
    q = [int(model.joint(name).qposadr[0]) for name in joints]
    v = [int(model.joint(name).dofadr[0]) for name in joints]
    random = np.random.default_rng(seed)
    n = len(joints)
    frequency = random.uniform(0.08, 0.35, (3, n))
    phase = random.uniform(0, 2 * np.pi, (3, n))
    size = spread / 3 * np.array([1.4, 1.0, 0.6])[:, None]
    middle = data.qpos.copy()
    others = [d for d in range(model.nv) if d not in v]
    model.dof_armature[others] += 1e4  # they are not recorded: what they carry must not move them
    inertia = np.zeros((model.nv, model.nv))
    rows, every = [], round(1 / (RATE * TIMESTEP))
    for k in range(int(seconds / TIMESTEP)):
        time = k * TIMESTEP
        turn = 2 * np.pi * frequency
        wanted = (size * (np.sin(turn * time + phase) - np.sin(phase))).sum(axis=0)
        speed = (size * turn * np.cos(turn * time + phase)).sum(axis=0)
        change = -(size * turn**2 * np.sin(turn * time + phase)).sum(axis=0)
        if k == 0:
            data.qvel[v] = speed
        ideal.qpos[:], ideal.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, ideal)
        mujoco.mj_fullM(model, ideal, inertia)
        error, slip = wanted - (data.qpos[q] - middle[q]), speed - data.qvel[v]
        acceleration = np.zeros(model.nv)
        acceleration[v] = change + 900 * error + 60 * slip
        acceleration[others] = -900 * (data.qpos - middle)[: model.nv][others] - 60 * data.qvel[others]
        torque = inertia @ acceleration + ideal.qfrc_bias - ideal.qfrc_passive
        if k % every == 0:
            rows.append((time, data.qpos[q].copy(), torque[v].copy()))
        data.qfrc_applied[:] = torque
        if pull is not None:
            data.qfrc_applied[v] += pull(data, time)
        mujoco.mj_step(model, data)
    times = np.array([row[0] for row in rows])
    position = np.array([row[1] for row in rows]) + random.normal(0, 1e-5, (len(rows), n))
    effort = np.array([row[2] for row in rows])
    effort += random.normal(0, 1, effort.shape) * noise * np.sqrt((effort**2).mean(axis=0))
    return trial(times, dict(zip(joints, position.T, strict=True)), dict(zip(joints, effort.T, strict=True)))


def trial(time: np.ndarray, positions: dict[str, np.ndarray], efforts: dict[str, np.ndarray]) -> Trial:
    return Trial("trial", time, {}, positions, {}, efforts, {}, Sidecar(trial="trial", rate_hz=RATE), "trial.csv")


@cache
def pendulum_file() -> Path:
    file = Path(tempfile.mkdtemp()) / "pendulum.xml"
    file.write_text(PENDULUM)
    return file


def nominal_file(recorded: Trial) -> Path:
    """Of the robot that a recording is of."""
    return pendulum_file() if "swing" in recorded.positions else model_file("robots/tiago_ta11.xml")


def diagnosed(*recorded: Trial, seed: int = 0, given: tuple[Entry, ...] = (), **more: Any) -> Diagnosis:
    return diagnose(recorded, model=nominal_file(recorded[0]), seed=seed, given=given, threads=1, **more)


def named(explanation: Explanation) -> set[str]:
    return {effect.name for effect in explanation.effects}


def value(explanation: Explanation, name: str, target: str, parameter: str) -> Value:
    (found,) = [e.parameters[parameter] for e in explanation.effects if (e.name, e.target) == (name, target)]
    return found


def holds(found: Value, truth: float) -> bool:
    return found.low is not None and found.high is not None and found.low <= truth <= found.high
