"""An environment that is watched, without a browser."""

import numpy as np
import pytest

from tiago_mj.effects import Entry
from tiago_mj.view.session import HAND, entry, knobs, offered, session, whom

BACKLASH = Entry("backlash", None, {"width": 0.002})


@pytest.fixture
def watched():
    made = session("GripperTactile-v0")
    yield made
    made.close()


def test_without_effects_robot_and_twin_are_one(watched):
    watched.action[:] = -0.5
    for _ in range(60):
        row = watched.step()
    assert np.array_equal(row.position, row.nominal)
    assert row.position[0] < 0.04  # it closed


def test_an_effect_acts_from_where_the_episode_is(watched):
    watched.action[:] = -0.5
    for _ in range(30):
        before = watched.step()
    watched.give([BACKLASH])
    assert watched.steps == 30
    after = watched.step()
    assert np.abs(after.position - before.position).max() < 1e-3  # no jump
    for _ in range(20):
        row = watched.step()
    assert np.abs(row.position - row.nominal).max() > 2e-4  # the joint waits until the play is crossed
    watched.give([])
    assert watched.core.effects == ()


def test_effects_given_and_taken_leave_the_model_as_it_was(watched):
    names = ("body_mass", "dof_frictionloss", "dof_damping", "actuator_gainprm", "geom_friction")
    before = {name: getattr(watched.core.model, name).copy() for name in names}
    watched.give([Entry("payload"), Entry("coulomb_friction", None, {"force": 3.0}), Entry("servo_stiffness")])
    assert not np.array_equal(watched.core.model.body_mass, before["body_mass"])
    watched.step()
    watched.give([])
    for name, value in before.items():
        np.testing.assert_allclose(getattr(watched.core.model, name), value, atol=1e-12, err_msg=name)


def test_an_effect_that_does_not_fit_leaves_those_before(watched):
    watched.give([BACKLASH])
    with pytest.raises(ValueError, match="backlash"):
        watched.give([Entry("backlash", ("no_such_joint",))])
    assert watched.effects == (BACKLASH,)
    watched.action[:] = -1
    for _ in range(30):
        row = watched.step()
    assert np.abs(row.position - row.nominal).max() > 2e-4


def test_policies_that_fit_are_offered_and_command(watched):
    assert watched.policies[0] == HAND
    assert {"pi", "pi-tuned", "random"} <= set(watched.policies)
    watched.command_by("pi")
    watched.reset()
    for _ in range(250):
        row = watched.step()
    assert row.force.min() > 3
    assert watched.force_goal() == pytest.approx(6.06, abs=0.01)
    with pytest.raises(ValueError, match="unknown"):
        watched.command_by("nobody")
    assert watched.commander == "pi"


def test_arrows_point_out_of_the_grasp_and_have_the_force(watched):
    watched.command_by("pi")
    for _ in range(200):
        row = watched.step()
    (right, at_right, on_right), (left, at_left, on_left) = watched.pad_forces()
    assert (right, left) == ("right", "left")
    np.testing.assert_allclose([np.linalg.norm(on_right), np.linalg.norm(on_left)], row.force, rtol=1e-6)
    assert on_right @ (at_right - at_left) > 0
    assert on_left @ (at_left - at_right) > 0
    assert len(watched.contacts()) > 0


def test_every_offered_effect_can_be_given_at_both_ends_of_its_sliders(watched):
    for name in offered(watched):
        them = next(iter(whom(watched, name).values()))
        for end in ("low", "high", "default"):
            values = {knob.name: getattr(knob, end) for knob in knobs(watched, name, them)}
            watched.give([entry(name, them, values)])
            watched.step()
    assert np.isfinite(watched.core.data.qpos).all()


def test_joints_that_slide_and_that_turn_are_apart():
    made = session("TIAGoTactile-v0")
    choices = whom(made, "coulomb_friction")
    assert "all" not in choices
    assert "torso_lift_joint" in choices["all that slide"]
    assert "arm_4_joint" in choices["all that turn"]
    (force,) = knobs(made, "coulomb_friction", choices["all that turn"])
    assert force.unit == "N·m"
    made.close()


def test_a_place_to_reach_is_known():
    made = session("TIAGoReach-v0")
    np.testing.assert_allclose(made.place_goal(), made.core.goal)
    assert made.force_goal() is None
    made.close()
