"""Recordings and their diagnosis, as stories to watch."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from tiago_mj.effects import read_effects
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.report.json import NAME, load
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.simulation.along_a_motion import torques_along_a_motion
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.io.quoting import one_line, quoted
from tiago_mj.recordings.recording import RecordingError, Trial
from tiago_mj.recordings.trials import cut_long
from tiago_mj.robots.options import Said
from tiago_mj.view.story import Story, tell

CALIBRATION: Final = "calibration.yaml"
#: Ends of the names of files that can be added.
ADDED: Final = (".csv", ".parquet")
#: The recordings alone say which robot they are of.
NOTHING_SAID: Final = Said(env=None, model=None, facts={}, columns=None)


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


class Shelf:
    """Recordings that are shown, and those that are added to them while one looks.

    Args:
        paths: files or folders.
        place: where added files are kept.
        robot: what is said of theirs.
        given: other arguments of :func:`library`.

    Attributes:
        library: of the paths.
    """

    def __init__(self, paths: Sequence[Path], place: Path, robot: Said = NOTHING_SAID, **given: Any) -> None:
        self._paths, self._place, self._robot, self._given = list(paths), place, robot, given
        self.library = library(self._paths, robot, **given)
        self._by_name = {trial.name: self.library for trial in self.library.trials}

    def story(self, name: str) -> Story:
        """Story of a trial, by its name."""
        return self._by_name[name].story(name)

    def names(self) -> list[str]:
        """Of all trials, in their order."""
        return list(self._by_name)

    def add(self, name: str, content: bytes) -> list[str]:
        """Add a recording of the same robot, made as the first one was; the names of all trials, with its own last.

        Raises:
            ValueError: it cannot be read, or is of another robot; one line.
        """
        path = self._place / (Path(name).name or "recording.csv")
        if path.suffix.lower() not in ADDED or path.stem in self._by_name:
            raise ValueError(f"{quoted(name)}: give a file of another name that ends with {' or '.join(ADDED)}")
        plant = self.library.plant
        same = replace(self._robot, env=None if plant.file is not None else plant.name, model=plant.file)
        path.write_bytes(content)
        if (known := self._sidecar()) is not None:
            said = json.loads(known.read_text(encoding="utf-8"))
            said = {key: value for key, value in said.items() if key != "initial"} | {"trial": path.stem}
            path.with_suffix(".json").write_text(json.dumps(said), encoding="utf-8")
        try:
            found = library([path], same, **self._given)
        except (RecordingError, ValueError) as fault:
            raise ValueError(one_line(fault)) from fault
        self._by_name |= {trial.name: found for trial in found.trials}
        return self.names()

    def _sidecar(self) -> Path | None:
        """What was said of the first recording, which then holds of an added one, too; None: nothing was."""
        beside = (sorted(path.glob("*.json")) if path.is_dir() else [path.with_suffix(".json")] for path in self._paths)
        return next((one for some in beside for one in some if one.is_file()), None)


def library(
    paths: Sequence[Path],
    robot: Said = NOTHING_SAID,
    *,
    map_file: Path | None = None,
    folder: Path | None = None,
    effects: Any = None,
) -> Library:
    """Read recordings, and the diagnosis of them where one is named.

    Args:
        paths: files or folders.
        robot: what to simulate, and what is known of it, where the recordings do not say.
        map_file: which column is what.
        folder: that ``tiago-mj diagnose`` wrote.
        effects: of the repaired simulator, in place of the diagnosis's.

    Raises:
        RecordingError: a recording cannot be used; one line.
        ValueError: the folder holds no diagnosis, or its effects do not fit this robot; one line.
    """
    read = robot.read(paths, map_file)
    diagnosis, entries = None, read_effects(effects)
    if folder is not None:
        if not folder.is_dir():
            raise ValueError(f"--diagnosis {folder}: no such folder: give the one that tiago-mj diagnose wrote")
        diagnosis = load(folder / NAME)
        entries = entries or read_effects(str(folder / CALIBRATION))
    plant_of(read.trials, env=robot.env, model=robot.model, given=entries)  # refuses effects that it cannot have
    plant = plant_of(read.trials, env=robot.env, model=robot.model)
    if diagnosis is not None and diagnosis.robot != plant.name:
        raise ValueError(
            f"--diagnosis {folder}: it is of {diagnosis.robot}, and the recordings are of {plant.name}: give the "
            "recordings that were diagnosed"
        )
    trials = as_diagnosed(plant, read.trials)
    if len(trials) > len(read.trials):
        plant = plant_of(trials, env=robot.env, model=robot.model)
    return Library(plant, tuple(trials), entries, diagnosis)


def as_diagnosed(plant: Plant, trials: Sequence[Trial]) -> Sequence[Trial]:
    """Trials as the diagnosis saw them: long recordings of a plain model are cut."""
    if plant.environment is not None or not trials[0].commands or torques_along_a_motion(plant, trials):
        return trials
    return cut_long(trials)


__all__ = ["Library", "RecordingError", "Shelf", "as_diagnosed", "library"]
