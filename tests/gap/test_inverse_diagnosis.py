"""Diagnosis along a measured motion: simulated arms with and without something unmodelled, and the real TIAGo arm.

What is recorded here comes from forward simulations of their own: a tracking controller moves the joints, MuJoCo's
constraint solver makes the friction, and noise is added, so nothing of the diagnosis takes part in making the data.
"""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.imports import tiago_arm
from tiago_mj.gap.inverse import diagnose_inverse
from tiago_mj.gap.recording import RecordingError, Sidecar, Trial
from tiago_mj.gap.report import json as report
from tiago_mj.gap.result import Diagnosis, Explanation, Value
from tiago_mj.models.files import model_file

ROOT = Path(__file__).parents[2]
REAL = Path(os.environ.get("TIAGO_MJ_REALDATA", ROOT.parent / "shared" / "realdata")) / "tiago_arm"
RATE, TIMESTEP = 100, 0.002
STICKS = {"solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0), "solref": (0.002, 1.0)}

PENDULUM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="swing" axis="0 1 0" damping="0.05" frictionloss="0.02" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01" mass="0.1"/>
      <body name="tip" pos="0 0 -0.3"><geom type="sphere" size="0.03" mass="0.5"/></body>
    </body>
  </worldbody>
  <actuator><motor name="swing" joint="swing"/></actuator>
</mujoco>
"""
ARM = tuple(f"arm_{i}_joint" for i in range(1, 5))

Pull = Callable[[mujoco.MjData, float], np.ndarray]


def pendulum() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(PENDULUM)


def robot() -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_path(str(model_file("robots/tiago_ta11.xml")))
    model.opt.timestep = TIMESTEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return model


def record(
    model: mujoco.MjModel,
    joints: tuple[str, ...],
    *,
    spread: float = 0.6,
    seconds: float = 60.0,
    noise: float = 0.01,
    pull: Pull | None = None,
    seed: int = 0,
) -> Trial:
    """What a logger on the arm sees: position and drive torque, while each joint follows three slow sines of its own.

    ``pull`` is a torque on the joints that is not the drives', as a cable would exert it.
    """
    model.body_gravcomp[:] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in joints:
        dof = model.joint(joint).dofadr[0]
        model.dof_solimp[dof], model.dof_solref[dof] = STICKS["solimp"], STICKS["solref"]
    model.actuator_gainprm[:] = 0
    model.actuator_biasprm[:] = 0
    data, ideal = mujoco.MjData(model), mujoco.MjData(model)
    if model.nkey:
        data.qpos[:] = model.key_qpos[0]
    q = [int(model.joint(name).qposadr[0]) for name in joints]
    v = [int(model.joint(name).dofadr[0]) for name in joints]
    random = np.random.default_rng(seed)
    n = len(joints)
    frequency = random.uniform(0.08, 0.35, (3, n))
    phase = random.uniform(0, 2 * np.pi, (3, n))
    size = spread / 3 * np.array([1.4, 1.0, 0.6])[:, None]
    middle = data.qpos.copy()
    others = [d for d in range(model.nv) if d not in v]
    model.dof_armature[others] += 1e4  # they are not recorded: what they carry must not move them
    inertia = np.zeros((model.nv, model.nv))
    rows, every = [], round(1 / (RATE * TIMESTEP))
    for k in range(int(seconds / TIMESTEP)):
        time = k * TIMESTEP
        turn = 2 * np.pi * frequency
        wanted = (size * (np.sin(turn * time + phase) - np.sin(phase))).sum(axis=0)
        speed = (size * turn * np.cos(turn * time + phase)).sum(axis=0)
        change = -(size * turn**2 * np.sin(turn * time + phase)).sum(axis=0)
        if k == 0:
            data.qvel[v] = speed
        ideal.qpos[:], ideal.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, ideal)
        mujoco.mj_fullM(model, ideal, inertia)
        error, slip = wanted - (data.qpos[q] - middle[q]), speed - data.qvel[v]
        acceleration = np.zeros(model.nv)
        acceleration[v] = change + 900 * error + 60 * slip
        acceleration[others] = -900 * (data.qpos - middle)[: model.nv][others] - 60 * data.qvel[others]
        torque = inertia @ acceleration + ideal.qfrc_bias - ideal.qfrc_passive
        if k % every == 0:
            rows.append((time, data.qpos[q].copy(), torque[v].copy()))
        data.qfrc_applied[:] = torque
        if pull is not None:
            data.qfrc_applied[v] += pull(data, time)
        mujoco.mj_step(model, data)
    times = np.array([row[0] for row in rows])
    position = np.array([row[1] for row in rows]) + random.normal(0, 1e-5, (len(rows), n))
    effort = np.array([row[2] for row in rows])
    effort += random.normal(0, 1, effort.shape) * noise * np.sqrt((effort**2).mean(axis=0))
    return trial(times, dict(zip(joints, position.T, strict=True)), dict(zip(joints, effort.T, strict=True)))


def trial(time: np.ndarray, positions: dict[str, np.ndarray], efforts: dict[str, np.ndarray]) -> Trial:
    return Trial("trial", time, {}, positions, {}, efforts, {}, Sidecar(trial="trial", rate_hz=RATE), "trial.csv")


def diagnosed(recorded: Trial, model: mujoco.MjModel, seed: int = 0) -> Diagnosis:
    return diagnose_inverse((recorded,), model, tuple(recorded.efforts), robot="r", seed=seed, version="0")


def named(explanation: Explanation) -> set[str]:
    return {effect.name for effect in explanation.effects}


def value(explanation: Explanation, name: str, target: str, parameter: str) -> Value:
    (found,) = [e.parameters[parameter] for e in explanation.effects if (e.name, e.target) == (name, target)]
    return found


def holds(found: Value, truth: float) -> bool:
    return found.low is not None and found.high is not None and found.low <= truth <= found.high


FRICTION = np.array([2.0, 4.0, 1.5, 1.0])
DAMPING = np.array([10.0, 8.0, 4.0, 3.0])


@pytest.fixture(scope="module")
def rubbing() -> Trial:
    """An arm with more dry and viscous friction on four joints than its model has."""
    model = robot()
    dofs = [model.joint(name).dofadr[0] for name in ARM]
    model.dof_frictionloss[dofs] += FRICTION
    model.dof_damping[dofs] += DAMPING
    return record(model, ARM, spread=0.9)


@pytest.fixture(scope="module")
def rubbed(rubbing: Trial) -> Diagnosis:
    return diagnosed(rubbing, robot())


# What is there is found -----------------------------------------------------------------------------------------------


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
    assert rubbed.best.probability > 0.9


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
    found = diagnosed(record(pendulum(), ("swing",), spread=1.2), pendulum())
    assert found.kind == "no_gap"
    assert not found.best.effects
    assert not found.remains


def test_masses_off_by_three_percent_are_no_gap() -> None:
    model = pendulum()
    model.body_mass[:] *= 1.03
    model.body_inertia[:] *= 1.03
    assert diagnosed(record(model, ("swing",), spread=1.2), pendulum()).kind == "no_gap"


def test_a_mass_in_the_gripper_is_a_payload_of_its_weight() -> None:
    model = robot()
    model.body_mass[model.body("gripper_link").id] += 1.0
    found = diagnosed(record(model, ARM, spread=0.9, seconds=40), robot())
    assert found.kind == "effect"
    assert named(found.best) == {"payload"}
    assert holds(value(found.best, "payload", ARM[-1], "mass"), 1.0)
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
    found = diagnosed(record(model, ("swing",), spread=1.2), pendulum())
    assert (found.kind, named(found.best)) == ("effect", {name})
    # 3 %: the pass band cuts the sharp ends of accelerations and of jumps of friction.
    assert value(found.best, name, "swing", parameter).value == pytest.approx(more, rel=0.03)


def test_a_torque_constant_that_is_off_shows_as_a_factor_on_every_torque() -> None:
    recorded = record(pendulum(), ("swing",), spread=1.2)
    found = diagnosed(replace(recorded, efforts={"swing": recorded.efforts["swing"] / 0.8}), pendulum())
    assert (found.kind, named(found.best)) == ("effect", {"torque_constant"})
    assert holds(value(found.best, "torque_constant", "swing", "factor"), 0.8)


def test_positions_that_are_stamped_late_against_efforts_show_as_a_clock_offset() -> None:
    recorded = record(pendulum(), ("swing",), spread=1.2)
    late = np.interp(recorded.time - 0.05, recorded.time, recorded.positions["swing"])
    found = diagnosed(replace(recorded, positions={"swing": late}), pendulum())
    assert (found.kind, named(found.best)) == ("effect", {"clock_offset"})
    assert holds(value(found.best, "clock_offset", "all", "seconds"), 0.05)


# What cannot be known is said -----------------------------------------------------------------------------------------


def test_one_joint_cannot_tell_a_tilted_base_from_an_encoder_that_is_off() -> None:
    recorded = record(pendulum(), ("swing",), spread=1.2)
    found = diagnosed(replace(recorded, positions={"swing": recorded.positions["swing"] + 0.06}), pendulum())
    assert found.kind == "ambiguous"
    assert {frozenset(named(one)) for one in found.alternatives} == {
        frozenset({"gravity_tilt"}),
        frozenset({"encoder_bias"}),
    }
    assert any("cannot tell apart" in note for note in found.notes)


def test_a_cable_that_tugs_is_unknown_and_what_remains_is_placed() -> None:
    def cable(data: mujoco.MjData, time: float) -> np.ndarray:
        return -0.6 * np.sin(2.5 * data.qpos[:1])

    found = diagnosed(record(pendulum(), ("swing",), spread=1.2, pull=cable), pendulum())
    assert found.kind == "unknown"
    assert not found.best.effects
    assert found.remains
    assert {place.channel for place in found.remains_where} == {"effort.swing"}


def test_a_cable_at_one_joint_of_an_arm_is_placed_there() -> None:
    def cable(data: mujoco.MjData, time: float) -> np.ndarray:
        return np.array([-6.0 * np.sin(2.5 * data.qpos[1]), 0, 0, 0])

    found = diagnosed(record(robot(), ARM, spread=0.9, seconds=40, pull=cable), robot())
    assert found.kind == "unknown"
    assert found.remains
    assert found.remains_where[0].channel == "effort.arm_1_joint"


def test_what_a_log_without_commands_cannot_show_is_listed(rubbed: Diagnosis) -> None:
    assert {"command_delay", "servo_stiffness", "backlash", "force_lag"} <= set(rubbed.not_excited)
    assert not {"coulomb_friction", "viscous_friction", "payload"} & set(rubbed.not_excited)
    assert any("commands" in note for note in rubbed.notes)


# Wrong recordings answer differently ----------------------------------------------------------------------------------


def test_a_flipped_sign_is_said_and_shakes_the_verdict(rubbing: Trial) -> None:
    flipped = {name: -v if name == "arm_2_joint" else v for name, v in rubbing.efforts.items()}
    found = diagnosed(replace(rubbing, efforts=flipped), robot())
    assert ("sign", "effort.arm_2_joint") in {(f.code, f.channel) for f in found.findings}
    assert not (found.kind == "effect" and named(found.best) == {"coulomb_friction", "viscous_friction"})


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
        found = diagnosed(wrong, robot())
        assert not (found.kind == "effect" and named(found.best) == {"coulomb_friction", "viscous_friction"})
        assert found.remains


# Input ----------------------------------------------------------------------------------------------------------------


def test_a_dead_effort_channel_is_left_out_and_named() -> None:
    recorded = record(robot(), ARM, spread=0.9, seconds=30)
    dead = dict(recorded.efforts) | {"arm_4_joint": np.zeros_like(recorded.time)}
    found = diagnosed(replace(recorded, efforts=dead), robot())
    assert ("dead_channel", "effort.arm_4_joint") in {(f.code, f.channel) for f in found.findings}
    assert "effort.arm_4_joint" not in {place.channel for place in found.where}


def test_an_effort_in_another_unit_is_left_out_and_named() -> None:
    recorded = record(robot(), ARM[1:3], spread=0.9, seconds=30)
    amperes = dict(recorded.efforts) | {"arm_2_joint": recorded.efforts["arm_2_joint"] / 400}
    found = diagnosed(replace(recorded, efforts=amperes), robot())
    assert ("unit_scale", "effort.arm_2_joint") in {(f.code, f.channel) for f in found.findings}


def test_several_short_trials_are_not_cut() -> None:
    model = pendulum()
    model.dof_frictionloss[:] += 0.3
    whole = [record(model, ("swing",), spread=1.2, seconds=8, seed=k) for k in range(7)]
    trials = tuple(replace(one, name=f"t{k}") for k, one in enumerate(whole))
    found = diagnose_inverse(trials, pendulum(), ("swing",), robot="r", seed=0, version="0")
    assert sorted(name for part in found.splits.values() for name in part) == [f"t{k}" for k in range(7)]
    assert named(found.best) == {"coulomb_friction"}


def test_the_same_recording_and_seed_give_the_same_answer() -> None:
    model = pendulum()
    model.dof_damping[:] += 0.2
    recorded = record(model, ("swing",), spread=1.2, seconds=30)
    first, second = (json.loads(report.text(diagnosed(recorded, pendulum()))) for _ in range(2))
    first.pop("seconds"), second.pop("seconds")
    assert first == second


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda t: replace(t, positions={"swing": np.zeros_like(t.time)}), "no joint moves"),
        (lambda t: replace(t, efforts={"swing": np.zeros_like(t.time)}), "same value"),
        (
            lambda t: trial(t.time[:20], {"swing": t.positions["swing"][:20]}, {"swing": t.efforts["swing"][:20]}),
            "longer",
        ),
        (lambda t: replace(t, efforts={"swing": np.full_like(t.time, np.nan)}), "same value|no stretch"),
    ],
)
def test_a_recording_that_cannot_be_used_ends_in_one_line(spoil: Callable[[Trial], Trial], says: str) -> None:
    recorded = spoil(record(pendulum(), ("swing",), spread=1.2, seconds=10))
    with pytest.raises(RecordingError, match=says) as fault:
        diagnosed(recorded, pendulum())
    assert "trial.csv" in str(fault.value)
    assert "\n" not in str(fault.value)


def test_a_joint_that_the_model_lacks_is_named() -> None:
    recorded = record(pendulum(), ("swing",), seconds=10)
    with pytest.raises(ValueError, match="no joint 'elbow'"):
        diagnose_inverse((recorded,), pendulum(), ("elbow",), robot="r", seed=0, version="0")


# The real arm ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real() -> Trial:
    if not REAL.is_dir():
        pytest.skip(f"{REAL} is absent: set TIAGO_MJ_REALDATA to the folder of the public recordings")
    (one,) = tiago_arm.trials(str(REAL))
    return one


@pytest.fixture(scope="module")
def found(real: Trial) -> Diagnosis:
    return diagnosed(real, robot())


def test_the_real_arm_rubs_in_all_four_joints_whatever_else_may_be(found: Diagnosis) -> None:
    for one in (found.best, *found.alternatives):
        rubbing = {e.target for e in one.effects if EFFECTS[e.name].gap_class in ("friction", "damping")}
        assert rubbing >= set(ARM)
    assert found.shrink.closed is not None
    assert found.shrink.closed > 0.8
    assert found.remains  # a quarter of the rms is left, ten times the noise: no effect of the library takes it away


def test_the_real_arm_does_not_tell_a_payload_from_the_efforts_scale(found: Diagnosis) -> None:
    assert found.kind == "ambiguous"
    extra = [named(one) & {"payload", "torque_constant"} for one in found.alternatives]
    assert {"payload"} in extra
    assert {"torque_constant"} in extra


def test_the_real_arms_wrist_and_torso_efforts_are_left_out_and_why(found: Diagnosis) -> None:
    codes = {(f.code, f.channel) for f in found.findings}
    assert {("dead_channel", f"effort.arm_{k}_joint") for k in (5, 6, 7)} <= codes
    assert ("unit_scale", "effort.torso_lift_joint") in codes
    assert {place.channel for place in found.where} == {f"effort.{name}" for name in ARM}
    assert any("velocities trail" in note for note in found.notes)


def test_the_real_arm_with_its_joints_exchanged_is_another_story(real: Trial, found: Diagnosis) -> None:
    efforts = dict(real.efforts)
    efforts["arm_2_joint"], efforts["arm_4_joint"] = efforts["arm_4_joint"], -efforts["arm_2_joint"]
    wrong = diagnosed(replace(real, efforts=efforts), robot())
    assert wrong.shrink.closed is None or found.shrink.closed is None or wrong.shrink.closed < found.shrink.closed
    assert wrong.kind == "unknown" or named(wrong.best) != named(found.best)
