"""What another contact or another object does to a grasp, measured from outside in a rollout."""

import numpy as np
import pytest
from effects_bench import (
    CONTACT_DAMPING,
    CONTACT_STIFFNESS,
    GRIPPER,
    MIDDLE,
    OBJECT_MASS,
    PERIOD,
    crossing,
    grasp,
    make,
    rollout,
    shows,
    speeds,
)

from tiago_mj.models import names

GRAVITY = 9.81  # m/s²
OPEN, PADS = 0.045, 0.02  # where the fingers start and where they touch [m]


def close(effects, beyond, **arguments):
    """Close, and hold the set points so far inside of the object [m]."""
    return grasp(effects, (-0.04, (OPEN - PADS + beyond) / 0.04), (0.0, 1.0), **arguments)


@shows("contact_stiffness")
@pytest.mark.parametrize("factor", [0.3, 1.0, 2.5])
def test_the_pads_sink_in_by_force_over_the_contacts_stiffness(factor):
    effects = {"contact_stiffness": {"factor": factor}}
    light, firm = close(effects, 0.001), close(effects, 0.005)
    stiffness = (firm.force[-1] - light.force[-1]) / (light.true_position[-1] - firm.true_position[-1])
    # Both fingers alike; the object's friction on the table takes 5 mN of several newtons from one of them.
    assert stiffness.mean() == pytest.approx(factor * CONTACT_STIFFNESS, rel=2e-3)


@shows("contact_inertia")
def test_a_contact_with_less_virtual_mass_gives_the_same_force_at_rest_and_a_steeper_rise():
    light, nominal, heavy = (close({"contact_inertia": {"factor": f}}, 0.005) for f in (0.6, 1.0, 3.0))
    for other in (light, heavy):
        np.testing.assert_allclose(other.force[-1], nominal.force[-1], rtol=1e-3)
    first = [r.force[np.argmax(r.force[:, 0] > 0.05), 0] for r in (light, nominal, heavy)]
    assert first[0] > first[1] > first[2]


@shows("contact_damping", "contact_stiffness")
@pytest.mark.parametrize(("stiffness", "damping"), [(1.0, 1.0), (1.0, 4.0), (0.5, 2.0)])
def test_the_force_on_a_moving_pad_is_that_of_spring_and_damper(stiffness, damping):
    effects = {"contact_stiffness": {"factor": stiffness}, "contact_damping": {"factor": damping}}
    # In contact all the while, at 1 Hz to 6 Hz: what a servo with a corner at 4 Hz still follows.
    t = np.arange(2 * 240) * PERIOD
    wave = -0.01 * np.cos(2 * np.pi * 1.5 * t) - 0.02 * np.cos(2 * np.pi * 6 * t)
    action = np.vstack([speeds((-0.04, 0.8)), np.repeat(wave[:, None], 2, axis=1) / 0.08])
    r = rollout(effects, action, **MIDDLE)
    moving = slice(200, -1)
    assert (r.force[moving] > 0.5).all()
    speed = -r.true_velocity[:, 0]
    pushed = np.gradient(speed, PERIOD)
    # A force is that of the physics step before, 2 ms ago.
    depth = PADS - r.true_position[:, 0] - speed * PERIOD / 2
    seen = np.column_stack([depth, speed - pushed * PERIOD / 2, pushed, np.ones_like(depth)])[moving]
    found = np.linalg.lstsq(seen, r.force[moving, 0], rcond=None)[0]
    # Accelerations are differences over 8 ms, where the contact's virtual mass of 0.33 kg feels those of 2 ms; at 6 Hz
    # its force is 5 % of the spring's.
    assert found[0] == pytest.approx(stiffness * CONTACT_STIFFNESS, rel=0.03)
    assert found[1] == pytest.approx(damping * CONTACT_DAMPING, rel=0.03)


@shows("contact_friction")
@pytest.mark.parametrize("factor", [1.0, 0.3, 2.0])
def test_contact_friction_holds_back_a_sliding_object_in_proportion_to_the_squeeze(factor):
    pull, hz = 60.0, 480  # N upwards; one physics step a row, so that force and acceleration are of the same instant
    core = make({"contact_friction": {"factor": factor}}, GRIPPER, control_hz=hz, **MIDDLE)
    core.reset(seed=0)
    for action in speeds((-0.04, 0.7), (0.0, 0.5), hz=hz):
        core.step(action)
    core.data.xfrc_applied[core.model.body(names.OBJECT_BODY).id, 2] = pull
    shares, last = [], 0.0
    for _ in range(6):
        core.step(np.zeros(2))
        speed = core.data.joint(names.OBJECT_JOINT).qvel[2]
        held = pull - OBJECT_MASS * (GRAVITY + (speed - last) * hz)
        squeeze = core.state.force_contact.sum()
        if squeeze > 1:  # a sliding object shakes between the pads
            shares.append(held / squeeze)
        last = speed
    # It starts from rest, on the table. Then friction is a share of the squeeze, whatever that is meanwhile.
    assert len(shares) >= 4
    np.testing.assert_allclose(shares[2:], factor, rtol=0.01)


@shows("object_size")
@pytest.mark.parametrize("radius", [0.003, -0.004])
def test_both_fingers_touch_a_larger_object_earlier_and_rest_farther_apart(radius):
    nominal, larger = close(None, 0.002), close({"object_size": {"radius": radius}}, 0.002 - radius)
    for finger in (0, 1):
        # Contact is seen when the force passes 50 mN, at 5 µm and one row of 0.17 mm.
        touch = [crossing(r.time, r.force[:, finger], 0.05) for r in (nominal, larger)]
        assert touch[0] - touch[1] == pytest.approx(radius / 0.04, abs=PERIOD)
    np.testing.assert_allclose(larger.true_position[-1] - nominal.true_position[-1], radius, rtol=2e-3)


@shows("object_size", "object_offset")
@pytest.mark.parametrize("distance", [0.005, -0.003])
def test_an_object_off_its_place_is_touched_earlier_on_that_side_and_later_on_the_other(distance):
    alone = {0: ((-0.04, 0.0), 0.9), 1: ((0.0, -0.04), 0.9)}
    for finger, sign in ((0, -1), (1, 1)):  # positive is towards the left finger
        touch = []
        for effects in (None, {"object_offset": {"distance": distance}}):
            r = grasp(effects, alone[finger])
            k = int(np.argmax(r.force[:, finger] > 0.05))
            touch.append(r.true_position[k, finger])
        # Within a row's way, 0.17 mm.
        assert touch[1] - touch[0] == pytest.approx(sign * distance, abs=1.7e-4)


@shows("object_mass")
@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_a_heavier_object_yields_less_to_the_same_push_and_is_squeezed_alike(factor):
    def pushed(core):
        core.data.joint(names.OBJECT_JOINT).qpos[2] += 0.3
        core.data.xfrc_applied[core.model.body(names.OBJECT_BODY).id, 0] = 0.5

    r = rollout({"object_mass": {"factor": factor}}, np.ones((30, 2)), prepare=pushed)
    acceleration = np.diff(r.state[:, 2:5], 2, axis=0)[5:] / PERIOD**2
    # Free fall: exact but for rounding of second differences.
    np.testing.assert_allclose(acceleration[:, 0], 0.5 / (factor * OBJECT_MASS), rtol=1e-7)
    np.testing.assert_allclose(acceleration[:, 2], -GRAVITY, rtol=1e-7)
    nominal, other = close(None, 0.002), close({"object_mass": {"factor": factor}}, 0.002)
    np.testing.assert_allclose(other.force[-1], nominal.force[-1], rtol=5e-3)  # friction on the table: 5 mN and more
