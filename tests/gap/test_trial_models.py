"""What MuJoCo says of models that a search tries is counted, and no alarm; of the user's own model it is told."""

import json

import mujoco
import pytest

from tiago_mj.cli import main
from tiago_mj.gap import pipeline
from tiago_mj.gap.report import json as report_json
from tiago_mj.recordings.read import read_recordings

SINGULAR = "Inertia matrix is too close to singular at DOF {}. Check model. Time = {}."


def warns_before(function, times):
    """A function before which MuJoCo warns."""

    def warning(*given, **named):
        for k in range(times):
            mujoco.get_mju_user_warning()(SINGULAR.format(k, 0.1 * k))
        return function(*given, **named)

    return warning


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grasps")
    words = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--seed", "3"]
    assert main([*words, "--out", str(folder)]) == 0
    return read_recordings([folder]).trials


def test_warnings_of_models_that_are_tried_are_counted_and_of_the_nominal_one_told(trials, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "predictor", warns_before(pipeline.predictor, 2))
    monkeypatch.setattr(pipeline.select, "select", warns_before(pipeline.select.select, 5))
    found = pipeline.diagnose(trials, names=["force_bias"], threads=1)
    assert [note for note in found.notes if "MuJoCo" in note] == [
        "MuJoCo warned 2 times: Inertia matrix is too close to singular. Check model."
    ]
    assert found.trial_models.warnings == {"Inertia matrix is too close to singular. Check model": 5}
    assert found.trial_models.simulations > found.trial_models.diverged == 0
    path = tmp_path / "diagnosis.json"
    report_json.write(found, path)
    assert json.loads(path.read_text())["trial_models"] == {
        "simulations": found.trial_models.simulations,
        "diverged": 0,
        "warnings": found.trial_models.warnings,
    }
    assert report_json.load(path).trial_models == found.trial_models
