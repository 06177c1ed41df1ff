"""Effects of the blind check's reality, by what they do to a robot; not by their parameters."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind import cases, efforts, motions, oracle, reality, robots
from benchmarks.blind.cases import Case, EffectChoice
from benchmarks.blind.dictionary import KINDS, KNOWN, ON_REQUEST, UNKNOWN, available, draw
from tiago_mj.models import names

#: Effects whose parameters vanish at these values; at them reality is as without.
HARMLESS = {
    "command_lag": {"time_constant": 1e-6},
    "force_limit": {"limit": 100.0},
    "torque_constant": {"factor": 1.0},
    "motor_cogging": {"amplitude": 0.0, "period": 0.005},
    "coulomb_friction": {"force": 1e-9},
    "load_dependent_friction": {"coefficient": 0.0},
    "backlash": {"width": 0.0},
    "joint_elasticity": {"stiffness": 3e6},
    "servo_damping": {"damping": 0.0},
    "coupling_error": {"ratio": 0.0},
    "pad_creep": {"fraction": 0.0, "time_constant": 0.3},
    "force_hysteresis": {"width": 0.0},
    "force_delay": {"seconds": 0.0},
    "force_saturation": {"limit": 50.0},
    "rate_limit": {"velocity": 10.0},
    "velocity_limit": {"velocity": 10.0},
    "clock_skew": {"rate": 0.0},
    "dropped_commands": {"probability": 0.0},
    "soft_saturation": {"limit": 50.0},
    "late_stamps": {"seconds": 0.0, "period": 1.0},
}

#: Of these, what is tried by default: of every stage one, and those with states of their own.
TRIED = (
    "backlash",
    "clock_skew",
    "command_lag",
    "coulomb_friction",
    "force_hysteresis",
    "joint_elasticity",
    "late_stamps",
    "pad_creep",
)


def slowly(*values: object) -> object:
    """A parameter set that is tried with the slow tests."""
    return pytest.param(*values, marks=pytest.mark.slow)


def play(commands: np.ndarray, *choices: EffectChoice, seed: int = 1) -> reality.Recorded:
    """Silent replay of commands (T, 2) by the nominal gripper, velocity control."""
    case = Case(seed=seed, effects=choices, spread=0.0, placement=0.0, trials=1)
    robot = cases.real_robot(case, None)
    setup = reality.Setup("velocity", cases.RATE, len(commands), np.zeros(1), np.full((1, 2), 0.045), 0, silent=True)
    return reality.simulate(robot, cases.effects_of(case), setup, commands[None])


def both(*segments: tuple[float, float]) -> np.ndarray:
    """Commands of (seconds, speed) for both fingers alike."""
    return np.concatenate([np.full((round(s * cases.RATE), 2), v) for s, v in segments])


#: Close, press 3 mm deep, hold, let go.
SQUEEZE = both((0.4, 0.0), (1.12, -0.025), (1.2, 0.0), (0.2, 0.01), (0.6, 0.0))
#: The same in half the time, of which the fingers rest for half.
BRIEF = both((0.32, 0.0), (0.72, -0.039), (0.72, 0.0), (0.16, 0.01))
#: To and fro in the air.
AIR = both((0.4, 0.0), (0.6, -0.02), (0.4, 0.0), (0.3, 0.02), (0.4, 0.0))


@cache
def squeezed(*, brief: bool = False) -> reality.Recorded:
    """The nominal squeeze."""
    return play(BRIEF if brief else SQUEEZE)


@pytest.mark.parametrize("name", [*TRIED, *(slowly(name) for name in sorted(HARMLESS) if name not in TRIED)])
def test_an_effect_of_nothing_does_nothing(name: str) -> None:
    plain, changed = squeezed(brief=True), play(BRIEF, EffectChoice(name, "all", HARMLESS[name]))
    assert plain.force.max() > 0.3, "it presses"
    # What the stiff effects' own states round off shows where contact begins; else it is a tenth of the noise.
    assert np.median(np.abs(changed.position - plain.position)) < 3e-6
    assert np.median(np.abs(changed.force - plain.force)) < 3e-3
    assert np.abs(changed.position - plain.position).max() < 5e-5


def test_dry_friction_holds_a_finger_off_its_set_point_for_good() -> None:
    commands = both((0.4, 0.0), (0.6, -0.02), (3.0, 0.0))
    q = play(commands, EffectChoice("coulomb_friction", "all", {"force": 2.0})).position[0]
    # It stops where the servo's force (2000 N/m) equals the friction: 1 mm short, and does not creep on.
    short = q[-1] - (0.045 - 0.012)
    assert short == pytest.approx(0.001, rel=0.15)
    assert np.abs(q[-1] - q[40]).max() < 2e-5


def test_a_delay_shifts_the_motion_by_its_seconds_whatever_the_control_period() -> None:
    seconds = 0.053
    plain, late = play(AIR), play(AIR, EffectChoice("command_delay", "all", {"seconds": seconds}))
    t = plain.time[0]
    shifted = np.interp(t - seconds, t, plain.position[0, :, 0])
    assert np.abs(late.position[0, :, 0] - shifted).max() < 1e-4  # a linear interpolation of 40 ms rows
    assert np.abs(late.position[0, :, 0] - plain.position[0, :, 0]).max() > 9e-4


def test_play_costs_its_width_at_a_reversal() -> None:
    width = 0.001
    plain, loose = play(AIR), play(AIR, EffectChoice("backlash", "all", {"width": width}))
    lag = loose.position[0] - plain.position[0]
    going, back = lag[24], lag[40]  # near the end of the way there, and of the way back
    assert going == pytest.approx(width / 2, rel=0.2)
    assert back == pytest.approx(-width / 2, rel=0.2)


@pytest.mark.slow
def test_a_spring_in_series_softens_the_grasp() -> None:
    plain, soft = squeezed(), play(SQUEEZE, EffectChoice("joint_elasticity", "all", {"stiffness": 2000.0}))
    held = 60
    # The object (10 kN/m), the servo (2 kN/m) and the spring (2 kN/m) in series: (1/10 + 1/2) / (1/10 + 1/2 + 1/2).
    assert soft.force[0, held, 0] / plain.force[0, held, 0] == pytest.approx(0.6 / 1.1, rel=0.05)


@pytest.mark.parametrize("joint", ["arm_2_joint", slowly("arm_3_joint"), slowly("arm_4_joint")])
def test_a_spring_in_an_arm_joint_gives_by_what_it_carries(joint: str) -> None:
    column, stiffness, speed = names.TIAGO_JOINTS.index(joint), 2000.0, 0.2
    commands = np.zeros((70, len(names.TIAGO_JOINTS)))
    commands[10:35, column] = speed
    seen = []
    for effects in ((), (EffectChoice("joint_elasticity", (joint,), {"stiffness": stiffness}),)):
        case = Case(seed=1, setting="arm", effects=effects, spread=0.0, trials=1)
        robot = cases.real_robot(case, None)
        setup = replace(cases.setup_of(case, robot, 1, len(commands), 0), silent=True)
        carried = float((robot.model.dof_frictionloss + robot.model.dof_damping * speed)[robot.dof[column]])
        seen.append(reality.simulate(robot, cases.effects_of(case), setup, commands[None]).position[0, :, column])
    short = seen[0] - seen[1]
    # Moving steadily it winds up by friction and drag over its stiffness; at rest by the friction at most.
    assert short[20] == pytest.approx(carried / stiffness, rel=0.1)
    assert np.abs(short[50:]).max() < 1.0 / stiffness


def test_contact_stiffness_sets_the_depth_of_the_grasp() -> None:
    plain = squeezed()
    soft = play(SQUEEZE, EffectChoice("contact_stiffness", "all", {"factor": 0.2}))
    held = 60
    # Servo 2 kN/m and contact in series, the same travel: forces as (1/2 + 1/10) to (1/2 + 1/2).
    assert soft.force[0, held, 0] / plain.force[0, held, 0] == pytest.approx(0.6, rel=0.05)
    assert soft.position[0, held, 0] < plain.position[0, held, 0] - 5e-4


def test_cells_lag_by_their_time_constant() -> None:
    plain, slow = squeezed(), play(SQUEEZE, EffectChoice("force_lag", "all", {"time_constant": 0.08}))
    x, y = plain.force[0, :, 0], slow.force[0, :, 0]
    # What a lag of unit gain has withheld when the force is steady is its time constant times the force.
    assert np.sum((x - y)[:61]) / cases.RATE == pytest.approx(0.08 * x[60], rel=0.05)
    assert np.abs(x - y).max() > 0.2
    assert y[60] == pytest.approx(x[60], rel=0.01)


def test_loading_and_unloading_differ_by_the_hysteresis() -> None:
    case = EffectChoice("force_hysteresis", "all", {"width": 0.2})
    plain, play_ = squeezed(), play(SQUEEZE, case)
    lost = (plain.force - play_.force)[0, :, 0]
    assert lost[60] == pytest.approx(0.1, rel=0.1)  # pressed: half the width behind
    assert lost[-1] == pytest.approx(-0.1, rel=0.15)  # let go a little: half the width above


@pytest.mark.slow
def test_a_cold_motor_fades() -> None:
    commands = both((0.4, 0.0), (1.3, -0.025), (4.8, 0.0))
    choice = EffectChoice("thermal_fade", "all", {"heating": 4.0, "time_constant": 1.2})
    force = play(commands, choice).force[0, :, 0]
    assert force[55] > 1.0
    assert force[-1] < 0.9 * force[55]
    assert force[-1] == pytest.approx(force[-10], rel=0.02)


@pytest.mark.slow  # the audit of the simulator at the truth makes them one by one
def test_every_effect_makes_finite_recordings_and_most_show() -> None:
    shown = 0
    brief = both((0.1, 0.0), (0.9, -0.03), (0.3, 0.0), (0.1, 0.02), (0.2, 0.0))
    plain = play(brief)
    for name in (*KNOWN, *UNKNOWN):
        if "gripper" not in KINDS[name].ranges:
            continue
        rng = np.random.default_rng(2)
        choice = EffectChoice(name, "all", draw(name, "gripper", rng))
        changed = play(brief, choice)
        for values in (changed.position, changed.velocity, changed.force, changed.time):
            assert np.isfinite(values).all(), name
        difference = np.abs(changed.position - plain.position).max() + np.abs(changed.force - plain.force).max()
        shown += difference > 1e-4 or not np.array_equal(changed.time, plain.time)
    # Noise alone is silent here, friction with the pads bears nothing on a table, little else hides.
    assert shown >= 0.85 * len(available("gripper")) + len(available("gripper", known=False)) - 2


@pytest.mark.parametrize(("rate", "seconds"), [slowly(25.0, 6.0), (240.0, 1.5)])
def test_sessions_press_reverse_and_rest(rate: float, seconds: float) -> None:
    made = cases.simulate(Case(seed=9, spread=0.0, rate=rate, seconds=seconds, trials=8))
    force, velocity = made.recorded.force, made.recorded.velocity
    assert (force.max(axis=1) > 0.3).all(), "both pads touch in every trial"
    assert force[:, 0].max() < 5 * robots.FORCE_NOISE, "none begins in touch"
    assert 1.5 < force.max() < 2.9, "in what the sensor is made for"
    assert np.mean(np.abs(velocity) < 2e-3) > 0.2, "there is rest to see the noise in"
    moving = np.where(np.abs(velocity[:, :, 0]) > 3e-3, np.sign(velocity[:, :, 0]), 0)
    assert sum(int(np.sum(np.diff(row[row != 0]) != 0)) for row in moving) > 20, "there are reversals"
    assert len({program.__name__ for program in motions.SESSION}) >= 4


@pytest.mark.parametrize("rate", [slowly(25.0), 240.0])
def test_reality_without_an_effect_is_ordinary_and_a_clear_effect_is_not(rate: float) -> None:
    seconds = 6.0 if rate == 25 else 1.5
    clear = EffectChoice("torque_constant", "all", {"factor": 0.5})
    made = cases.simulate(Case(seed=4, rate=rate, seconds=seconds, trials=4, effects=(clear,)))
    said = oracle.judge(made)
    assert said["distance_without"] < 2 * said["ordinary"]  # it is one more draw: nine in ten are below once
    assert said["detectable"]
    assert said["distance"] > 2 * said["ordinary"]


@pytest.mark.parametrize(("name", "values"), [("coupled_motor_friction", 1.5), ("coupled_motor_damping", 2.0)])
def test_a_motor_of_two_joints_is_felt_at_both(name, values):
    """On the arm of six joints: the drives of both give as much more as the motor takes; those of the others hardly."""
    effect = ON_REQUEST[name].make({next(iter(ON_REQUEST[name].ranges["six"])): values}, [5])
    robot = SimpleNamespace(inertia=np.full(6, 0.05))
    world = SimpleNamespace(q=np.zeros((1, 6)), v=np.array([[0, 0, 0, 0, 0.4, -0.1]]), h=5e-4, robot=robot)
    effect.start(world)
    for _ in range(400):
        force = effect.load(world)[0]
    assert force[:4].tolist() == [0, 0, 0, 0]
    assert force[4] == force[5] == pytest.approx(-values * (1.0 if "friction" in name else 0.3), rel=1e-3)


def test_a_spring_pulls_to_where_it_is_slack():
    robot = SimpleNamespace(low=np.array([-1.0, 0.0]), high=np.array([1.0, 3.0]))
    world = SimpleNamespace(q=np.array([[0.3, 0.5]]), robot=robot)
    force = ON_REQUEST["joint_spring"].make({"stiffness": 4.0, "slack": 0.75}, [0]).load(world)
    np.testing.assert_allclose(force, [[4.0 * (0.5 - 0.3), 0.0]])


def test_what_no_drawn_case_has_is_asked_for_by_name():
    coupled = ("coupled_motor_friction", "coupled_motor_damping")
    asked = efforts.cases(6, 3, ("one", "two"), coupled)
    assert {case.setting for case in asked} == {"six"}
    assert all(case.effects[0].name in coupled and case.effects[0].target != ("turn",) for case in asked)
    drawn = efforts.cases(40, 65)
    assert not {effect.name for case in drawn for effect in case.effects} & set(ON_REQUEST)
    with pytest.raises(ValueError, match="no robot of the check"):
        efforts.cases(3, 3, ("one",), ("coupled_motor_friction", "force_gain"))
