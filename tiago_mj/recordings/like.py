"""Parts of a robot that are built alike, such as four legs: whose joints have the same names but for a beginning."""

from __future__ import annotations

from collections.abc import Sequence

from tiago_mj.recordings.recording import RecordingError, Trial

#: Between the name of a part and that of a joint.
JOINTS = "_-./"


def prefixes(trials: Sequence[Trial]) -> tuple[str, ...]:
    """What the names of like parts begin with, as the recordings, their map or the command line say it."""
    return tuple(trials[0].sidecar.raw.get("like") or ())


def tied(trials: Sequence[Trial]) -> bool:
    """Whether like parts are said to share one magnitude of each effect.

    Raises:
        RecordingError: nothing says which parts are alike; one line.
    """
    said = bool(trials[0].sidecar.raw.get("tie"))
    if said and not prefixes(trials):
        raise RecordingError(
            f"{trials[0].source}: tie (--tie) is of parts that are alike, and nothing says which these are: give "
            "--like FL,FR,RL,RR, what their joints' names begin with"
        )
    return said


def alike(names: Sequence[str], said: Sequence[str]) -> dict[str, dict[str, str]]:
    """Names by part, then by what is left of them: of ``FL_hip_joint`` the part ``FL`` and ``hip_joint``.

    Args:
        names: of joints or actuators.
        said: what the names of the parts begin with, two or more.

    Raises:
        RecordingError: a part has no such name, or another number of them than the first; one line.
    """
    found: dict[str, dict[str, str]] = {}
    for part in said:
        found[part] = {
            name[len(part) :].strip(JOINTS): name for name in names if name.startswith(part) and name != part
        }
    if len(said) < 2 or not all(found.values()):
        empty = [part for part, mine in found.items() if not mine]
        raise RecordingError(
            f"like is {', '.join(said)}: "
            + (f"no joint begins with {empty[0]}" if empty else "give two parts or more")
            + f": there are {', '.join(names)}"
        )
    first = found[said[0]]
    for part, mine in found.items():
        if set(mine) != set(first):
            raise RecordingError(
                f"like is {', '.join(said)}: {part} has {', '.join(sorted(mine))}, and {said[0]} has "
                f"{', '.join(sorted(first))}: parts that are alike have the same joints"
            )
    return found
