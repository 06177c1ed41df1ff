"""Recordings and their diagnosis, as stories to watch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiago_mj.effects import read_effects
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.report.json import load
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.simulation.along_a_motion import torques_along_a_motion
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError, Trial
from tiago_mj.recordings.trials import cut_long
from tiago_mj.view.story import Story, tell

DIAGNOSIS, CALIBRATION = "diagnosis.json", "calibration.yaml"


@dataclass(frozen=True)
class Library:
    """Trials of one robot, and its simulators.

    Attributes:
        plant: the nominal simulator.
        trials: in their order.
        effects: of the repaired simulator; empty: there is none.
        diagnosis: what was found; None: it was not asked.
    """

    plant: Plant
    trials: tuple[Trial, ...]
    effects: tuple[Entry, ...]
    diagnosis: Diagnosis | None

    def story(self, name: str) -> Story:
        """Story of a trial, by its name."""
        trial = next(one for one in self.trials if one.name == name)
        return tell(self.plant, trial, self.effects, self.diagnosis)

    @property
    def first(self) -> str:
        """Name of the trial that is shown first: a test trial of the diagnosis, else the first."""
        tested = self.diagnosis.splits.get("test", ()) if self.diagnosis is not None else ()
        return next((trial.name for trial in self.trials if trial.name in tested), self.trials[0].name)


def library(
    paths: Sequence[Path],
    *,
    env: str | None = None,
    model: Path | None = None,
    map_file: Path | None = None,
    folder: Path | None = None,
    effects: Any = None,
) -> Library:
    """Read recordings, and the diagnosis of them where one is named.

    Args:
        paths: files or folders.
        env, model: what to simulate, where the recordings do not say.
        map_file: which column is what.
        folder: that ``tiago-mj diagnose`` wrote.
        effects: of the repaired simulator, in place of the diagnosis's.

    Raises:
        RecordingError: a recording cannot be used; one line.
        ValueError: the folder holds no diagnosis, or its effects do not fit this robot; one line.
    """
    said = {"robot": str(model)} if model is not None else {"robot": env} if env else {}
    read = read_recordings(paths, map_file=map_file, defaults=said, robot=said.get("robot"))
    diagnosis, entries = None, read_effects(effects)
    if folder is not None:
        if not folder.is_dir():
            raise ValueError(f"--diagnosis {folder}: no such folder: give the one that tiago-mj diagnose wrote")
        diagnosis = load(folder / DIAGNOSIS)
        entries = entries or read_effects(str(folder / CALIBRATION))
    plant = plant_of(read.trials, env=env, model=model, given=entries)  # refuses effects that this robot cannot have
    plant = plant_of(read.trials, env=env, model=model)
    if diagnosis is not None and diagnosis.robot != plant.name:
        raise ValueError(
            f"--diagnosis {folder}: it is of {diagnosis.robot}, and the recordings are of {plant.name}: give the "
            "recordings that were diagnosed"
        )
    trials = as_diagnosed(plant, read.trials)
    if len(trials) > len(read.trials):
        plant = plant_of(trials, env=env, model=model)
    return Library(plant, tuple(trials), entries, diagnosis)


def as_diagnosed(plant: Plant, trials: Sequence[Trial]) -> Sequence[Trial]:
    """Trials as the diagnosis saw them: long recordings of a plain model are cut."""
    if plant.environment is not None or not trials[0].commands or torques_along_a_motion(plant, trials):
        return trials
    return cut_long(trials)


__all__ = ["Library", "RecordingError", "as_diagnosed", "library"]
