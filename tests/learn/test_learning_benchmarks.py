"""What the learning benchmarks compute from their trainings."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

pytest.importorskip("yaml")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module", autouse=True)
def _on_the_path():
    sys.path.insert(0, str(BENCHMARKS))
    yield
    sys.path.remove(str(BENCHMARKS))


def returns(*values):
    return [{"reward": {"mean": value}} for value in values]


def test_what_a_calibration_recovers_is_the_share_of_the_way_from_the_nominal_policy_to_the_true_one():
    gap = importlib.import_module("across_a_gap")
    rows = {"A": returns(-500, -300), "B": returns(-230, -210), "C": returns(-420, -420), "D": returns(-190, -210)}
    assert gap.recovered(rows, "B") == pytest.approx(0.9)
    assert gap.recovered(rows, "C") == pytest.approx(-0.1)
    assert gap.recovered({**rows, "D": returns(-190, -310)}, "B") is None


def test_what_is_withheld_and_what_is_drawn_are_effects():
    from tiago_mj.effects import read_effects
    from tiago_mj.learn.randomise import read_ranges

    gap = importlib.import_module("across_a_gap")
    assert len(gap.WITHHELD) >= 3
    for name, effect in gap.WITHHELD.items():
        assert [entry.name for entry in read_effects(effect)] == [name]
    read_ranges(gap.RANGES, "RANGES")


def test_ranges_by_hand_are_effects_and_the_wide_ones_hold_every_withheld_effect():
    from tiago_mj.effects import read_effects
    from tiago_mj.learn.randomise import read_ranges

    gap = importlib.import_module("across_a_gap_posterior")
    for ranges in gap.RANGES.values():
        read_ranges(ranges, "RANGES")
    for name, effect in gap.WITHHELD.items():
        assert [entry.name for entry in read_effects(effect)] == [name]
        for key, value in effect[name].items():
            low, high = gap.WIDE[name][key]
            assert low <= value <= high
            if name in gap.HAND:
                low, high = gap.HAND[name][key]
                assert not low <= value <= high  # as of who does not know of it


def test_seeds_are_paired_as_far_as_both_arms_have_them():
    gap = importlib.import_module("across_a_gap_posterior")
    one = gap.paired([-200.0, -210.0], [-300.0, -300.0, -500.0])
    assert (one["seeds"], one["mean"]) == (2, pytest.approx(95.0))
    assert one["low"] < 95 < one["high"]
    assert gap.paired([-200.0], [-300.0, -320.0]) == {"seeds": 1, "mean": 100.0, "low": None, "high": None}


def test_means_of_all_seeds_differ_by_welch_s_interval():
    from scipy import stats

    gap = importlib.import_module("across_a_gap_posterior")
    ours, theirs = [-403.0, -393.0, -398.0], [-437.0, -476.0, -474.0, -499.0, -512.0]
    found = gap.unpaired(ours, theirs)
    wanted = stats.ttest_ind(ours, theirs, equal_var=False).confidence_interval(0.95)
    assert (found["low"], found["high"]) == pytest.approx((wanted.low, wanted.high))
    assert found["seeds"] == [3, 5]
    assert gap.unpaired([1.0], theirs)["low"] is None
    assert gap.unpaired([1.0, 1.0], [0.5, 0.5])["high"] == 0.5


def test_an_arm_that_does_not_depend_on_the_withheld_effect_is_trained_once(tmp_path):
    gap = importlib.import_module("across_a_gap_posterior")
    folders = [{arm: gap.folder_of(tmp_path, arm, name) for arm in gap.ARMS} for name in ("one", "other")]
    assert {arm for arm in gap.ARMS if folders[0][arm] == folders[1][arm]} == set(gap.SHARED)


def test_a_variant_is_there_when_its_evaluations_stay_near_the_best_of_all():
    claims = importlib.import_module("claims")
    steps = [10, 20, 30, 40]
    rows = {
        "early": [{"evaluations": {"steps": steps, "return": [-400, -105, -100, -109]}}],
        "late": [{"evaluations": {"steps": steps, "return": [-105, -300, -120, -108]}}],
        "never": [{"evaluations": {"steps": steps, "return": [-200, -120, -120, -111]}}],
    }
    claims.add_arrival(rows)
    assert [rows[name][0]["there_from"] for name in rows] == [20, 40, None]


def test_settings_that_are_not_trained_on_lie_outside_of_what_the_steady_task_draws():
    from tiago_mj.envs.hold_steady import HoldForceSteady

    drawn = {
        "goal": HoldForceSteady.GOALS,
        "object_width": HoldForceSteady.WIDTHS,
        "object_offset": HoldForceSteady.OFFSETS,
        "object_stiffness": HoldForceSteady.STIFFNESSES,
        "object_mass": HoldForceSteady.MASSES,
    }
    steady = importlib.import_module("steady")
    for name, options in steady.SETTINGS.items():
        assert name == "as trained" or options
        for key, (low, high) in options.items():
            assert high <= drawn[key][0] or low >= drawn[key][1], name


def test_a_task_is_played_as_it_is_registered_beside_the_controllers_that_know_it():
    from tiago_mj.rollout.options import make_env

    every = importlib.import_module("every_robot")
    found = {}
    for name in ("TIAGoTactile-v0", "TIAGoPush-v0", "GripperCloseGoal-v0"):
        env = make_env(f"tiago_mj/{name}", {})
        found[name] = every.controllers_of(env)
        if name == "TIAGoTactile-v0":
            alone = every.gripper(env, {"object_offset": 0.0})
            assert alone.spec.id == "tiago_mj/GripperTactile-v0"
            assert len(every.bounds_of(alone, [7])) == 1, "the whole robot has no bound of its own"
            alone.close()
        env.close()
    assert found == {
        "TIAGoTactile-v0": ("pi", "pi-tuned"), "TIAGoPush-v0": ("scripted",), "GripperCloseGoal-v0": ()
    }  # fmt: skip
