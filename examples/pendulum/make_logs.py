"""Logs of a pendulum that is not quite its URDF: its elbow rubs.

    python examples/pendulum/make_logs.py --out out/pendulum/logs

This takes the place of a real robot and its logger. The "real" pendulum is MuJoCo's own reading of the URDF, stepped
four times as finely as the converted model, with dry friction in the elbow (0.25 N·m), every mass and gain a little
off, and encoders of 14 bits. The logs are eight CSV files of 6 s at 100 Hz, in milliseconds and degrees.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).parent
JOINTS = ("shoulder", "elbow")
KP, KV, EFFORT = (35.0, 18.0), (2.2, 0.8), (9.0, 6.0)
FRICTION = 0.25
RATE, SECONDS, STEP = 100, 6.0, 5e-4
LOGS = 8
COLUMNS = ("t_ms", "shoulder_goal", "elbow_goal", "shoulder_angle", "elbow_angle")


def real_pendulum(rng: np.random.Generator) -> mujoco.MjModel:
    """The URDF with servos and a rubbing elbow, everything up to 3 % off."""
    spec = mujoco.MjSpec.from_file(str(HERE / "pendulum.urdf"))
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint, kp, kv, effort in zip(JOINTS, KP, KV, EFFORT, strict=True):
        servo = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=kp * rng.uniform(0.97, 1.03), kv=kv * rng.uniform(0.97, 1.03))
        servo.forcerange, servo.forcelimited = (-effort, effort), True
    for body in spec.bodies[1:]:
        body.mass *= rng.uniform(0.97, 1.03)
    elbow = spec.joint("elbow")
    elbow.frictionloss = FRICTION
    elbow.solref_friction, elbow.solimp_friction = (0.001, 1), (0.9999, 0.9999, 0.001, 0.5, 2)  # it sticks
    return spec.compile()


def goals(rng: np.random.Generator) -> np.ndarray:
    """Where both joints are to go, (rows, 2) [rad]: slow waves with steps on top, from rest to rest."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    edge = np.clip(np.minimum(time - 0.3, SECONDS - 0.3 - time) / 0.5, 0, 1)
    made = []
    for size in (0.5, 0.7):
        waves = np.sin(2 * np.pi * rng.uniform(0.2, 0.9, 3) * time[:, None] + rng.uniform(0, 6.3, 3)).mean(axis=1)
        held = np.repeat(rng.uniform(-1, 1, 8), len(time) // 8)
        made.append(size * edge * (waves + 0.6 * held))
    return np.stack(made, axis=1)


def log(model: mujoco.MjModel, sent: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rows of one log: time [ms], goals and measured angles [deg]."""
    data, rows = mujoco.MjData(model), []
    mujoco.mj_step(model, data, nstep=round(1 / STEP))  # it comes to rest before the logger starts
    for row, goal in enumerate(sent):
        angle = data.qpos + rng.normal(0, 1e-4, 2)
        angle = np.round(angle / (2 * np.pi) * 2**14) / 2**14 * 2 * np.pi
        rows.append([1e3 * row / RATE, *np.degrees(goal), *np.degrees(angle)])
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, nstep=round(1 / RATE / STEP))
    return np.array(rows)


def main() -> None:
    """Write the logs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for log-0.csv ... log-7.csv")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    model = real_pendulum(rng)
    for number in range(LOGS):
        with (out / f"log-{number}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows([f"{value:.5f}" for value in row] for row in log(model, goals(rng), rng))
    print(f"{LOGS} logs of {SECONDS:g} s in {out}")


if __name__ == "__main__":
    main()
