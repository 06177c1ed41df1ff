"""What a recording says of its nominal model's own numbers: how well they are known.

``"uncertainty": {"torque_constant": 0.3}`` in a sidecar: one standard deviation of an effect's first parameter, in its
unit, of a factor of its logarithm, of all targets or, as ``"torque_constant.elbow"``, of one. Such a number is fitted
along with every explanation, the nominal model included, and never named: what a data sheet leaves open is no gap.

``"quantum": {"force": 0.0129}``: step of the grid of a sensor's readings, by kind or column, in the column's unit. It
is part of how readings are compared (:mod:`tiago_mj.gap.inference.between`), and never named either: a data sheet's
converter is no gap. A grid that nothing states is an effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.io.quoting import is_number, quoted
from tiago_mj.recordings.recording import MEASURED, RecordingError, Trial, channels


def known_to(trials: Sequence[Trial]) -> dict[tuple[str, str | None], float]:
    """Prior standard deviations of the nominal numbers, by (effect, target or None for all).

    Raises:
        RecordingError: it is no positive number, or trials of one robot say different things.
    """
    found: dict[tuple[str, str | None], float] = {}
    for trial in trials:
        said = trial.sidecar.raw.get("uncertainty")
        for key, value in (said if isinstance(said, dict) else {}).items():
            effect, _, target = str(key).partition(".")
            if effect not in EFFECTS:
                continue  # of a kind of reading, or of a column
            if not is_number(value) or value <= 0:
                raise RecordingError(
                    f"{trial.source}: uncertainty.{key} in the sidecar is {quoted(value)}: write one standard "
                    "deviation, a positive number"
                )
            if found.setdefault((effect, target or None), float(value)) != float(value):
                raise RecordingError(
                    f"{trial.source}: uncertainty.{key} in the sidecar is not that of {trials[0].source}: the numbers "
                    "of one nominal model are known to the same: mend one of them, or diagnose them apart"
                )
    return found


def deviation(known: Mapping[tuple[str, str | None], float], effect: str, target: str | None) -> float | None:
    """Prior standard deviation of an effect on one target; None if not stated."""
    return known.get((effect, target), known.get((effect, None)))


def grids(trials: Sequence[Trial], given: Sequence[Entry] = ()) -> dict[str, float]:
    """Stated quantization step of every channel that has one, in its unit.

    Args:
        trials: of one robot.
        given: effects that are known already; those that round readings state a grid, too.

    Raises:
        RecordingError: it is no positive number or of no column, or trials of one robot say different things.
    """
    found: dict[str, float] = {}
    for trial in trials:
        for channel, value in _quanta(trial).items():
            if found.setdefault(channel, value) != value:
                raise RecordingError(
                    f"{trial.source}: the sidecar's quantum of {channel} is {value:g}, another recording's is "
                    f"{found[channel]:g}: one sensor has one grid: mend one of them, or diagnose them apart"
                )
    for entry in given:
        declared = EFFECTS[entry.name]
        for channel in {c for trial in trials for c in channels(trial)} if declared.rounds else ():
            kind, _, name = channel.partition(".")
            if kind == declared.rounds and (entry.target is None or name in entry.target):
                parameter = next(iter(declared.parameters.values()))
                step = float(entry.parameters.get(parameter.name, parameter.default[0]))
                found[channel] = max(found.get(channel, 0.0), step)
    return found


def _quanta(trial: Trial) -> dict[str, float]:
    """Stated steps by column; one for a column overrides that for its kind."""
    said = trial.sidecar.raw.get("quantum")
    if said is None:
        return {}
    if not isinstance(said, dict):
        raise RecordingError(
            f"{trial.source}: quantum in the sidecar is {said!r}: write steps by kind or column, such as "
            '{"force": 0.0129}'
        )
    out = {}
    for key, value in sorted(said.items(), key=lambda one: "." in one[0]):
        mine = [channel for channel in channels(trial) if key in (channel, channel.partition(".")[0])]
        if not mine and key not in MEASURED:
            raise RecordingError(
                f"{trial.source}: quantum.{key} in the sidecar is none of its columns: write a column, or one of "
                f"{', '.join(MEASURED)}"
            )
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
            raise RecordingError(
                f"{trial.source}: quantum.{key} in the sidecar is {value!r}: write the step of the readings, a "
                "positive number in the column's unit"
            )
        out.update(dict.fromkeys(mine, float(value)))
    return out
