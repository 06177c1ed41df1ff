"""Conversion of a table to a trial: columns are assigned to channels, units converted, the clock corrected."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import PurePath
from typing import Any, Final

import numpy as np

from tiago_mj.io.quoting import quoted
from tiago_mj.recordings.read.clock import check_clock, repair_clock
from tiago_mj.recordings.read.commands import by_actuator, interface_of_model
from tiago_mj.recordings.read.mapping import Target
from tiago_mj.recordings.read.pd_torques import are_goals_of_motors, with_torques
from tiago_mj.recordings.read.tables import Table
from tiago_mj.recordings.read.torque import TORQUE, says_torque, without_torque_off
from tiago_mj.recordings.read.units import ASKED, factor
from tiago_mj.recordings.recording import KINDS, Array, Finding, RecordingError, Sidecar, Trial
from tiago_mj.recordings.robot import Robot, nearest
from tiago_mj.recordings.sidecar import parse_sidecar
from tiago_mj.recordings.usable import check_values

#: Columns that are listed in a message.
LISTED: Final = 6
#: How alike a mistyped kind is to one of the contract's, as difflib measures it: ``positon``, ``commands``.
SLIP: Final = 0.85
#: A column of stamps that has its unit in its name, taken where there is no column ``time``.
_STAMPS: Final = re.compile(r"^(?:time|timestamp|stamp|t)[ _]?[\[(]?(s|ms|us|µs|ns)[\])]?$", re.IGNORECASE)


def trial_from_table(
    table: Table,
    columns: Mapping[str, Target],
    defaults: Mapping[str, Any],
    replayed: bool = True,
    robot: Robot | None = None,
) -> tuple[list[Trial], list[Finding]]:
    """A trial from a table, or several parts of it where the torque was off, and findings on what was repaired.

    Args:
        table: as it stands in its file.
        columns: of the map file; a column that is not there goes by its own name.
        defaults: what the sidecar lacks.
        replayed: whether commands or efforts must be there.
        robot: that was recorded, where its model is at hand: it knows commands by the names of their joints, too, and
            what they are where nothing else says it.

    Raises:
        RecordingError: the table cannot be used; one line says why.
    """
    file = table.source
    sidecar = parse_sidecar(table.sidecar, table.sidecar_file, {**table.facts, **defaults})
    _check_known(sidecar, file, table.sidecar_file)
    targets, findings = _targets(table, columns)
    findings += table.findings
    if table.cut:
        message = "the file ends within its last row, which is left out: was it copied whole?"
        findings.append(Finding("too_short", file, "", message, repaired=True))
    found = _converted_columns(table, targets, sidecar)
    findings += found.findings
    channels, time = found.channels, found.time
    if time is None:
        there = ", ".join(list(table.columns)[:6])
        raise RecordingError(f"{file}: column time is missing (there are {there}): name it 'time' or map it with --map")
    check_clock(time, file)
    time, repairs = repair_clock(time, sidecar.rate_hz, file, declared=found.declared)
    if robot is not None:
        channels["command"], sidecar, told = _of_robot(channels["command"], sidecar, robot, file)
        findings += told
    _check_enough(channels, sidecar, file, table.sidecar_file, replayed)
    if not channels["command"]:
        _check_efforts(targets, columns, found.stated, file)
    name = sidecar.trial or PurePath(file).stem
    if sidecar.rate_hz == 0.0:
        sidecar = replace(sidecar, rate_hz=_rate(time, channels))
    trial = Trial(
        name=name,
        time=time,
        sidecar=replace(sidecar, trial=name, units=None),
        source=file,
        units=found.stated,
        left_out=frozenset(column for column, target in columns.items() if target.column is None),
        part_of=(),
        **{KINDS[kind]: by_name for kind, by_name in channels.items()},
    )
    trial, computed = with_torques(trial, robot)
    trials, cuts = without_torque_off(trial, found.torque)
    return trials, [*repairs, *findings, *computed, *cuts]


def _of_robot(
    commands: dict[str, Array], sidecar: Sidecar, robot: Robot, file: str
) -> tuple[dict[str, Array], Sidecar, list[Finding]]:
    """Commands by the robot's actuators, the sidecar with what they are, and findings on what was taken for what."""
    commands, findings = by_actuator(commands, robot, file)
    if are_goals_of_motors(commands, sidecar, robot):
        return commands, replace(sidecar, interface="position"), findings
    said = None if sidecar.interface else interface_of_model(commands, robot, file)
    if said is not None:
        sidecar, findings = replace(sidecar, interface=said[0]), [*findings, said[1]]
    return commands, sidecar, findings


@dataclass
class _Columns:
    """The columns of a table in the contract's units.

    Attributes:
        channels: by kind and name, (T,) each.
        torque: columns that say whether the torque was on, by name, (T,) each.
        time: (T,) [s]; None where there is none.
        declared: whether the unit of the time was stated.
        stated: units that were stated, by channel.
        findings: what was left out or scaled.
    """

    channels: dict[str, dict[str, Array]] = field(default_factory=lambda: {kind: {} for kind in KINDS})
    torque: dict[str, Array] = field(default_factory=dict)
    time: Array | None = None
    declared: bool = False
    stated: dict[str, str] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


def _converted_columns(table: Table, targets: Mapping[str, Target], sidecar: Sidecar) -> _Columns:
    """A table's columns as channels, each in the contract's unit: scaled by its map's factor and its stated unit.

    Raises:
        RecordingError: two columns of one channel, a unit of no column or of another quantity, a value out of bounds.
    """
    file, units = table.source, sidecar.units or {}
    unused = set(units) - {target.column for target in targets.values()} - set(targets) - {"time", *KINDS}
    if unused:
        raise RecordingError(
            f"{table.sidecar_file}: units name the column {quoted(min(unused))}, which {file} does not have: mend the "
            "name"
        )
    out = _Columns()
    taken: dict[str, str] = {}
    for column, target in targets.items():
        if target.column is None:
            continue
        if target.column in taken:
            raise RecordingError(
                f"{file}: columns {taken[target.column]!r} and {column!r} both are {target.column}: map one to null"
            )
        taken[target.column] = column
        kind, _, name = target.column.partition(".")
        unit = target.unit or units.get(column) or units.get(target.column) or units.get(kind)
        values = table.columns[column]
        check_values(values, column, file)
        scale = target.scale
        if unit is not None:
            scale *= _factor(kind, unit, column, file)
            out.findings += _converted(kind, unit, column, file, scale)
            out.stated[target.column] = unit
        if scale != 1.0:
            values = values * scale
            check_values(values, column, file)
        if kind == "time":
            out.time, out.declared = values, unit is not None
        elif kind == TORQUE:
            out.torque[column] = values
        elif np.isnan(values).all() and len(values):
            out.findings.append(Finding("empty", file, target.column, "it has no value in any row; left out"))
        else:
            out.channels[kind][name] = values
    return out


def _targets(table: Table, columns: Mapping[str, Target]) -> tuple[dict[str, Target], list[Finding]]:
    """Channel of every column of the table, and findings on columns of no known kind."""
    file = table.source
    for column in columns:
        if column in table.text and columns[column].column is not None:
            held = table.text[column]
            raise RecordingError(
                f"{file}: column {column}: it holds {quoted(held)}, not numbers: mend the cells or map it to null"
            )
    targets: dict[str, Target] = {}
    findings: list[Finding] = []
    stamps, stamps_unit = _named_stamps(table, columns)
    for column in [*table.columns, *table.text]:
        kind, _, name = column.partition(".")
        ours = column == "time" or (kind in KINDS and name != "")
        if column in columns:
            if column in table.columns:
                targets[column] = columns[column]
        elif ours and column in table.text:
            raise RecordingError(
                f"{file}: column {column}: it holds {quoted(table.text[column])}, not numbers: mend the cells"
            )
        elif ours:
            targets[column] = Target(column)
        elif says_torque(column) and column in table.columns:
            targets[column] = Target(f"{TORQUE}.{column}")
        elif column == stamps:
            targets[column] = Target("time", stamps_unit)
        elif meant := _meant(column, table, columns):
            raise RecordingError(
                f"{file}: column {quoted(column)}: did you mean {meant!r}? Mend the name, or map the column (--map), "
                "to null to leave it out"
            )
        else:
            findings.append(
                Finding(
                    "missing_column",
                    file,
                    column,
                    "its name is none of the contract's (kind.name), so it is left out; map it with --map to use it",
                )
            )
    return targets, findings


def check_mapped(columns: Mapping[str, Target], tables: Sequence[Table], file: str) -> None:
    """Refuse a map file that names a column which no recording has; one that is mapped to null may be absent.

    Args:
        columns: of the map file.
        tables: all of the recordings.
        file: name of the map file.

    Raises:
        RecordingError: says which column, and which one may be meant.
    """
    there = dict.fromkeys(column for table in tables for column in (*table.columns, *table.text))
    for column, target in columns.items():
        if target.column is None or column in there:
            continue
        unmapped = [name for name in there if name not in columns]
        meant = nearest(column, unmapped)
        listed = f"{', '.join(unmapped[:LISTED])}{' ...' if len(unmapped) > LISTED else ''}"
        mend = f"did you mean {meant!r}?" if meant else f"the map leaves over {listed or 'none of theirs'}"
        raise RecordingError(f"map file {file}: column {quoted(column)}: no recording has it; {mend}")


def _meant(column: str, table: Table, columns: Mapping[str, Target]) -> str | None:
    """Suggestion for a misspelled column: a column of the map file that this table lacks, or a kind of the contract."""
    there = {*table.columns, *table.text}
    known = there | {target.column for name, target in columns.items() if name in there}
    lacking = [name for name, target in columns.items() if name not in there and target.column not in (None, *known)]
    kind, _, name = column.partition(".")
    near = next(iter(get_close_matches(kind, list(KINDS), 1, SLIP)), None) if name else None
    return f"{near}.{name}" if near else nearest(column, lacking)


def _named_stamps(table: Table, columns: Mapping[str, Target]) -> tuple[str | None, str | None]:
    """The only column whose name says that it holds time stamps, and its unit; None where ``time`` exists or is
    mapped."""
    if "time" in table.columns or any(t.column == "time" and c in table.columns for c, t in columns.items()):
        return None, None
    named = {column: match[1].lower() for column in table.columns if (match := _STAMPS.match(column))}
    return next(iter(named.items())) if len(named) == 1 else (None, None)


def _check_known(sidecar: Sidecar, file: str, sidecar_file: str) -> None:
    if not sidecar.robot:
        raise RecordingError(
            f'{file}: which robot is recorded is unknown: write "robot" into {sidecar_file}, or give --env or --model '
            "(of import: --robot)"
        )


def _check_enough(
    channels: Mapping[str, Mapping[str, Array]], sidecar: Sidecar, file: str, sidecar_file: str, replayed: bool
) -> None:
    if not any(channels[kind] for kind in ("position", "velocity", "force")):
        raise RecordingError(
            f"{file}: no column is measured motion or force (missing_column): name them position.JOINT, velocity.JOINT "
            "or force.SENSOR, or map them with --map"
        )
    if replayed and not channels["command"] and not channels["effort"]:
        raise RecordingError(
            f"{file}: neither command.ACTUATOR nor effort.JOINT is there, so nothing can be replayed (missing_column): "
            "record the commands, or map them with --map"
        )
    if channels["command"] and sidecar.interface is None:
        raise RecordingError(
            f'{file}: what its commands are is unknown: write "interface": "velocity", "position" or "effort" '
            f"into {sidecar_file}"
        )


def _check_efforts(
    targets: Mapping[str, Target], columns: Mapping[str, Target], stated: Mapping[str, str], file: str
) -> None:
    """Ask what the numbers of mapped efforts are where efforts are all that there is to compare: drives report torques,
    currents and counts, and each of them looks like the others at another scale.

    Raises:
        RecordingError: a map names a column as an effort, and neither it nor the sidecar says its unit.
    """
    for column, target in targets.items():
        said = target.told or (target.column or "") in stated
        if column in columns and (target.column or "").startswith("effort.") and not said:
            raise RecordingError(f"{file}: column {column}: in which unit is this effort? Say so in the map: {ASKED}")


def _rate(time: Array, channels: Mapping[str, Mapping[str, Array]]) -> float:
    """Rate of the commands, else of the positions, else of the rows [Hz]."""
    for kind in ("command", "position"):
        for values in channels[kind].values():
            stamps = time[~np.isnan(values)]
            if len(stamps) > 2:
                return round(float(1 / np.median(np.diff(stamps))), 6)
    return round(float(1 / np.median(np.diff(time))), 6)


def _factor(kind: str, unit: str, column: str, file: str) -> float:
    try:
        return factor(kind, unit)
    except ValueError as fault:
        raise RecordingError(f"{file}: column {column}: {fault}") from fault


def _converted(kind: str, unit: str, column: str, file: str, scale: float) -> list[Finding]:
    """A finding on a stated unit, where it changed values."""
    if scale == 1.0:
        return []
    code = "time_unit" if kind == "time" else "degrees" if unit.startswith("deg") else "unit_scale"
    return [Finding(code, file, column, f"stated to be in {unit}; multiplied by {scale:.6g}", repaired=True)]
