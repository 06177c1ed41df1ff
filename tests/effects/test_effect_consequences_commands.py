"""What clocks, commands and servos with an effect do, measured from outside in a rollout.

The fingers' servos pull with 2000 N/m and at most 16 N against 80 N·s/m: they trail a moving set point with a time
constant of 40 ms, of which nothing is left (e^-12) half a second after a change.
"""

import numpy as np
import pytest
from effects_bench import (
    DAMPING,
    FORCE_LIMIT,
    FREE,
    KP,
    PERIOD,
    SPEED_LIMIT,
    UNITS_PER_NEWTON,
    crossing,
    entry,
    free,
    grasp,
    make,
    rollout,
    same_motion,
    shows,
)

OPEN = 0.045  # where the fingers start [m]
SLOW = -0.04  # closing [m/s]
#: After the start's transients, before the end of the way.
MIDWAY = 0.025


def arrival(r, finger=0, measured=False):
    """When a finger is half closed [s]."""
    return crossing(r.time, (r.position if measured else r.true_position)[:, finger], MIDWAY)


# Clocks --------------------------------------------------------------------------------------------------------------


@shows("clock_offset")
@pytest.mark.parametrize("seconds", [0.03, 0.0104])
def test_a_clock_offset_delays_what_is_measured_and_nothing_that_happens(seconds):
    closing = ((SLOW, 0.8), (0.0, 0.2))
    nominal, late = grasp(None, *closing), grasp({"clock_offset": {"seconds": seconds}}, *closing)
    assert same_motion(nominal, late)
    # At a constant speed interpolation between rows is exact.
    assert arrival(late, measured=True) - arrival(nominal, measured=True) == pytest.approx(seconds, abs=1e-6)
    # A velocity rises, a force falls: bent curves, interpolated to a tenth of a row.
    rise = [crossing(r.time, -r.velocity[:, 0], 0.02) for r in (nominal, late)]
    touch = [crossing(r.time, r.reading[:, 0], 0.5) for r in (nominal, late)]
    assert np.diff(rise) == pytest.approx(seconds, abs=PERIOD / 10)
    assert np.diff(touch) == pytest.approx(seconds, abs=PERIOD / 10)


@shows("clock_skew")
@pytest.mark.parametrize("rate", [0.005, -0.02])
def test_by_a_clock_that_runs_fast_everything_is_slower(rate):
    steady = slice(120, 200)
    moved = [np.polyfit(r.time[steady], r.position[steady, 0], 1)[0] for r in (
        free(None, (SLOW, 1.0)), free({"clock_skew": {"rate": rate}}, (SLOW, 1.0)))]  # fmt: skip
    # After half a second e^-12 of the start's transient is left.
    assert moved[1] / moved[0] == pytest.approx(1 / (1 + rate), rel=1e-5)


# Commands ------------------------------------------------------------------------------------------------------------


@shows("command_delay")
@pytest.mark.parametrize("seconds", [0.03, 0.0104, 0.001])
def test_a_delayed_command_takes_hold_that_much_later_in_fractions_of_a_step_too(seconds):
    nominal, late = free(None, (SLOW, 0.8)), free({"command_delay": {"seconds": seconds}}, (SLOW, 0.8))
    # What a fraction of a step leaves of the start's transient, e^-10 of a step.
    assert arrival(late) - arrival(nominal) == pytest.approx(seconds, abs=1e-6)
    waits = int(seconds / PERIOD)
    assert (late.true_position[: waits + 1] == OPEN).all()
    assert (late.true_position[waits + 1] < OPEN).all()


@shows("command_delay", "clock_offset")
def test_a_delay_of_whole_steps_is_the_same_motion_moved():
    parts = (0.0, 0.1), (SLOW, 0.3), (-SLOW, 0.2), (2 * SLOW, 0.2)
    nominal, late = free(None, *parts), free({"command_delay": {"seconds": 6 * PERIOD}}, *parts)
    # Rounding of the interpolation's weights.
    np.testing.assert_allclose(late.true_position[6:], nominal.true_position[:-6], atol=1e-12)
    of_clock = free({"clock_offset": {"seconds": 6 * PERIOD}}, *parts)
    np.testing.assert_allclose(of_clock.position, late.position, atol=1e-12)  # hence one class


@shows("dropped_commands")
def test_dropped_commands_leave_the_one_before_in_force_as_often_as_said():
    hz, steps, share = 25.0, 600, 0.3
    rng = np.random.default_rng(0)
    levels = np.array([0.004, 0.002, -0.002, -0.004])  # in random order, so that the fingers stay within their range
    sent = np.concatenate([rng.permutation(levels) for _ in range(steps // 4)])
    action = np.repeat(sent[:, None], 2, axis=1) / SPEED_LIMIT

    def half_closed(core):
        core.data.qpos[:] = core.data.act[:] = MIDWAY

    effect = {"dropped_commands": {"probability": share}}
    r = rollout(effect, action, FREE, prepare=half_closed, control_hz=hz, servo="ideal")
    # An ideal servo is there within 2 ms of a step of 40: 5 % of a step is still the one before.
    done = np.diff(r.true_position, axis=0) * hz
    could = np.append(levels, 0.0)  # what was in force before the first
    executed = could[np.argmin(np.abs(done[..., None] - could), axis=2)]
    np.testing.assert_allclose(done, executed, atol=5e-4)
    before = np.vstack([np.zeros((1, 2)), executed[:-1]])
    changes = sent[:, None] != before
    held = (executed == before) & changes
    assert (held | (executed == sent[:, None])).all()
    # 1200 chances, of which three in four can be seen: the standard error of the share is 0.015; four of them.
    assert held.sum() / changes.sum() == pytest.approx(share, abs=0.06)
    assert (held[:, 0] != held[:, 1]).any()  # each actuator loses its own


@shows("command_lag")
@pytest.mark.parametrize("time_constant", [0.04, 0.01])
def test_a_lagging_command_rounds_the_start_and_trails_by_its_time_constant(time_constant):
    effect = {"command_lag": {"time_constant": time_constant}}
    nominal, lagging = free(None, (SLOW, 0.8)), free(effect, (SLOW, 0.8))
    # e^-10 of the transient is left at half a second.
    assert arrival(lagging) - arrival(nominal) == pytest.approx(time_constant, abs=1e-5)
    assert (lagging.true_position[1] < OPEN).all()  # it starts at once: no delay
    ideal = free(effect, (SLOW, 0.5), servo="ideal", control_hz=1000)
    rise = crossing(ideal.time, -ideal.true_velocity[:, 0], -SLOW * (1 - np.exp(-1)))
    nominal = free(None, (SLOW, 0.5), servo="ideal", control_hz=1000)
    own = crossing(nominal.time, -nominal.true_velocity[:, 0], -SLOW * (1 - np.exp(-1)))
    # Two lags in a row reach 63 % after nearly their sum: within half of the shorter one, the servo's own.
    assert rise - own == pytest.approx(time_constant, abs=own / 2)


@shows("rate_limit")
def test_a_rate_limit_bounds_the_speed_leaves_slower_motion_alone_and_catches_up():
    limit = {"rate_limit": {"velocity": 0.03}}
    parts = (-0.08, 0.3), (0.0, 1.5)
    nominal, limited = free(None, *parts), free(limit, *parts)
    assert -nominal.true_velocity.min() == pytest.approx(0.08, rel=1e-3)  # e^-7 is missing
    assert -limited.true_velocity.min() == pytest.approx(0.03, rel=1e-4)
    np.testing.assert_allclose(limited.true_position[-1], nominal.true_position[-1], atol=1e-6)  # caught up
    slow = (-0.02, 0.5), (0.02, 0.3)
    np.testing.assert_allclose(free(limit, *slow).true_position, free(None, *slow).true_position, atol=1e-12)


@shows("command_deadband")
def test_a_change_below_the_dead_band_is_not_executed():
    effect = {"command_deadband": {"width": 3e-4}}

    def moved(way):
        return OPEN - free(effect, (-0.002, way / 0.002), (0.0, 0.6)).true_position

    assert (moved(2.5e-4) == 0).all()
    # It moves when the command is 0.3 mm on, and not for the 0.05 mm that follow; each may come a command of 8 µm late.
    np.testing.assert_allclose(moved(3.5e-4)[-1], 3e-4, atol=9e-6)
    np.testing.assert_allclose(moved(7.0e-4)[-1], 6e-4, atol=18e-6)


@shows("command_deadband")
@pytest.mark.parametrize("period", [0.001, 0.01, 0.032])
def test_a_driver_that_looks_at_its_set_point_executes_a_change_when_it_does(period):
    # 0.3 mm are reached after 15 ms; a physics step is 2 ms. The driver's next look is executed within a step of it.
    r = free({"command_deadband": {"width": 3e-4, "period": period}}, (-0.02, 0.5), (0.0, 0.1), control_hz=240)
    moved = crossing(r.time, OPEN - r.set_point[:, 0], 1e-4)
    look = np.ceil(0.015 / period - 1e-9) * period
    assert look - 1e-9 <= moved + PERIOD
    assert moved <= look + PERIOD + 0.0021


@shows("command_deadband")
def test_a_dead_band_that_looks_in_every_physics_step_executes_a_change_at_once():
    fast, looking = (-0.02, 0.5), {"width": 3e-4, "period": 0.001}
    r = free({"command_deadband": looking}, fast, (0.0, 0.6), control_hz=25)
    # The set point is 0.3 mm on after 15 ms of a command of 40; looked at by command it waits for the second one.
    assert crossing(r.time, OPEN - r.set_point[:, 0], 1e-4) < 0.04
    late = free({"command_deadband": {"width": 3e-4}}, (-0.005, 0.5), (0.0, 0.6), control_hz=25)
    assert crossing(late.time, OPEN - late.set_point[:, 0], 1e-4) > 0.04


@shows("command_lag")
@pytest.mark.parametrize("poles", [1, 2])
def test_a_lagging_position_command_is_approached_no_faster_than_the_joint_may(poles):
    def reached(way, seconds):
        """Share of the way that the set points have closed."""
        core = make({"command_lag": {"time_constant": 0.1, "poles": poles}}, FREE, control="position")
        core.reset(seed=0)
        for _ in range(round(seconds / PERIOD)):
            core.step(np.full(2, 1 - 2 * way / OPEN))  # from closed, -1, to open, 1
        return (OPEN - core.data.act) / way

    # Half of the time constant on: 1 - e^-½ of the way, with two poles 1 - 2 e^-1; half a physics step short of it.
    share = 1 - np.exp(-0.5) if poles == 1 else 1 - 2 * np.exp(-1)
    np.testing.assert_allclose(reached(0.002, 0.05), share, atol=0.01)
    np.testing.assert_allclose(reached(0.002, 1.2), 1.0, rtol=1e-3)
    if poles == 1:  # 200 mm/s are asked for
        np.testing.assert_allclose(reached(0.02, 0.05), SPEED_LIMIT * 0.05 / 0.02, rtol=1e-6)


@shows("command_quantization")
@pytest.mark.parametrize("way", [0.0102, 0.01034, 0.0033])
def test_a_quantized_command_rests_on_the_grid(way):
    r = free({"command_quantization": {"step": 5e-4}}, (-0.02, way / 0.02), (0.0, 0.8))
    sent = OPEN - round(way / 0.02 * 240) / 240 * 0.02
    # e^-20 of the way is left.
    np.testing.assert_allclose(r.true_position[-1], 5e-4 * np.round(sent / 5e-4), atol=1e-8)
    assert abs(r.true_position[-1, 0] - sent) > 1e-4


# The servo and its motor ---------------------------------------------------------------------------------------------


def squeeze(effects, beyond=0.002, **arguments):
    """Close onto the object and hold the set point so far inside of it [m]."""
    pads = 0.02  # opening at which they touch
    return grasp(effects, (SLOW, (OPEN - pads + beyond) / -SLOW), (0.0, 1.0), **arguments)


def stiffness_felt(r):
    """Force on the pads over the distance between set point and finger at the end, (2,) [N/m]."""
    return r.force[-1] / (r.true_position - r.set_point)[-1]


@shows("servo_stiffness", "torque_constant", "joint_elasticity", "force_gain", "force_limit")
@pytest.mark.parametrize(
    ("effects", "stiffness", "largest", "gain"),
    [
        (None, KP, FORCE_LIMIT, 1.0),
        ({"servo_stiffness": {"factor": 0.6}}, 0.6 * KP, FORCE_LIMIT, 1.0),
        ({"torque_constant": {"factor": 0.8}}, 0.8 * KP, 0.8 * FORCE_LIMIT, 1.0),
        ({"joint_elasticity": {"stiffness": 3000.0}}, 1 / (1 / KP + 1 / 3000), FORCE_LIMIT, 1.0),
        ({"force_limit": {"limit": 6.0}}, KP, 6.0, 1.0),
        ({"force_gain": {"factor": 1.3}}, KP, FORCE_LIMIT, 1.3),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_a_squeeze_tells_the_effects_on_gains_apart(effects, stiffness, largest, gain):
    soft, hard = squeeze(effects), squeeze(effects, beyond=0.018)
    # 5 mN: the object's friction on the table takes a part of what one finger pushes.
    np.testing.assert_allclose(stiffness_felt(soft), stiffness, rtol=2e-3)
    np.testing.assert_allclose(hard.force[-1], largest, rtol=2e-3)
    np.testing.assert_allclose(soft.reading[-1], gain * UNITS_PER_NEWTON * soft.force[-1], rtol=1e-9)


@shows("force_limit", "torque_constant")
@pytest.mark.parametrize("effects", [{"force_limit": {"limit": 18.0}}, {"torque_constant": {"factor": 1.125}}])
def test_a_looser_limit_is_one_although_the_joint_has_the_nominal_one_as_well(effects):
    hard = squeeze(effects, beyond=0.018)
    np.testing.assert_allclose(hard.force[-1], 18.0, rtol=2e-3)


@shows("force_limit")
def test_below_its_limit_a_servo_is_as_it_was():
    assert same_motion(squeeze({"force_limit": {"limit": 6.0}}), squeeze(None))


def set_points_at(position):
    """The set points jump there, farther than the force limit reaches."""

    def prepare(core):
        core.data.act[:] = position

    return prepare


@shows("servo_damping", "viscous_friction")
def test_damping_of_servo_and_joint_trail_alike_until_the_servo_saturates():
    extra, speed = 40.0, 0.04
    fastest = {}
    for name, slowed in (
        (None, 0.0),
        ("servo_damping", extra),
        ("viscous_friction", extra),
        ("viscous_friction", -30.0),
    ):
        effects = None if name is None else {name: {"damping": slowed}}
        r = free(effects, (-speed, 0.9))
        behind = (r.true_position - r.set_point)[-1]
        np.testing.assert_allclose(behind, (DAMPING + slowed) * speed / KP, rtol=1e-5)  # e^-13
        jump = rollout(effects, np.zeros((60, 2)), FREE, prepare=set_points_at(0.0))
        fastest[name, slowed] = np.abs(jump.true_velocity).max()
    # At the force limit only the joint's damping holds the finger back, 16 N over it; the servo's is within the limit.
    assert fastest[None, 0.0] == pytest.approx(FORCE_LIMIT / DAMPING, rel=1e-3)
    assert fastest["servo_damping", extra] == pytest.approx(FORCE_LIMIT / DAMPING, rel=1e-3)
    assert fastest["viscous_friction", extra] == pytest.approx(FORCE_LIMIT / (DAMPING + extra), rel=1e-3)
    assert fastest["viscous_friction", -30.0] == pytest.approx(FORCE_LIMIT / (DAMPING - 30), rel=1e-3)


@shows("servo_damping")
def test_a_servo_never_drives_its_joint():
    """Less damping than none would be a motor: the gripper's servo has none to lose. A search may still ask for it."""
    assert same_motion(free({"servo_damping": {"damping": {"value": -60.0}}}, (SLOW, 0.5)), free(None, (SLOW, 0.5)))


@shows("servo_stiffness")
def test_a_weak_servo_trails_farther_and_ends_at_the_same_place():
    nominal, weak = (free(effects, (SLOW, 0.8), (0.0, 1.0)) for effects in (None, {"servo_stiffness": {"factor": 0.5}}))
    trailing = [(r.true_position - r.set_point)[190, 0] for r in (nominal, weak)]
    assert trailing[1] / trailing[0] == pytest.approx(2.0, rel=1e-3)  # e^-10 at half the stiffness
    np.testing.assert_allclose(weak.true_position[-1], nominal.true_position[-1], atol=1e-7)


@shows("motor_cogging")
def test_cogging_is_a_ripple_of_that_force_over_that_distance():
    amplitude, period = 1.0, 0.005
    r = free(entry("motor_cogging", "gripper_right_finger_joint", amplitude=amplitude, period=period), (-0.01, 3.5))
    steady = slice(120, None)
    position, effort, velocity = r.true_position[steady, 0], r.effort[steady, 0], r.true_velocity[steady, 0]

    def ripple(length):
        turn = 2 * np.pi * position / length
        seen = np.column_stack([np.ones_like(position), velocity, np.sin(turn), np.cos(turn)])
        return np.linalg.lstsq(seen, effort, rcond=None)[0]

    _, damping, sine, cosine = ripple(period)
    assert damping == pytest.approx(DAMPING, rel=0.01)
    # The servo holds against it; efforts are of the physics step before, at 20 µm of 5 mm: a turn of 0.03.
    assert -sine == pytest.approx(amplitude, rel=0.01)
    assert abs(cosine) < 0.05
    assert np.hypot(*ripple(0.7 * period)[2:]) < 0.2  # another period is not in it
    assert np.ptp(r.effort[steady, 1]) < 1e-4  # nor any on the other finger
