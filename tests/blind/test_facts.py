"""Ordinary facts of robots and sessions: drawn apart, stated where a data sheet states them, and no effect."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import cases, facts, oracle, plan, recordings, robots
from benchmarks.blind.cases import Case, EffectChoice
from benchmarks.blind.dictionary import KINDS, UNKNOWN
from benchmarks.blind.facts import Grid


def test_facts_come_in_every_class_of_case() -> None:
    new = plan.plan(420, 1)
    gridded = [c for c in new if c.grids]
    assert 0.1 < len(gridded) / len(new) < 0.35
    assert {c.kind for c in gridded} == set(plan.SHARES)
    assert {c.rate for c in gridded} == set(plan.RATES)
    cells = [g for c in gridded for g in c.grids if g.kind == "force"]
    encoders = [g for c in gridded for g in c.grids if g.kind == "position"]
    assert {g.bits for g in cells} == {8, 10}
    assert {g.bits for g in encoders} == set(range(8, 15))
    assert {g.before for g in cells} == {g.before for g in encoders} == {False, True}
    assert {c.setting for c in new if c.narrow < 1} == {"arm", "plain"}
    assert {c.setting for c in gridded if any(g.kind == "force" for g in c.grids)} == {"gripper"}
    outside = {c.effects[0].name for c in new if c.kind == "outside"}
    assert outside == set(UNKNOWN)


def test_a_grid_that_is_to_be_found_is_not_stated() -> None:
    for case in plan.plan(420, 2):
        rounded = {plan.ROUNDED[e.name] for e in case.effects if e.name in plan.ROUNDED}
        assert not rounded & {grid.kind for grid in case.grids}


@pytest.mark.parametrize("before", [False, True], ids=["noise is rounded", "noise comes after"])
def test_readings_lie_on_the_grid_that_sidecars_state_unless_noise_comes_after(before: bool) -> None:
    grids = Grid("force", 8, span=10.0, before=before), Grid("position", 10, before=before)
    made = cases.simulate(Case(seed=7, trials=1, seconds=2.0, grids=grids))
    stated = recordings.sidecar(made, "trial-00", 0)["quantum"]
    assert stated == {"force": pytest.approx(10 / 256), "position": pytest.approx(0.045 / 1024, rel=1e-5)}
    for values, step in (
        (made.recorded.force, 10 / 256),
        (made.recorded.position, float(grids[1].steps(made.robot)[0])),
    ):
        off = np.abs(values / step - np.round(values / step))
        assert (off.max() > 0.2) if before else (off.max() < 1e-9)
    exact = cases.simulate(Case(seed=7, trials=1, seconds=2.0))
    assert np.sqrt(np.mean((made.recorded.velocity - exact.recorded.velocity) ** 2)) < 0.01, "the robot is the same"


def test_an_arms_encoders_divide_a_turn_and_a_lift_its_travel() -> None:
    robot = cases.real_robot(Case(seed=1, setting="arm"), None)
    steps = Grid("position", 12).steps(robot)
    stated = facts.stated([Grid("position", 12)], robot)
    torso = list(robot.joints).index("torso_lift_joint")
    assert steps[torso] == pytest.approx((robot.high - robot.low)[torso] / 4096)
    assert stated["position.arm_1_joint"] == pytest.approx(2 * np.pi / 4096, rel=1e-5)
    assert stated["position.torso_lift_joint"] == pytest.approx(steps[torso], rel=1e-5)


def test_a_narrow_session_moves_far_in_the_test_trials_alone(tmp_path: Path) -> None:
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    case = Case(seed=11, setting="plain", interface="position", seconds=6.0, narrow=0.2)
    travel = np.ptp(cases.simulate(case, tmp_path).recorded.position[:, :, 0], axis=1)
    far = np.isin(np.arange(case.trials), cases.TEST)
    assert travel[far].min() > travel[~far].max()
    assert travel[far].mean() > 2 * travel[~far].mean()


def test_a_soft_knee_leaves_small_forces_and_shortens_large_ones() -> None:
    soft = KINDS["soft_saturation"].make({"limit": 1.0}, [0])
    x = np.array([[0.1, 2.0], [0.5, 2.0], [1.0, 2.0], [3.0, 2.0]])
    read = soft.forces_read(x, None)  # type: ignore[arg-type]
    np.testing.assert_allclose(read[:, 0], [0.1, 0.5 / 1.0625**0.25, 2**-0.25, 3 / 82**0.25], rtol=1e-4)
    assert (read[:, 1] == 2.0).all(), "the other cell is as it was"


def test_late_stamps_go_on_and_show_in_what_is_replayed(tmp_path: Path) -> None:
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    session = Case(seed=12, setting="plain", interface="position", rate=240.0, seconds=1.6, trials=3)
    late = EffectChoice("late_stamps", "all", {"seconds": 0.1, "period": 0.9})
    made = cases.simulate(replace(session, effects=(late,)), tmp_path)
    exact = cases.simulate(session, tmp_path)
    assert np.array_equal(made.recorded.position, exact.recorded.position), "the robot moves as it did"
    behind = made.recorded.time[0] - exact.recorded.time[0]
    assert behind[0] == 0.0
    assert behind.max() == pytest.approx(0.1, rel=0.01)
    assert (np.diff(made.recorded.time[0]) > 0).all()
    assert oracle.judge(made, tmp_path)["detectable"]
    hardly = EffectChoice("late_stamps", "all", {"seconds": 1e-5, "period": 0.9})
    assert not oracle.judge(cases.simulate(replace(session, effects=(hardly,)), tmp_path), tmp_path)["detectable"]


@pytest.mark.slow
def test_what_a_narrow_session_can_tell_is_judged_by_what_is_fitted(tmp_path: Path) -> None:
    """What shows where only the test trials go is nothing that a fit could have found."""
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    slow = EffectChoice("velocity_limit", "all", {"velocity": 0.7})
    session = Case(seed=13, setting="plain", interface="position", rate=25.0, seconds=3.0, trials=4, effects=(slow,))
    wide = oracle.judge(cases.simulate(session, tmp_path), tmp_path)
    narrow = oracle.judge(cases.simulate(replace(session, narrow=0.15), tmp_path), tmp_path)
    assert wide["detectable"]
    assert narrow["distance"] < wide["distance"]


@pytest.mark.slow
def test_a_coarse_grid_hides_what_it_hides_from_the_oracle_too(tmp_path: Path) -> None:
    noisy = EffectChoice("force_noise", "all", {"factor": 3.0})
    session = Case(seed=14, rate=240.0, seconds=1.0, trials=2, effects=(noisy,))
    clear = oracle.judge(cases.simulate(session), None)
    hidden = oracle.judge(cases.simulate(replace(session, grids=(Grid("force", 8, span=40.0),))), None)
    assert clear["detectable"]
    assert hidden["gap"]["force.left"] < 0.1 * clear["gap"]["force.left"]
    assert not hidden["detectable"]
