"""A session of recordings: its nominal simulator, its trials, and what each of them is used for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tiago_mj.effects import Entry
from tiago_mj.gap.simulation.along_a_motion import torques_along_a_motion
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.recording import Trial
from tiago_mj.recordings.trials import cut_long

#: Splits that explanations are fitted to; the test trials are kept aside.
FITTED: Final = ("train", "validation")


@dataclass(frozen=True)
class Session:
    """Recordings of one robot, cut and split.

    Attributes:
        plant: their nominal simulator.
        trials: to be compared.
        recorded: how many recordings they were cut from.
        splits: names of the train, validation and test trials.
    """

    plant: Plant
    trials: Sequence[Trial]
    recorded: int
    splits: Mapping[str, tuple[str, ...]]

    def subset(self, *splits: str) -> Subset:
        """The trials of some splits."""
        wanted = {name for split in splits for name in self.splits[split]}
        return Subset.of(k for k, trial in enumerate(self.trials) if trial.name in wanted)


def split(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Train, validation and test trials: about 60, 20 and 20 %, spread over the session; one trial is for training
    alone."""
    count = len(names)
    test = set(range(count - 1, 0, -5)) if count > 1 else set()
    rest = [k for k in range(count) if k not in test]
    validation = set(rest[len(rest) - 1 : 0 : -4]) if len(rest) > 2 else set()
    return {
        "train": tuple(names[k] for k in rest if k not in validation),
        "validation": tuple(names[k] for k in sorted(validation)),
        "test": tuple(names[k] for k in sorted(test)),
    }


def session_of(plant: Plant, trials: Sequence[Trial]) -> Session:
    """Recordings as they are, of a simulator that is known."""
    return Session(plant, trials, len(trials), split([trial.name for trial in trials]))


def session(
    trials: Sequence[Trial], *, env: str | None = None, model: Path | None = None, given: Sequence[Entry] = ()
) -> Session:
    """Recordings of one robot, cut and split.

    Args:
        trials: recorded.
        env, model: what to simulate where the recordings do not say.
        given: effects that are known already.

    Raises:
        RecordingError: the recordings are not of one robot that can be simulated; one line.
    """
    plant = plant_of(trials, env=env, model=model, given=given)
    recorded, trials = len(trials), _cut(plant, trials)
    if len(trials) > recorded:
        plant = plant_of(trials, env=env, model=model, given=given)
    return Session(plant, trials, recorded, split([trial.name for trial in trials]))


def _cut(plant: Plant, trials: Sequence[Trial]) -> Sequence[Trial]:
    """Long recordings of a plain model as several trials; where an object is about, nobody knows how it stood in
    between."""
    if plant.environment is not None or not trials[0].commands or torques_along_a_motion(plant, trials):
        return trials
    return cut_long(trials)
