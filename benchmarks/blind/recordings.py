"""Recordings of a case as a user would have them: Parquet and a JSON sidecar a trial, by the contract."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.blind import cases, effort_sensors, facts, robots
from benchmarks.blind.cases import Made
from benchmarks.blind.dictionary import ARM, GRIPPER
from tiago_mj.models import names


def write(made: Made, folder: Path, stem: str = "trial") -> None:
    """Write the recordings, ``STEM-NN.parquet`` and their sidecars; nothing in them is more than a user would know."""
    folder.mkdir(parents=True, exist_ok=True)
    case, recorded, robot = made.case, made.recorded, made.robot
    robots.put_model(case.setting, folder)
    for k in range(len(recorded.time)):
        name = f"{stem}-{k:02d}"
        columns = {"time": recorded.time[k]}
        last = ("command", recorded.commands) if recorded.effort is None else ("effort", recorded.effort)
        for kind, values in (last, ("position", recorded.position), ("velocity", recorded.velocity)):
            columns.update({f"{kind}.{joint}": values[k, :, j] for j, joint in enumerate(robot.joints)})
        if robot.pads is not None:
            columns.update({f"force.{side}": recorded.force[k, :, s] for s, side in enumerate(names.SIDES)})
        table = pa.table({key: pa.array(values, from_pandas=True) for key, values in columns.items()})
        pq.write_table(table, folder / f"{name}.parquet", compression="zstd")
        (folder / f"{name}.json").write_text(json.dumps(sidecar(made, name, k), indent=1) + "\n")


def sidecar(made: Made, name: str, k: int) -> dict[str, Any]:
    """What a user knows of a trial."""
    case, robot = made.case, made.robot
    measured = dict(zip(robot.joints, made.recorded.position[k, 0].tolist(), strict=True))
    initial = dict(zip(robot.joints, made.setup.start[k].tolist(), strict=True))
    out: dict[str, Any] = {
        "schema": "tiago_mj.recording/1",
        "trial": name,
        "robot": {
            GRIPPER: "tiago_mj/GripperTactile-v0",
            ARM: cases.ARM_ENVIRONMENT,
            **{setting: file for setting, (file, *_) in robots.MODELS.items()},
        }[case.setting],
        "rate_hz": made.setup.rate,
        "interface": "position" if case.setting in robots.MODELS else case.interface,
        "initial": {"position": measured, "set_point": initial},
        "source": {"tool": "benchmarks/blind", "version": case.version},
    }
    if case.effort:
        del out["interface"]
        out["initial"] = {"position": measured}
        return {**out, **effort_sensors.stated(case.effort)}
    if case.grids:
        out["quantum"] = facts.stated(case.grids, robot)
    if case.setting not in robots.MODELS:
        out["servo"] = {"name": made.servo}
    if case.setting == GRIPPER:
        thing = robots.nominal_object()
        out["sensing"] = {"scale": 100.0, "contact_unit": 100 * 2000 / 330, "average": 1}
        out["object"] = {
            "shape": thing.shape,
            "radius_m": thing.width / 2,
            "height_m": thing.height,
            "mass_kg": thing.mass,
            "stiffness": thing.stiffness,
            "damping": thing.damping,
            "friction": thing.friction,
            "offset_m": case.offset,
        }
    return out
