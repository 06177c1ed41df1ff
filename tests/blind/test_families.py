"""Families that the diagnosis once got wrong, in the independent reality, with other magnitudes and seeds."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import FAST_RATE, Case, EffectChoice
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

PLAIN = Case(seed=4242, setting="plain", interface="position", spread=0.04, rate=FAST_RATE, seconds=1.6, trials=4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters"),
    [("velocity_filter", {"time_constant": 0.05})],
)
def test_a_lag_of_two_poles_is_one_effect_and_its_time_constant_is_found(
    tmp_path: Path, name: str, parameters: dict[str, float]
) -> None:
    case = replace(PLAIN, effects=(EffectChoice(name, "all", parameters),))
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, tmp_path), tmp_path)
    trials, model = read_recordings([tmp_path]).trials, tmp_path / robots.PLAIN_FILE
    names = (name, "command_lag", "command_delay", "clock_offset", "servo_damping", "viscous_friction", "encoder_scale")
    found = diagnose(trials, model=model, names=names, threads=2)
    (effect,) = found.best.effects
    assert (found.kind, effect.name) == ("effect", name)
    # Of a servo's own lag, some 40 ms, nobody knows more than a few per cent.
    assert effect.parameters["time_constant"].value == pytest.approx(parameters["time_constant"], rel=0.06)


@pytest.mark.slow
def test_of_a_pair_the_form_of_one_effect_is_found_although_another_effect_comes_nearer_in_the_wrong_form(
    tmp_path: Path,
) -> None:
    lagging = EffectChoice("command_lag", "all", {"time_constant": 0.16})
    slow = EffectChoice("velocity_limit", "all", {"velocity": 0.7})
    case = replace(PLAIN, seed=4244, effects=(lagging, slow), trials=3)
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, tmp_path), tmp_path)
    trials, model = read_recordings([tmp_path]).trials, tmp_path / robots.PLAIN_FILE
    names = ("command_lag", "command_delay", "velocity_limit", "viscous_friction", "coulomb_friction", "clock_offset")
    found = diagnose(trials, model=model, names=names, threads=2)
    assert {effect.name for effect in found.best.effects} == {"command_lag", "velocity_limit"}
    assert found.kind == "effect"


@pytest.mark.slow
def test_a_ripple_is_found_of_a_joint_that_never_rests_and_moves_by_periods_from_row_to_row(tmp_path: Path) -> None:
    ripple = EffectChoice("motor_cogging", "all", {"amplitude": 0.06, "period": 0.17})
    case = replace(PLAIN, seed=4246, effects=(ripple,), rate=25.0, seconds=6.0)
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, tmp_path), tmp_path)
    trials, model = read_recordings([tmp_path]).trials, tmp_path / robots.PLAIN_FILE
    names = ("motor_cogging", "coulomb_friction", "stribeck_friction", "servo_stiffness", "command_quantization")
    found = diagnose(trials, model=model, names=names, threads=2)
    (effect,) = found.best.effects
    assert (found.kind, effect.name) == ("effect", "motor_cogging")
    # 2 rad of travel hold 12 periods: a twelfth of a turn in all is a hundredth of the period.
    assert effect.parameters["period"].value == pytest.approx(0.17, rel=0.01)
    assert effect.parameters["amplitude"].value == pytest.approx(0.06, rel=0.15)


@pytest.mark.slow
def test_a_pair_is_found_of_which_neither_effect_alone_explains_much(tmp_path: Path) -> None:
    """One on each load cell: with either of them the other cell's error stays."""
    drifts = EffectChoice("force_drift", ("left",), {"rate": 0.03})
    sticks = EffectChoice("force_hysteresis", ("right",), {"width": 0.14})
    case = Case(seed=4248, effects=(drifts, sticks), spread=0.04, rate=FAST_RATE, seconds=1.8, trials=6)
    recordings.write(cases.simulate(case), tmp_path)
    names = ("force_drift", "force_hysteresis", "force_bias", "force_delay")
    found = diagnose(read_recordings([tmp_path]).trials, names=names, threads=2)
    assert found.kind == "effect"
    assert {(e.name, e.target) for e in found.best.effects} == {("force_drift", "left"), ("force_hysteresis", "right")}


@pytest.mark.parametrize("step", [pytest.param(0.00095, marks=pytest.mark.slow), 0.0004])
def test_the_grid_of_fast_set_points_is_found_to_a_tenth_of_a_line(tmp_path: Path, step: float) -> None:
    """A grid a per cent off fits no better than none: fifty lines away it is half a step off."""
    choice = EffectChoice("command_quantization", "all", {"step": step})
    case = Case(seed=4243, effects=(choice,), spread=0.04, rate=FAST_RATE, seconds=2.3, trials=3)
    recordings.write(cases.simulate(case), tmp_path)
    trials = read_recordings([tmp_path]).trials
    plant = plant_of(trials)
    predict, nominal = predictor(plant, trials, threads=1)
    seen = set_points.servo_motion(plant, predict.on, predict.data, nominal)
    assert seen is not None
    pool = hypotheses.candidates(plant, ("command_quantization",))
    both = [c for c in set_points.magnitudes(plant, predict.on, seen, pool, range(3)) if c.target is None]
    lines = 0.045 / step  # from closed to open
    assert min(abs(value / step - 1) for c in both for value in c.grid) < 0.1 / lines
