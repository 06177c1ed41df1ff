"""A converted case, as anybody gets it: recordings, nominal model, known effects."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.real import logs
from benchmarks.real.logs import Array
from tiago_mj.io.extra import load
from tiago_mj.models.files import model_file


class NotForThis(ValueError):  # noqa: N818 - no fault: it says why there is no answer
    """A method cannot answer a case; says why."""


@dataclass(frozen=True)
class Recording:
    """One file.

    Attributes:
        time: (T,) [s].
        columns: by name, (T,), interpolated to the rows of the clock.
        sidecar: what the columns do not say.
    """

    time: Array
    columns: Mapping[str, Array]
    sidecar: Mapping[str, Any]


def recordings(folder: Path) -> list[Recording]:
    """Of a converted case."""
    found = []
    for path in sorted((folder / logs.RECORDINGS).glob("*.parquet")):
        table = load("pyarrow.parquet", "reading recordings").read_table(path)
        raw = {name: np.array(table[name].to_pylist(), dtype=np.float64) for name in table.column_names}
        stamps = raw.pop("time")
        columns = {}
        for name, values in raw.items():
            there = np.isfinite(values)
            columns[name] = np.interp(stamps, stamps[there], values[there])
        found.append(Recording(stamps, columns, json.loads(path.with_suffix(".json").read_text())))
    return found


def nominal(folder: Path, some: Sequence[Recording]) -> mujoco.MjModel:
    """The case's model, or the robot of this package that its recordings name; nothing touches anything."""
    own = folder / logs.ROBOT
    path = own if own.exists() else model_file(f"robots/{some[0].sidecar['robot']}.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.body_gravcomp[:] = 0
    return model


def known(folder: Path) -> list[Mapping[str, Any]]:
    """Effects that belong to the nominal simulator and that its model cannot state."""
    path = folder / logs.KNOWN
    return list(json.loads(path.read_text())) if path.exists() else []


@dataclass(frozen=True)
class Servo:
    """Of a joint.

    Attributes:
        actuator: name.
        stiffness, damping: [N, N·m per m, rad; and per s].
        low, high: limits of its force [N, N·m].
    """

    actuator: str
    stiffness: float
    damping: float
    low: float
    high: float


def servos(model: mujoco.MjModel) -> dict[str, Servo]:
    """Position servos by joint."""
    out = {}
    for a in range(model.nu):
        gain, bias = float(model.actuator_gainprm[a, 0]), model.actuator_biasprm[a]
        if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and gain > 0 and np.isclose(bias[1], -gain):
            limited = bool(model.actuator_forcelimited[a])
            low, high = model.actuator_forcerange[a] if limited else (-np.inf, np.inf)
            joint = model.joint(int(model.actuator_trnid[a, 0])).name
            out[joint] = Servo(model.actuator(a).name, gain, -float(bias[2]), float(low), float(high))
    return out
