"""The recommended motion is played in the case's own reality, and everything is diagnosed again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.blind import cases, next_motion, recordings
from benchmarks.blind.cases import Case, EffectChoice
from benchmarks.blind.run import Diagnoser
from benchmarks.blind.store import Store
from tiago_mj.recordings.read import read_recordings

FRICTION, LAG = {"name": "coulomb_friction", "target": "all"}, {"name": "command_lag", "target": "all"}


def ambiguous(tmp_path: Path, interface: str, file: str) -> tuple[Case, Store, dict[str, Any]]:
    """A recorded case whose answer has two explanations, and a motion that would tell."""
    choice = EffectChoice("coulomb_friction", "all", {"force": 2.0})
    case = Case(seed=77, interface=interface, effects=(choice,), rate=25.0, seconds=1.0, trials=2)
    store = Store(tmp_path)
    recordings.write(cases.simulate(case), store.recordings(0))
    store.diagnosis(0).mkdir()
    verdict = {
        "kind": "ambiguous",
        "effects": [FRICTION],
        "alternatives": [{"effects": [FRICTION]}, {"effects": [LAG]}],
    }
    told = {"verdict": verdict, "next_motion": {"file": file}}
    (store.diagnosis(0) / "diagnosis.json").write_text(json.dumps(told))
    return case, store, {"kind": "one", "effects": [FRICTION], "oracle": {"detectable": True}}


@pytest.mark.parametrize(
    ("interface", "file"),
    [
        ("velocity", "touch_release_25hz.csv"),
        pytest.param("position", "position_steps_25hz.csv", marks=pytest.mark.slow),
    ],
)
def test_a_motion_of_the_menu_is_recorded_beside_the_others_and_what_is_said_then_counts(tmp_path, interface, file):
    case, store, label = ambiguous(tmp_path, interface, file)
    names: list[str] = []

    def diagnosed(words: list[str]) -> tuple[int, str]:
        given, out = Path(words[words.index("diagnose") + 1]), Path(words[words.index("--out") + 1])
        trials = read_recordings([given]).trials
        names.extend(trial.name for trial in trials)
        played = next(trial for trial in trials if "next" in trial.name)
        finger = played.positions["gripper_right_finger_joint"]
        assert finger[0] == pytest.approx(0.045, abs=1e-3)  # it begins where the menu has it begin
        assert 0.002 < np.ptp(finger) < 0.045
        out.mkdir(parents=True)
        (out / "diagnosis.json").write_text(json.dumps({"verdict": {"kind": "effect", "effects": [FRICTION]}}))
        return 0, ""

    outcome = next_motion.follow(case, 0, label, store, Diagnoser(), call=diagnosed)
    assert outcome == {"resolved": True, "verdict": "effect"}
    assert len(names) == case.trials + next_motion.REPEATS
    assert next_motion.follow(case, 0, label, store, Diagnoser()) == outcome  # kept: not played twice


def test_what_no_motion_can_tell_is_left_alone(tmp_path):
    case, store, label = ambiguous(tmp_path, "velocity", "touch_release_25hz.csv")
    other = {**label, "effects": [{"name": "armature", "target": "all"}]}
    assert next_motion.follow(case, 0, other, store, Diagnoser()) is None  # the truth is not in the set
