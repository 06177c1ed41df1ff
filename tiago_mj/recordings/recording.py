"""A recording of a robot in memory: one trial, what is known of it, and what was found wrong with it.

Every later stage works on these values alone; where they came from (CSV, Parquet, a ROS bag) no longer matters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import one_line

Array = NDArray[np.float64]

SCHEMA: Final = "tiago_mj.recording/1"
INTERFACES: Final = ("velocity", "position", "effort")

#: Prefix of a column and where a trial keeps its channels, in the order in which columns are written.
KINDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "command": "commands",
        "position": "positions",
        "velocity": "velocities",
        "effort": "efforts",
        "force": "forces",
        "extra": "extras",
    }
)
#: Kinds that a sensor measured.
MEASURED: Final = ("position", "velocity", "effort", "force")

#: Every lint code, in the order of a report.
CODES: Final = (
    "empty",
    "too_short",
    "missing_column",
    "time_unit",
    "time_origin",
    "time_not_monotonic",
    "time_gap",
    "clock_jitter",
    "unit_scale",
    "degrees",
    "sign",
    "swapped_channels",
    "unsigned",
    "dead_channel",
    "stuck",
    "quantum",
    "saturation",
    "single_trial",
    "contradiction",
)
#: Characters of a message.
_LONGEST: Final = 2000


class RecordingError(ValueError):
    """A recording cannot be used; one line says which file, which column and how to mend it."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message if len(message) <= _LONGEST else f"{message[:_LONGEST]} ..."))


@dataclass(frozen=True)
class Finding:
    """A fault or repair that the lint noticed.

    Attributes:
        code: one of :data:`CODES`.
        file: the recording's file name.
        channel: a column's name, ``""`` where it concerns the whole recording.
        message: one sentence: what, where, how to mend it.
        repaired: whether it was put right while reading.
        refuses: whether the recording cannot be used as it is; such a finding ends a diagnosis in one line.
        discredits: whether the channel cannot be believed in this recording, and is left out of use.
    """

    code: str
    file: str
    channel: str
    message: str
    repaired: bool = False
    refuses: bool = False
    discredits: bool = False

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise ValueError(f"lint code {self.code!r} is unknown: use one of {', '.join(CODES)}")

    def __str__(self) -> str:
        """The line that a user reads."""
        return one_line(f"{self.file}: {f'column {self.channel}: ' if self.channel else ''}{self.message}")


@dataclass(frozen=True)
class Sidecar:
    """Metadata of a trial (``NAME.json``).

    Attributes:
        schema: :data:`SCHEMA`.
        trial: name of the trial.
        robot: environment id, robot name, or path of an MJCF file; read from a sidecar, a path that leads to a file
            from the recording's folder is absolute.
        rate_hz: rate of the commands, or of the rows where there are none [Hz].
        interface: what a command is: ``velocity`` [m/s, rad/s], ``position`` [m, rad] or ``effort`` [N, N·m]; None
            only where nothing is commanded.
        servo: what is known of it (``name``, ``stiffness`` and ``damping`` by joint ...), or None.
        sensing: of the load cells: ``scale``, ``contact_unit`` [N], ``average``, ``noise`` [sensor units], or None.
        object: what was grasped: ``shape``, ``radius_m`` ..., or None.
        initial: ``position``, ``velocity``, ``set_point``, each by joint [m, rad, per s], or None.
        goal: of the task, as the recorder wrote it.
        motion: what was played, as the recorder wrote it.
        source: who recorded it with what, as the recorder wrote it.
        units: of columns where they differ from the contract's; already applied to a trial's channels.
        raw: the whole mapping.
    """

    schema: str = SCHEMA
    trial: str = ""
    robot: str = ""
    rate_hz: float = 0.0
    interface: str | None = None
    servo: dict[str, Any] | None = None
    sensing: dict[str, Any] | None = None
    object: dict[str, Any] | None = None
    initial: dict[str, dict[str, float]] | None = None
    goal: Any = None
    motion: Any = None
    source: Any = None
    units: dict[str, str] | None = None
    raw: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Trial:
    """One recorded motion. Row k is (what was measured at ``time[k]``, the command sent then and held until row k + 1).

    Attributes:
        name: unique among the trials read together.
        time: (T,) [s], strictly increasing, from 0.
        commands: by actuator, (T,) in the unit of the sidecar's ``interface``; NaN where a row has none.
        positions, velocities, efforts: by joint, (T,) [m, rad; per s; N, N·m]; NaN where a row has none.
        forces: by sensor (``right``, ``left``), (T,) [sensor units]; NaN where a row has none.
        sidecar: what is known beside the columns.
        source: name of the file, without its folder.
        extras: columns ``extra.NAME``, in whatever unit: kept, never used.
        units: in which channels came that were converted while reading, by column's name.
        left_out: columns that the map file maps to null, whether they are there or not.
        part_of: names of the files that it was cut from, the latest first.
    """

    name: str
    time: Array
    commands: Mapping[str, Array]
    positions: Mapping[str, Array]
    velocities: Mapping[str, Array]
    efforts: Mapping[str, Array]
    forces: Mapping[str, Array]
    sidecar: Sidecar
    source: str
    extras: Mapping[str, Array] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    left_out: frozenset[str] = frozenset()
    part_of: tuple[str, ...] = ()


@dataclass(frozen=True)
class ReadResult:
    """Trials, and what was found and repaired while they were read."""

    trials: tuple[Trial, ...]
    findings: tuple[Finding, ...]


def channels(trial: Trial, *, kinds: tuple[str, ...] = MEASURED) -> Iterator[str]:
    """Names such as ``position.gripper_right_finger_joint``, kind by kind."""
    for kind in kinds:
        for name in getattr(trial, KINDS[kind]):
            yield f"{kind}.{name}"


def channel(trial: Trial, name: str) -> Array:
    """The samples of a channel, (T,).

    Raises:
        KeyError: the trial has no such channel.
    """
    kind, _, rest = name.partition(".")
    return np.asarray(getattr(trial, KINDS[kind])[rest])


def names(trials: tuple[Trial, ...], kinds: tuple[str, ...] = MEASURED) -> tuple[str, ...]:
    """Every channel that any of the trials has, kind by kind, in the order of their first appearance."""
    found = dict.fromkeys(name for trial in trials for name in channels(trial, kinds=kinds))
    return tuple(sorted(found, key=lambda name: kinds.index(name.partition(".")[0])))


def sampled(trial: Trial, name: str) -> tuple[Array, Array]:
    """Times and values of the rows in which a channel was sampled, each (n,)."""
    values = channel(trial, name)
    there = ~np.isnan(values)
    return trial.time[there], values[there]
