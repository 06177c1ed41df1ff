"""Sessions of user robots as files: what encoders give, tables and sidecars, as the contract asks of a user."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.user_robots.record import Array, Log, Plan, Reality, noise_of, session


def measured(reality: Reality, plan: Plan, log: Log, rng: np.random.Generator) -> tuple[Array, Array]:
    """What encoders give: noise and steps on positions; velocities as a driver estimates them."""
    slides = reality.nominal.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    quantum = np.where(slides, 0.4, 2 * np.pi) / 2**plan.bits
    noise = noise_of(reality, plan)
    position = np.round((log.position + noise * rng.standard_normal(log.position.shape)) / quantum) * quantum
    velocity = log.velocity + 20 * noise * rng.standard_normal(log.velocity.shape)
    return position, velocity


def write(reality: Reality, plan: Plan, seed: int, folder: Path, robot: str) -> None:
    """Record the session into a folder.

    Args:
        reality: the robot.
        plan: of the session.
        seed: of motions and noise.
        folder: for ``log-NN.csv`` or ``.parquet`` and the sidecars.
        robot: what the sidecars say of the model's file, seen from the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number, log in enumerate(session(reality, plan, seed, range(plan.logs))):
        position, velocity = measured(reality, plan, log, np.random.default_rng([seed, 5, number]))
        columns: dict[str, Array] = {"time": log.time}
        for k, name in enumerate(reality.actuators):
            columns[f"command.{name}"] = log.command[:, k]
        for k, name in enumerate(reality.joints):
            columns[f"position.{name}"] = position[:, k]
        if plan.velocity:
            for k, name in enumerate(reality.joints):
                columns[f"velocity.{name}"] = velocity[:, k]
        stem = folder / f"log-{number:02d}"
        _table(stem, columns, plan.parquet)
        stem.with_suffix(".json").write_text(json.dumps(_sidecar(reality, plan, log, stem.name, robot), indent=1))


def _sidecar(reality: Reality, plan: Plan, log: Log, trial: str, robot: str) -> dict[str, Any]:
    out: dict[str, Any] = {
        "schema": "tiago_mj.recording/1",
        "trial": trial,
        "robot": robot,
        "rate_hz": plan.rate,
        "interface": reality.robot.interface,
    }
    if reality.model.na:  # a controller that moves set points knows where they are
        joints = [reality.nominal.joint(int(j)).name for j in reality.driven]
        points = dict(zip(joints, log.begin.tolist(), strict=True))
        out["initial"] = {"set_point": points}
    return out


def _table(stem: Path, columns: dict[str, Array], parquet: bool) -> None:
    if parquet:
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), stem.with_suffix(".parquet"))
        return
    with stem.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([f"{value:.7g}" for value in row] for row in zip(*columns.values(), strict=True))
