"""The ``--map`` file: which column holds what, where a recording's columns are not named as the contract's.

YAML, column -> kind and name, optionally unit and scale (``-1`` flips a sign):

    columns:
      stamp: {kind: time, unit: us}
      q_right: {kind: position, name: gripper_right_finger_joint, unit: mm}
      tau_right: {kind: effort, name: gripper_right_finger_joint, unit: N}
      i_wrist: {kind: effort, name: wrist, unit: mA, torque_constant: 0.061, ratio: 336}   # of motor and gear
      elbow: position.elbow                                # the short form
      estop: {kind: torque_on}                             # 0 where the motors are off: those rows are left out
      battery: null                                        # left out; it may be absent
      command.wrist: null                                  # nothing commands this actuator, and its joint may move

A file may hold ``columns`` (for CSV and Parquet) and ``topics`` (for bags) at once, and what sidecars lack: ``robot``,
``interface``, ``rate_hz``, ``servo``, ``sensing``, ``object``, ``uncertainty``, ``gains``, ``base``, ``like``,
``tie``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import Field

from tiago_mj.io.loading import load_yaml
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Closed, SchemaError, checked
from tiago_mj.recordings.read.torque import TORQUE
from tiago_mj.recordings.read.units import COUNTS, CURRENTS, factor, of_drive
from tiago_mj.recordings.recording import KINDS, RecordingError
from tiago_mj.recordings.sidecar import OF_MODEL

#: Of a sidecar, what a map file may say for all its recordings.
FACTS: Final = ("robot", "rate_hz", "interface", "servo", "sensing", "object", "uncertainty", *OF_MODEL)
#: Kinds of which there is no joint, actuator or sensor to be named.
NAMELESS: Final = ("time", TORQUE)
#: Factor between what a column holds and its unit, or one over it; nanometres in a column of kilometres have 1e12.
MOST_SCALE: Final = 1e12
_SCALE: Final = "give a number other than 0, such as -1, and no larger than 1e12"


class _Entry(Closed):
    kind: str = Field(description=f"use {', '.join((*NAMELESS, *KINDS))}")
    name: str | None = Field(default=None, description="give the joint's, actuator's or sensor's")
    unit: str | None = Field(default=None, description="give its name, such as mm")
    scale: float | None = Field(default=None, description=_SCALE)
    torque_constant: float | None = Field(default=None, description="give N·m per A of the motor, a number")
    ratio: float | None = Field(default=None, description="give the gear's ratio, a number")


@dataclass(frozen=True)
class Target:
    """Channel, unit and scale of a column.

    Attributes:
        column: its name in the contract, ``time`` or ``kind.name``; None: the column is left out.
        unit: in which it comes, None for the contract's.
        scale: factor on top of the unit's.
        told: whether the map says what the numbers are: by a unit or a scale.
    """

    column: str | None
    unit: str | None = None
    scale: float = 1.0
    told: bool = False


def load_map(path: Path) -> dict[str, Any]:
    """The mapping in a map file.

    Raises:
        RecordingError: no such file, or no YAML mapping.
    """
    content = load_yaml(path, f"map file {path.name} is no YAML", error=RecordingError)
    if not isinstance(content, dict) or not content:
        raise RecordingError(f"map file {path.name} is no mapping: write 'column: {{kind: position, name: JOINT}}'")
    return content


def column_map(content: Mapping[str, Any], file: str) -> dict[str, Target]:
    """Targets by column, from what a map file holds (under ``columns``, or the whole file where it has no sections).

    Raises:
        RecordingError: an entry is unusable; names it.
    """
    section = content.get("columns", {} if set(content) & {"topics", *FACTS} else content)
    if not isinstance(section, Mapping):
        raise RecordingError(
            f"map file {file}: 'columns' is no mapping: write 'column: {{kind: position, name: JOINT}}'"
        )
    return {str(column): _target(str(column), entry, file) for column, entry in section.items()}


def _target(column: str, entry: Any, file: str) -> Target:
    where = f"map file {file}: column {quoted(column)}"
    if entry is None:
        return Target(None)
    if isinstance(entry, str):
        entry = dict(zip(("kind", "name"), entry.split(".", 1), strict=False))
    try:
        said = checked(_Entry, entry, "write {kind: KIND, name: NAME}, optionally unit and scale")
    except SchemaError as fault:
        raise RecordingError(f"{where}{': ' if fault.path else ' '}{fault}") from fault
    kind, unit = said.kind, said.unit
    if kind not in (*NAMELESS, *KINDS):
        raise RecordingError(f"{where}: kind {quoted(kind)} is unknown: use {', '.join((*NAMELESS, *KINDS))}")
    if kind not in NAMELESS and not said.name:
        raise RecordingError(f"{where}: name is missing: give the joint's, actuator's or sensor's")
    told = unit is not None or said.scale is not None
    try:
        if of_a_drive := unit is not None and kind in ("effort", "command") and unit in (*CURRENTS, COUNTS):
            scale, unit = of_drive(str(unit), said.scale, said.torque_constant, said.ratio), None
        else:
            scale = 1.0 if said.scale is None else said.scale
        if unit is not None:
            factor(kind, unit)
    except ValueError as fault:
        raise RecordingError(f"{where}: {fault}") from fault
    if not of_a_drive and (said.torque_constant is not None or said.ratio is not None):
        raise RecordingError(f"{where}: torque_constant and ratio are of an effort in A, mA or counts: state its unit")
    if not 1 / MOST_SCALE <= abs(scale) <= MOST_SCALE:
        raise RecordingError(f"{where}: scale is {scale:g}: {_SCALE}")
    if kind == TORQUE:
        return Target(f"{TORQUE}.{column}")
    return Target("time" if kind == "time" else f"{kind}.{said.name}", unit, float(scale), told)
