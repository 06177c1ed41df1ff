"""Pictures of a diagnosis: a still for its report, and an interactive scene beside it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final

from tiago_mj.gap.report.repaired import entry
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.recording import Trial
from tiago_mj.view import page
from tiago_mj.view.recordings import as_diagnosed
from tiago_mj.view.still import still
from tiago_mj.view.story import tell

#: A scene that is larger is not written beside a report [byte].
MAX_SCENE_BYTES: Final = 5_000_000


@dataclass(frozen=True)
class Pictures:
    """Pictures of one diagnosis.

    Attributes:
        scene: an HTML page that opens without a server; None without the extra ``view``, or where it is too large.
        png: a still, base64; empty where OpenGL is not there.
        caption: of the still, as a sentence.
    """

    scene: str | None = None
    png: str = ""
    caption: str = ""


def pictures(plant: Plant, trials: Sequence[Trial], diagnosis: Diagnosis, deadline: Deadline | None = None) -> Pictures:
    """Still and scene of a diagnosis, from a replay of the recording that its report shows.

    Args:
        plant: the nominal simulator.
        trials: that were diagnosed, as they were read.
        diagnosis: what was found.
        deadline: asked while it is replayed, and before each picture; None: there is none.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    by = deadline or Deadline()
    cut = as_diagnosed(plant, trials)
    if len(cut) > len(trials):
        plant = plant_of(cut, model=plant.file, given=plant.given)
    tested = diagnosis.splits.get("test", ())
    trial = next((one for one in cut if one.name in tested), cut[0])
    effects = [entry(effect) for effect in diagnosis.repair]
    story = tell(plant, trial, effects, diagnosis, seed=diagnosis.seed, deadline=by)
    by.check()
    scene = page.render(story) if find_spec("viser") is not None else None
    if scene is not None and len(scene) > MAX_SCENE_BYTES:
        scene = None
    by.check()
    taken = still(story)
    if taken is None:
        return Pictures(scene)
    png, larger, moment = taken
    robots = "grey: the measured robot"
    if len(story.motions) > 1:
        robots += "; orange: the nominal simulator"
    if len(story.motions) > 2:
        robots += "; blue: the repaired one"
    lit = f"; lit in magenta: {story.where}" if story.lit else ""
    scale = f" Their differences are drawn {larger} times larger than they are." if larger > 1 else ""
    caption = f"{trial.name} at {moment:.2f} s, {robots}{lit}.{scale}"
    return Pictures(scene, base64.b64encode(png).decode(), caption)
