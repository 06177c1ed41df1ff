"""Diagnosis along a measured motion: simulated arms with and without something unmodelled, and the real TIAGo arm."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_motions import ARM, diagnosed, holds, named, pendulum, record, robot, trial, value
from real_recordings import real

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.decision.verdict import most_probable
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.torque import doubts
from tiago_mj.gap.torque.measured import METHOD
from tiago_mj.recordings.imports import tiago_arm
from tiago_mj.recordings.recording import Trial

FRICTION = np.array([2.0, 4.0, 1.5, 1.0])
DAMPING = np.array([10.0, 8.0, 4.0, 3.0])


def rubbing_arm(seconds: float) -> Trial:
    """An arm with more dry and viscous friction on four joints than its model has."""
    model = robot()
    dofs = [model.joint(name).dofadr[0] for name in ARM]
    model.dof_frictionloss[dofs] += FRICTION
    model.dof_damping[dofs] += DAMPING
    return record(model, ARM, spread=0.9, seconds=seconds)


@pytest.fixture(scope="module")
def rubbing() -> Trial:
    return rubbing_arm(60)


@pytest.fixture(scope="module")
def rubbed() -> Diagnosis:
    """Half a minute is enough to be right; in a quarter of it the wrist's friction is not seen in every part."""
    return diagnosed(rubbing_arm(30))


# What is there is found -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_friction_of_an_arm_is_named_joint_by_joint_with_its_values(rubbed: Diagnosis) -> None:
    assert rubbed.kind == "effect"
    assert named(rubbed.best) == {"coulomb_friction", "viscous_friction"}
    # Noise of 1 % and a model that is right but for the friction: a twentieth is what the reversals cost.
    for joint, force, damping in zip(ARM, FRICTION, DAMPING, strict=True):
        assert value(rubbed.best, "coulomb_friction", joint, "force").value == pytest.approx(force, rel=0.05)
        assert value(rubbed.best, "viscous_friction", joint, "damping").value == pytest.approx(damping, rel=0.05)
        assert holds(value(rubbed.best, "coulomb_friction", joint, "force"), force)
        assert holds(value(rubbed.best, "viscous_friction", joint, "damping"), damping)
    assert rubbed.stage == "transmission"
    assert rubbed.best.probability > 0.98 * most_probable(rubbed.best, replays=False)


@pytest.mark.slow
def test_the_gap_closes_on_blocks_that_were_kept_aside(rubbed: Diagnosis) -> None:
    shrink = rubbed.shrink
    assert shrink.before is not None
    assert shrink.after is not None
    assert shrink.closed is not None
    assert shrink.before > 1000
    assert shrink.after < 3  # squared noise: the residual is the noise's own size
    assert shrink.closed > 0.99
    assert set(shrink.per_channel) == {f"effort.{name}" for name in ARM}
    assert not set(rubbed.splits["test"]) & {*rubbed.splits["train"], *rubbed.splits["validation"]}


def test_a_recording_of_the_model_itself_has_no_gap() -> None:
    found = diagnosed(record(pendulum(), ("swing",), spread=1.2))
    assert found.kind == "no_gap"
    assert not found.best.effects
    assert not found.remains


def test_masses_off_by_three_percent_are_no_gap() -> None:
    model = pendulum()
    model.body_mass[:] *= 1.03
    model.body_inertia[:] *= 1.03
    recorded = record(model, ("swing",), spread=1.2)
    found = diagnosed(recorded)
    assert found.kind == "no_gap"
    (mass,) = found.numbers
    assert (mass.name, mass.target, mass.nominal) == ("link_mass", "swing", 1.0)
    assert mass.low < 1.03 < mass.high
    assert found.shrink.before is not None
    assert found.shrink.before > 10
    assert found.shrink.with_numbers is not None
    assert found.shrink.with_numbers.after < 2
    without = diagnosed(recorded, names=("payload",), numbers=False)
    assert (without.numbers, without.shrink.with_numbers) == ((), None)


@pytest.mark.slow
def test_a_mass_in_the_gripper_is_a_payload_of_its_weight() -> None:
    model = robot()
    model.body_mass[model.body("gripper_link").id] += 1.0
    found = diagnosed(record(model, ARM, spread=0.9, seconds=40))
    assert found.kind == "effect"
    assert named(found.best) == {"payload"}
    assert holds(value(found.best, "payload", "all", "mass"), 1.0)
    assert found.stage == "body"


@pytest.mark.parametrize(
    ("field", "more", "name", "parameter"),
    [
        ("dof_frictionloss", 0.3, "coulomb_friction", "force"),
        ("dof_damping", 0.2, "viscous_friction", "damping"),
        ("dof_armature", 0.05, "armature", "mass"),
    ],
)
def test_one_effect_on_a_pendulum_is_named_with_its_value(field: str, more: float, name: str, parameter: str) -> None:
    model = pendulum()
    getattr(model, field)[:] += more
    found = diagnosed(record(model, ("swing",), spread=1.2))
    assert (found.kind, named(found.best)) == ("effect", {name})
    assert not {doubts.SAID, doubts.IMITATED} & set(found.notes), "no centre of mass does what it does"
    # 3 %: the pass band cuts the sharp ends of accelerations and of jumps of friction.
    assert value(found.best, name, "all", parameter).value == pytest.approx(more, rel=0.03)


def test_a_torque_constant_that_is_off_shows_as_a_factor_on_every_torque() -> None:
    recorded = record(pendulum(), ("swing",), spread=1.2, seconds=32)  # 20 s leave a payload
    found = diagnosed(replace(recorded, efforts={"swing": recorded.efforts["swing"] / 0.8}))
    assert (found.kind, named(found.best)) == ("effect", {"torque_constant"})
    assert holds(value(found.best, "torque_constant", "all", "factor"), 0.8)


def test_positions_that_are_stamped_late_against_efforts_show_as_a_clock_offset() -> None:
    recorded = record(pendulum(), ("swing",), spread=1.2)
    late = np.interp(recorded.time - 0.05, recorded.time, recorded.positions["swing"])
    found = diagnosed(replace(recorded, positions={"swing": late}))
    assert (found.kind, named(found.best)) == ("effect", {"clock_offset"})
    assert holds(value(found.best, "clock_offset", "all", "seconds"), 0.05)


def test_a_centre_of_mass_that_is_stated_to_be_uncertain_is_a_number_as_fitted() -> None:
    model = pendulum()
    model.body_ipos[model.body("arm").id][0] += 0.06  # of 0.1 kg, beside 0.5 kg of tip: 10 mm of what the joint carries
    recorded = record(model, ("swing",), spread=1.2)
    assert diagnosed(recorded).kind != "no_gap"
    stated = replace(recorded.sidecar, raw={"uncertainty": {"link_centre_x": 0.03}})
    found = diagnosed(replace(recorded, sidecar=stated))
    assert (found.kind, found.best.effects) == ("no_gap", ())
    (centre,) = (number for number in found.numbers if number.name == "link_centre_x")
    assert centre.low < 0.06 * 0.1 / 0.6 < centre.high
    assert found.shrink.with_numbers is not None
    assert found.shrink.with_numbers.after < 2


@pytest.mark.slow
def test_centres_of_mass_that_are_off_do_not_become_effects_beside_friction() -> None:
    """12 mm in every direction is 5 % of what a link of the arm reaches."""
    model = robot()
    off = np.random.default_rng(1)
    for name in ARM:
        model.body_ipos[model.jnt_bodyid[model.joint(name).id]] += off.normal(0, 0.012, 3)
    model.dof_frictionloss[[model.joint(name).dofadr[0] for name in ARM]] += FRICTION
    found = diagnosed(record(model, ARM, spread=0.9, seconds=30))
    assert (found.kind, named(found.best)) == ("effect", {"coulomb_friction"})
    assert doubts.SAID in found.notes
    assert any(number.name.startswith("link_centre") for number in found.numbers)
    assert found.shrink.with_numbers is not None
    assert found.shrink.with_numbers.after < 2


def test_nothing_is_doubted_where_an_effect_explains_what_was_measured() -> None:
    model = pendulum()
    model.body_mass[model.body("tip").id] += 0.1
    found = diagnosed(record(model, ("swing",), spread=1.2))
    assert named(found.best) == {"payload"}
    assert doubts.SAID not in found.notes


def test_a_log_that_was_filtered_before_is_not_taken_for_one_without_noise() -> None:
    """A gap as large as the efforts themselves is at most as many noise floors as torques along a motion can tell."""
    model = pendulum()
    model.dof_frictionloss[:] += 0.3
    recorded = record(model, ("swing",), spread=1.2, noise=0.0)
    smooth = sum(recorded.positions["swing"][k : len(recorded.time) - 9 + k] for k in range(9)) / 9
    effort = sum(recorded.efforts["swing"][k : len(recorded.time) - 9 + k] for k in range(9)) / 9
    again = replace(recorded, time=recorded.time[4:-5], positions={"swing": smooth}, efforts={"swing": effort})
    found = diagnosed(again)
    assert named(found.best) == {"coulomb_friction"}
    assert found.shrink.before is not None
    assert found.shrink.before < 1 / METHOD**2


# What cannot be known is said -----------------------------------------------------------------------------------------


def test_one_joint_cannot_tell_a_tilted_base_from_an_encoder_that_is_off() -> None:
    recorded = record(pendulum(), ("swing",), spread=1.2)
    found = diagnosed(replace(recorded, positions={"swing": recorded.positions["swing"] + 0.06}))
    assert found.kind == "ambiguous"
    assert {frozenset(named(one)) for one in found.alternatives} == {
        frozenset({"gravity_tilt"}),
        frozenset({"encoder_bias"}),
    }
    assert doubts.IMITATED in found.notes, "nor from a centre of mass that lies 6 % of the reach aside"


def test_a_cable_that_tugs_is_unknown_and_what_remains_is_placed() -> None:
    def cable(data: mujoco.MjData, time: float) -> np.ndarray:
        return -0.6 * np.sin(2.5 * data.qpos[:1])

    found = diagnosed(record(pendulum(), ("swing",), spread=1.2, seconds=16, pull=cable))
    assert found.kind == "unknown"
    assert found.remains
    assert {place.channel for place in found.remains_where} == {"effort.swing"}


@pytest.mark.slow
def test_a_cable_at_one_joint_of_an_arm_is_placed_there() -> None:
    def cable(data: mujoco.MjData, time: float) -> np.ndarray:
        return np.array([-6.0 * np.sin(2.5 * data.qpos[1]), 0, 0, 0])

    found = diagnosed(record(robot(), ARM, spread=0.9, seconds=40, pull=cable))
    assert found.kind == "unknown"
    assert found.remains
    assert found.remains_where[0].channel == "effort.arm_1_joint"


@pytest.mark.slow
def test_what_a_log_without_commands_cannot_show_is_listed(rubbed: Diagnosis) -> None:
    assert {"command_delay", "servo_stiffness", "backlash", "force_lag"} <= set(rubbed.not_excited)
    assert not {"coulomb_friction", "viscous_friction", "payload"} & set(rubbed.not_excited)
    assert any("commands" in note for note in rubbed.notes)


# Wrong recordings answer differently ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_flipped_sign_is_said_and_shakes_the_verdict(rubbing: Trial) -> None:
    flipped = {name: -v if name == "arm_2_joint" else v for name, v in rubbing.efforts.items()}
    found = diagnosed(replace(rubbing, efforts=flipped))
    assert ("sign", "effort.arm_2_joint") in {(f.code, f.channel) for f in found.findings}
    assert not (found.kind == "effect" and named(found.best) == {"coulomb_friction", "viscous_friction"})


@pytest.mark.slow
def test_efforts_of_other_joints_or_of_other_times_give_no_friction(rubbing: Trial) -> None:
    names = list(rubbing.efforts)
    swapped = dict(zip(names, [rubbing.efforts[n] for n in (*names[1:], names[0])], strict=True))
    n = len(rubbing.time) // 6
    order = np.concatenate([np.arange(k * n, (k + 1) * n) for k in (3, 0, 5, 1, 4, 2)])
    shuffled = trial(
        rubbing.time[: 6 * n],
        {k: v[: 6 * n] for k, v in rubbing.positions.items()},
        {k: v[order] for k, v in rubbing.efforts.items()},
    )
    for wrong in (replace(rubbing, efforts=swapped), shuffled):
        found = diagnosed(wrong)
        assert not (found.kind == "effect" and named(found.best) == {"coulomb_friction", "viscous_friction"})
        assert found.remains


# The real arm ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def arm() -> Trial:
    (one,) = tiago_arm.trials(str(real("tiago_arm")))
    return one


@pytest.fixture(scope="module")
def found(arm: Trial) -> Diagnosis:
    return diagnosed(arm)


@pytest.mark.slow
def test_the_real_arm_rubs_in_all_four_joints_whatever_else_may_be(found: Diagnosis) -> None:
    for one in (found.best, *found.alternatives):
        rubbing = {e.target for e in one.effects if EFFECTS[e.name].gap_class in ("friction", "damping")}
        assert rubbing >= set(ARM)
    assert found.shrink.closed is not None
    assert found.shrink.closed > 0.8
    assert found.remains  # a quarter of the rms is left, ten times the noise: no effect of the library takes it away


@pytest.mark.slow
def test_the_real_arm_needs_neither_a_payload_nor_another_scale_beside_its_friction(found: Diagnosis) -> None:
    for one in (found.best, *found.alternatives):
        assert not named(one) & {"payload", "torque_constant"}
        assert {EFFECTS[e.name].gap_class for e in one.effects} <= {"friction", "damping"}
    # A share, and not noise floors: these are those of the cut-off that tells most, at which other floors are left.
    assert found.shrink.with_numbers is not None
    assert found.shrink.with_numbers.closed > 0.9


@pytest.mark.slow
def test_the_real_arms_wrist_and_torso_efforts_are_left_out_and_why(found: Diagnosis) -> None:
    codes = {(f.code, f.channel) for f in found.findings}
    assert {("dead_channel", f"effort.arm_{k}_joint") for k in (5, 6, 7)} <= codes
    assert ("unit_scale", "effort.torso_lift_joint") in codes
    assert {place.channel for place in found.where} == {f"effort.{name}" for name in ARM}
    assert any("velocities trail" in note for note in found.notes)


@pytest.mark.slow
def test_the_real_arm_with_its_joints_exchanged_is_another_story(arm: Trial, found: Diagnosis) -> None:
    efforts = dict(arm.efforts)
    efforts["arm_2_joint"], efforts["arm_4_joint"] = efforts["arm_4_joint"], -efforts["arm_2_joint"]
    wrong = diagnosed(replace(arm, efforts=efforts))
    assert wrong.shrink.closed is None or found.shrink.closed is None or wrong.shrink.closed < found.shrink.closed
    assert wrong.kind == "unknown" or named(wrong.best) != named(found.best)
