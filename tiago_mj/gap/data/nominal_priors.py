"""What a recording says of its nominal model's own numbers: how well they are known.

``"uncertainty": {"torque_constant": 0.3}`` in a sidecar: one standard deviation of an effect's first parameter, in its
unit, of a factor of its logarithm, of all targets or, as ``"torque_constant.elbow"``, of one. Such a number is fitted
along with every explanation, the nominal model included, and never named: what a data sheet leaves open is no gap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.data.recording import RecordingError, Trial


def known_to(trials: Sequence[Trial]) -> dict[tuple[str, str | None], float]:
    """One standard deviation by (effect, target or None for all).

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
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < float("inf"):
                raise RecordingError(
                    f"{trial.source}: uncertainty.{key} in the sidecar is {value!r}: write one standard deviation, a "
                    "positive number"
                )
            if found.setdefault((effect, target or None), float(value)) != float(value):
                raise RecordingError(
                    f"{trial.source}: uncertainty.{key} in the sidecar is not that of {trials[0].source}: the numbers "
                    "of one nominal model are known to the same: mend one of them, or diagnose them apart"
                )
    return found


def deviation(known: Mapping[tuple[str, str | None], float], effect: str, target: str | None) -> float | None:
    """Of an effect on one target; None if nothing is said."""
    return known.get((effect, target), known.get((effect, None)))
