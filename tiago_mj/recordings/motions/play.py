"""Motions to play: commands over time, from a file or smooth random ones.

A motion file is CSV, or YAML, with ``time`` [s] and ``command.ACTUATOR``; each command holds until the next row's.
YAML, or a JSON sidecar beside a CSV, may also say ``interface`` and ``rate_hz``, for which the motion was made:

    interface: velocity
    rate_hz: 25
    time: [0.0, 0.5, 1.0]
    command.gripper_right_finger_joint: [-0.02, 0.0, 0.02]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.io.loading import load_yaml
from tiago_mj.io.quoting import is_number, is_one_of, quoted, unquoted
from tiago_mj.recordings import motions
from tiago_mj.recordings.read.tables import read_table
from tiago_mj.recordings.recording import INTERFACES, Array
from tiago_mj.recordings.sidecar import load_sidecar
from tiago_mj.recordings.usable import RATE as A_RATE
from tiago_mj.recordings.usable import is_rate

_PREFIX: Final = "command."
#: Times within this share of a control step of its beginning were rounded.
ROUNDED: Final = 0.02
#: A motion is for minutes, not for hours [control steps].
MAX_STEPS: Final = 200_000
#: Stamps since 1970 have ten digits [s]; of more, a millisecond is no longer told from the next.
LONGEST: Final = 1e11
#: Frequencies of random motions [Hz]: below what a robot's servos follow, above what a short recording misses.
FREQUENCIES: Final = (0.2, 1.5)
#: Waves that are added up.
WAVES: Final = 4


@dataclass(frozen=True)
class Motion:
    """Commands over time, each held until the next.

    Attributes:
        name: of the file, without suffix.
        time: (T,) [s], strictly increasing from 0.
        commands: by actuator, (T,) in the interface's unit.
        interface: that it was made for; None: unsaid.
        rate_hz: that it was made for [Hz]; None: unsaid.
    """

    name: str
    time: Array
    commands: Mapping[str, Array]
    interface: str | None = None
    rate_hz: float | None = None

    def steps(self, rate_hz: float) -> int:
        """Control steps in which every command is sent at least once.

        Raises:
            ValueError: there would be too many.
        """
        steps = np.floor(self.time[-1] * rate_hz + 1e-6) + 1
        if not steps <= MAX_STEPS:
            raise ValueError(
                f"motion {self.name}: {steps:.0f} control steps are more than {MAX_STEPS}: is its time in s?"
            )
        return int(steps)

    def at(self, rate_hz: float) -> dict[str, Array]:
        """The command of every control step, by actuator, (steps,)."""
        instants = np.arange(self.steps(rate_hz)) / rate_hz
        row = np.searchsorted(self.time, instants + 1e-9 / rate_hz, side="right") - 1
        return {name: values[row] for name, values in self.commands.items()}


def read_motion(path: Path) -> Motion:
    """A motion from its file, or from the menu (:mod:`tiago_mj.recordings.motions`) by a name that is no file here.

    Raises:
        ValueError: it is no motion; says what is wrong.
    """
    if not path.is_file():
        listed = motions.find(str(path))
        if listed is None and (there := motions.rates(str(path))):
            raise ValueError(f"motion {path} is on the menu at several rates: write {' or '.join(there)}")
        if listed is None:
            raise ValueError(f"motion {path}: no such file, nor on the menu of docs/motions.md")
        path = listed
    facts: Mapping[str, Any]
    columns: dict[str, Any]
    if path.suffix.lower() in (".yaml", ".yml"):
        facts = load_yaml(path, f"motion {path.name} is no YAML", mend="mend the file, or give a long one as CSV")
        if not isinstance(facts, dict):
            raise ValueError(f"motion {path.name} is no mapping: write time: [...] and {_PREFIX}ACTUATOR: [...]")
        columns = {key: value for key, value in facts.items() if key == "time" or key.startswith(_PREFIX)}
        for name, values in columns.items():
            if not isinstance(values, list) or not all(map(is_number, values)):
                raise ValueError(f"motion {path.name}: column {unquoted(name)} does not hold numbers: {quoted(values)}")
    elif path.suffix.lower() in (".csv", ".parquet"):
        beside = path.with_suffix(".json")
        facts = load_sidecar(beside) if beside.is_file() else {}
        columns = dict(read_table(path, {}, "").columns)
    else:
        raise ValueError(f"motion {path.name}: of no known format: give .csv or .yaml")
    return _motion(path, columns, facts)


def random_motion(
    low: Mapping[str, float], high: Mapping[str, float], seconds: float, rate_hz: float, seed: int
) -> Motion:
    """A smooth random motion within bounds, starting and ending in their middle.

    Sums of sines of random phases (:data:`FREQUENCIES`), faded in and out over an eighth of the time.

    Args:
        low, high: bounds of the commands by actuator.
        seconds: how long.
        rate_hz: control rate [Hz].
        seed: the same gives the same motion.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(max(int(seconds * rate_hz), 2)) / rate_hz
    fade = np.clip(np.minimum(time, time[-1] - time) / (time[-1] / 8), 0.0, 1.0)
    commands = {}
    for name in low:
        frequency = rng.uniform(*FREQUENCIES, WAVES)
        phase = rng.uniform(0, 2 * np.pi, WAVES)
        wave = np.sin(2 * np.pi * frequency * time[:, None] + phase).mean(axis=1)
        commands[name] = (low[name] + high[name]) / 2 + (high[name] - low[name]) / 2 * fade * wave
    return Motion("random", time, commands, rate_hz=rate_hz)


def _motion(path: Path, columns: Mapping[str, Any], facts: Mapping[str, Any]) -> Motion:
    file = path.name
    series: dict[str, Array] = {}
    for name, values in columns.items():
        if name != "time" and not name.startswith(_PREFIX):
            continue
        series[name] = np.asarray(values, dtype=np.float64)
        if not np.isfinite(series[name]).all():
            raise ValueError(f"motion {file}: column {name} has empty or infinite cells: give every row a number")
    if "time" not in series or len(series) < 2:
        raise ValueError(f"motion {file}: give the columns time and {_PREFIX}ACTUATOR")
    time = series.pop("time")
    for name, values in series.items():
        if len(values) != len(time):
            raise ValueError(f"motion {file}: {name} has {len(values)} numbers, time has {len(time)}: give as many")
    if not (np.abs(time) < LONGEST).all():
        raise ValueError(f"motion {file}: column time reads {np.abs(time).max():g}: is it in s?")
    if len(time) < 2 or (np.diff(time) <= 0).any():
        raise ValueError(f"motion {file}: column time must have two rows or more and increase from row to row")
    interface, rate = facts.get("interface"), facts.get("rate_hz")
    if interface is not None and not is_one_of(interface, INTERFACES):
        raise ValueError(f"motion {file}: interface {quoted(interface)} is unknown: use one of {', '.join(INTERFACES)}")
    if rate is not None and not is_rate(rate):
        raise ValueError(f"motion {file}: rate_hz is {quoted(rate)}: {A_RATE}")
    commands = {name.removeprefix(_PREFIX): values for name, values in series.items()}
    time = time - time[0]
    if rate is not None:  # written with few digits, a row must not fall behind the control step that it is for
        step = np.round(time * rate)
        time = np.where(np.abs(time * rate - step) < ROUNDED, step / rate, time)
    return Motion(path.stem, time, commands, interface, None if rate is None else float(rate))
