"""A hinge without effects, as the blind check's independent reality records it with the nominal model's own numbers."""

from pathlib import Path

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import FAST_RATE, Case
from tiago_mj.gap.inference.predictor import Predictor, predictor
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.replay import Signals
from tiago_mj.recordings.read import read_recordings

HINGE = Case(seed=5252, setting="plain", interface="position", spread=0.0, rate=FAST_RATE, seconds=1.6, trials=4)


def recorded(folder: Path) -> tuple[Predictor, Signals]:
    """Its simulations and nominal replay; the recordings and the model are written into the folder."""
    (folder / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(HINGE, folder), folder)
    trials = read_recordings([folder]).trials
    return predictor(plant_of(trials, model=folder / robots.PLAIN_FILE), trials, threads=1)
