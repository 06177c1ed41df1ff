"""Load cells and encoders of few bits, in the independent reality: what they read says "between", and is diagnosed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import Case, EffectChoice
from benchmarks.blind.facts import Grid
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings

#: Eight bits over 16.5 sensor units (100 N): a step of 0.064, eight times the noise, which at rest reads 0 throughout.
CELLS = Grid("force", 8, span=16.5)
STEP = 16.5 / 256
PRESSED = Case(seed=4301, rate=240.0, seconds=1.4, trials=5, offset=0.005, spread=0.03, grids=(CELLS,))
STRONGER = EffectChoice("force_gain", ("right",), {"factor": 1.4})
NAMES = ("force_gain", "force_crosstalk", "force_bias", "force_quantization", "servo_stiffness", "contact_stiffness")


def diagnosed(case: Case, folder: Path, *, stated: bool = True, names: tuple[str, ...] = NAMES) -> Diagnosis:
    """As the command does it: lint, then diagnose; a grid that is not ``stated`` is not in the sidecars."""
    recordings.write(cases.simulate(case), folder)
    trials = read_recordings([folder]).trials
    if not stated:
        trials = [
            replace(t, sidecar=replace(t.sidecar, raw={k: v for k, v in t.sidecar.raw.items() if k != "quantum"}))
            for t in trials
        ]
    findings = lint.inspect_all(trials, plant_of(trials))
    assert not [f for f in findings if f.discredits]
    return diagnose(trials, findings=findings, usable=lint.believed(trials, findings), names=names, threads=2)


@pytest.mark.slow
def test_load_cells_of_eight_bits_are_no_gap_where_their_sidecar_says_so(tmp_path: Path) -> None:
    found = diagnosed(PRESSED, tmp_path)
    assert (found.kind, found.best.effects, found.remains) == ("no_gap", (), False)
    assert found.shrink.accounted is not None
    assert found.shrink.accounted < 4  # the mean square of what nominal numbers leave is that of noise
    assert not {"force_gain", "force_bias", "force_crosstalk"} & set(found.not_excited)


@pytest.mark.slow
def test_a_grid_that_nothing_states_is_named_and_nothing_else(tmp_path: Path) -> None:
    found = diagnosed(PRESSED, tmp_path, stated=False)
    (grid,) = found.best.effects
    assert (found.kind, grid.name) == ("effect", "force_quantization")
    assert grid.parameters["step"].value == pytest.approx(STEP, rel=1e-3)


@pytest.mark.slow
def test_a_gain_of_one_load_cell_of_eight_bits_is_named(tmp_path: Path) -> None:
    found = diagnosed(replace(PRESSED, effects=(STRONGER,)), tmp_path)
    (gain,) = found.best.effects
    assert (found.kind, gain.name, gain.target) == ("effect", "force_gain", "right")
    # Cells of one kind differ by 4 %.
    assert gain.parameters["factor"].value == pytest.approx(1.4, rel=0.1)


@pytest.mark.parametrize("before", [False, True], ids=["noise is rounded", "noise comes after"])
@pytest.mark.parametrize("kind", ["force", "position"])
def test_the_right_model_leaves_noise_through_a_coarse_grid(tmp_path: Path, kind: str, before: bool) -> None:
    """Nominal numbers are exact and objects stand where they are said to: nothing but another integrator is left."""
    grid = Grid(kind, 8, span=16.5, before=before)
    case = replace(PRESSED, trials=2, offset=0.0, spread=0.0, placement=0.0, grids=(grid,))
    made = cases.simulate(case)
    recordings.write(made, tmp_path)
    trials = read_recordings([tmp_path]).trials
    predict, _ = predictor(plant_of(trials), trials, threads=1)
    data = predict.data
    predicted = predict.all_trials([()], [0, 1])[0]
    mine = [c for c, name in enumerate(data.channels) if name.startswith(kind)]
    assert data.step is not None
    np.testing.assert_allclose(data.step[mine], grid.steps(made.robot)[0], rtol=1e-3)
    square = np.nanmean(likelihood.scaled(data, likelihood.residual(data, predicted)) ** 2, axis=(0, 1))
    # As exact cells leave up to 1.5 where contact begins (benchmarks/results/effect_forms.json).
    assert (square[mine] < 1.5).all()
    assert (likelihood.lasting(data, data.value - predicted)[mine] < 1.5).all()
    if not before:  # a grid hides most of what a reading could tell, but no noise is zero
        truth = robots.FORCE_NOISE if kind == "force" else robots.FINGER_NOISE[0]
        assert (data.own[mine] >= truth / 2).all()
