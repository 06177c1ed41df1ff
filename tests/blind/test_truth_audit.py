"""The library at the true effect and the true numbers meets reality's recordings; no number can be met in one direction
only."""

import functools
import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.dictionary import CONSTANT, KINDS
from benchmarks.truth_audit import __main__ as command
from benchmarks.truth_audit import audit, plan, residuals
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import hypotheses, placing
from tiago_mj.gap.inference.predictor import Predictor

#: A sample of the audit, over stages, rates and robots; docs/truth-audit.md has all. The slow ones take 3 to 20 s.
SLOW = (
    "gripper/none/1",
    "plain/joint_elasticity/0",
    "gripper/pad_creep/1",
    "plain/none/0",
    "plain/rate_limit/0",
    "plain/motor_cogging/0",
    "plain/backlash/0",
    "arm/payload/0",
)
SAMPLE = (
    "plain/command_deadband/0",
    "plain/servo_damping/1",
    *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW),
)
PLANNED = plan.planned()


@functools.cache
def opened(name):
    return audit.opened(PLANNED[name])


@pytest.mark.parametrize("name", SAMPLE)
def test_at_the_truth_little_more_than_noise_is_left(name):
    case = PLANNED[name]
    one = opened(name)
    found = audit.audited(one, audit.FINE[case.setting])
    assert found.rest.pooled.max() <= residuals.POOLED
    if case.effects:
        without = audit.audited(one, audit.COARSE, with_effect=False)
        assert without.rest.pooled.max() > 2 * residuals.POOLED


def test_the_audit_sees_a_number_that_is_left_out():
    one = opened("gripper/none/1")
    without = tuple(tuple(e for e in trial if e.name != "servo_stiffness") for trial in one.numbers)
    found = audit.audited(replace(one, numbers=without), audit.FINE["gripper"])
    assert not found.rest.passes
    assert found.rest.pooled.max() > 2


def test_every_effect_is_audited_with_each_robot_that_can_have_it():
    names = {name.split("/")[1] for name in PLANNED}
    assert names == {"none", *(name for name, kind in KINDS.items() if kind.known)}
    assert len(PLANNED) >= 150
    for name, numbers in CONSTANT.items():
        assert set(numbers) <= {*EFFECTS[name].parameters, *EFFECTS[name].details}


def test_what_the_audit_tells_an_effect_beyond_its_parameters_is_not_sought():
    told = (
        "motor_cogging",
        "rate_limit",
        "servo_damping",
        "force_hysteresis",
        "pad_creep",
        "backlash",
        "joint_elasticity",
    )
    for name in told:
        assert EFFECTS[name].details
        assert not placing.details(name)
    assert [d.name for d in placing.details("payload")] == ["x", "y", "z"]


def test_cases_measured_again_take_the_place_of_the_kept_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "RESULTS", tmp_path)
    one = {"worst": 2.0, "passes": False, "passes_with_onsets": False}
    rows = [{"case": name, "coarse": one, "fine": one} for name in ("plain/none/0", "gripper/none/0")]
    (tmp_path / "kept.json").write_text(json.dumps({"results": {"rows": rows}}))
    again = {"case": "plain/none/0", "fine": {"worst": 1.0, "passes": True, "passes_with_onsets": True}}
    found = command.merged("kept", [again])
    assert [r["case"] for r in found["rows"]] == ["gripper/none/0", "plain/none/0"]
    assert found["passes"] == {"coarse": 0, "fine": 1}
    assert found["rows"][1]["coarse"] == one


def test_what_was_left_is_counted_in_noise_variances_and_on_grids_too():
    rng = np.random.default_rng(0)
    true = np.cumsum(rng.standard_normal((4, 400, 2)), axis=1) * 0.05
    value = true + rng.standard_normal(true.shape) * 0.1
    value[..., 1] = np.round(value[..., 1] / 0.5) * 0.5
    sigma, grid = np.array([0.1, 0.1]), np.array([0.0, 0.5])
    right = residuals.left(value, true, sigma, grid, ("position.a", "position.b"))
    # A mean square of 1600 squares of normal numbers scatters by 3.5 %.
    np.testing.assert_allclose(right.pooled, 1, atol=0.15)
    assert right.passes
    wrong = residuals.left(value, true + 0.1, sigma, grid, ("position.a", "position.b"))
    assert wrong.pooled.min() > 1.2
    assert wrong.beyond_chance


@pytest.fixture(scope="module")
def pressing():
    """A session of the gripper whose squeezes reach the nominal force limit."""
    return audit.opened(PLANNED["gripper/force_limit/0"])


@pytest.mark.slow
def test_every_nominal_number_can_be_met_on_either_side(pressing):
    one = pressing
    predict = Predictor(one.plant, one.on, one.data, threads=1, corrected=False)
    terms = hypotheses.terms(one.plant)
    trials = range(3)
    nominal, *moved = predict.all_trials([(), *((term.entry(d),) for term in terms for d in (-1.0, 1.0))], trials)
    for k, term in enumerate(terms):
        down, up = (np.abs(moved[2 * k + side] - nominal).max() for side in (0, 1))
        assert down >= 0.1 * up, term
        assert up >= 0.1 * down, term


def test_at_the_truth_no_more_of_a_large_effect_is_left_than_its_form_may_differ():
    """Where an effect changes more than 900 noise variances, what chance adds to the worst channel hardly counts."""
    rows = json.loads((command.RESULTS / "truth_audit.json").read_text())["results"]["rows"]
    large = [row for row in rows if len(row["effects"]) == 1 and row["without"] > 900]
    assert len(large) > 50
    for row in large:
        declared = EFFECTS[row["effects"][0]["name"]]
        left = max(row["fine"]["worst"] - 1, 0) / row["without"]
        assert left**0.5 < 1.2 * declared.form_known_to, row["case"]
