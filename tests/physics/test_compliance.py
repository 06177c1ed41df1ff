"""Contacts have the stiffness and damping that was asked for, measured on a bench of two pads and an object."""

from __future__ import annotations

import itertools
import re

import mujoco
import numpy as np
import pytest
import squeeze_bench as bench

from tiago_mj.models import compliance as cp

SOFT = cp.Compliance(1e4, 100.0)


def stable_impedance(model: mujoco.MjModel, geoms: tuple[str, str], compliance: cp.Compliance) -> float:
    """The default where it is stable, otherwise the least impedance that is."""
    least = cp.least_impedance(
        compliance,
        cp.inverse_weight(model, *geoms),
        contact_points=cp.shared_contact_points(model, *geoms),
        timestep=model.opt.timestep,
    )
    return max(cp.DEFAULT_IMPEDANCE, float(least))


def comply(model: mujoco.MjModel, compliance: cp.Compliance, **options) -> cp.ContactParameters:
    """Give both pads of the bench the same compliance."""
    for side in bench.SIDES:
        parameters = cp.set_pair_compliance(model, side, compliance, **options)
    return parameters


@pytest.mark.parametrize("shape", ["cylinder", "box", "sphere"])
@pytest.mark.parametrize("stiffness", [1e3, 3e3, 1e4, 3e4, 1e5])
def test_a_squeezed_object_yields_with_the_stiffness_that_was_asked(shape, stiffness):
    for timestep, mass, half_width in itertools.product((1 / 480, 1 / 960), (0.1, 0.421), (0.01, 0.03)):
        model = bench.gripper(shape, half_width=half_width, mass=mass, timestep=timestep, servo=False, table=False)
        wanted = cp.Compliance(stiffness, 100.0)
        comply(model, wanted, impedance=stable_impedance(model, ("right", "object"), wanted))
        forces, distances, speed = bench.squeeze(model, np.array([2.0, 4.0, 8.0]))
        # The pads' actuators are the known force; what is left of the motion is below a micrometre per millisecond.
        np.testing.assert_allclose(forces, [[2, 2], [4, 4], [8, 8]], rtol=2e-3)
        assert speed < 1e-3
        slopes = [np.polyfit(distances[:, i], forces[:, i], 1)[0] for i in range(2)]
        np.testing.assert_allclose(slopes, stiffness, rtol=0.02)  # asked of the product; typically 1e-4


@pytest.mark.parametrize("timestep", [1 / 480, 1 / 960])
@pytest.mark.parametrize("shape", ["sphere", "box", "cylinder"])
@pytest.mark.parametrize(("stiffness", "damping"), [(1e4, 100.0), (1e4, 20.0), (1e3, 30.0), (3e4, 300.0)])
def test_the_force_of_a_dropped_object_shows_stiffness_damping_and_virtual_mass(shape, timestep, stiffness, damping):
    model = bench.drop(shape, timestep=timestep)
    wanted = cp.Compliance(stiffness, damping)
    parameters = cp.set_pair_compliance(
        model, "contact", wanted, impedance=stable_impedance(model, ("object", "table"), wanted)
    )
    states, forces = bench.first_touch(model)
    found = np.linalg.lstsq(states, forces, rcond=None)[0]
    np.testing.assert_allclose(found[1], damping, rtol=0.05)  # asked of the product; the law is exact
    np.testing.assert_allclose(found, [stiffness, damping, parameters.virtual_mass], rtol=1e-3)


@pytest.mark.parametrize(("stiffness", "damping"), [(1e4, 100.0), (1e4, 20.0), (1e3, 30.0)])
def test_a_dropped_object_moves_as_a_damped_oscillator_that_carries_the_virtual_mass(stiffness, damping):
    # At 0.1 ms the integrator's own damping is about 1 %: what the motion shows is the contact's.
    timestep, mass = 1e-4, 0.421
    model = bench.drop("sphere", timestep=timestep, mass=mass)
    parameters = cp.set_pair_compliance(model, "contact", cp.Compliance(stiffness, damping))
    states, _ = bench.first_touch(model, seconds=0.1)
    found = bench.oscillator(
        states,
        timestep,
        stiffness=stiffness,
        damping=damping,
        mass=mass,
        virtual_mass=float(parameters.virtual_mass),
    )
    np.testing.assert_allclose(found, 1.0, rtol=0.05)


def test_two_compliances_in_series_yield_as_the_rule_says():
    right, left = cp.Compliance(2e3, 30.0), cp.Compliance(8e3, 50.0)
    model = bench.gripper(servo=False, table=False)
    cp.set_pair_compliance(model, "right", right)
    cp.set_pair_compliance(model, "left", left)
    forces, distances, _ = bench.squeeze(model, np.array([2.0, 8.0]))
    total = cp.in_series(right, left)
    measured = np.diff(forces[:, 0]) / np.diff(distances.sum(axis=1))
    np.testing.assert_allclose(measured, total.stiffness, rtol=0.02)
    assert total.stiffness == pytest.approx(1.6e3)
    assert total.damping == pytest.approx(80.0)


def test_a_rigid_body_leaves_the_others_compliance_and_bullets_unset_body_adds_its_damping():
    assert cp.in_series(SOFT, cp.RIGID) == SOFT
    assert cp.in_series(cp.BULLET_UNSET, SOFT) == cp.Compliance(1e4, 100.1)


@pytest.mark.parametrize("priority", [0, 1])
def test_mixing_spoils_a_geoms_solref_unless_it_has_priority(priority):
    plain = bench.gripper(servo=False, table=False)
    wanted = cp.contact_parameters(
        SOFT, cp.inverse_weight(plain, "right", "object"), contact_points=2, timestep=plain.opt.timestep
    )
    spec = mujoco.MjSpec()
    spec.option.timestep = plain.opt.timestep
    spec.option.gravity = [0, 0, 0]
    for sign, side in zip((-1, 1), bench.SIDES, strict=True):
        body = spec.worldbody.add_body(name=side, pos=[sign * (0.02 + bench.PAD[0] + 0.003), 0, 0.05])
        body.add_joint(name=side, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-sign, 0, 0], damping=bench.FINGER_DAMPING)
        geom = body.add_geom(name=side, type=mujoco.mjtGeom.mjGEOM_BOX, size=bench.PAD, mass=bench.FINGER_MASS)
        geom.priority, geom.solref, geom.solimp = priority, wanted.solref, wanted.solimp
        spec.add_actuator(name=side, target=side, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_motor()
    body = spec.worldbody.add_body(name="object", pos=[0, 0, 0.05])
    body.add_freejoint()
    body.add_geom(name="object", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.02, 0.05, 0], mass=0.421)
    forces, distances, _ = bench.squeeze(spec.compile(), np.array([2.0, 8.0]))
    error = np.diff(forces[:, 0]) / np.diff(distances[:, 0]) / SOFT.stiffness - 1
    # Without priority the impedance is averaged with the object's default 0.9..0.95: the stiffness is far from K.
    assert abs(error) < 0.02 if priority else abs(error) > 0.2


@pytest.mark.parametrize(("shape", "points"), [("cylinder", 2), ("box", 4), ("sphere", 1), ("ellipsoid", 1)])
def test_the_number_of_shared_contact_points_is_the_colliders(shape, points):
    model = bench.gripper(shape)
    assert cp.shared_contact_points(model, "right", "object") == points
    assert cp.shared_contact_points(model, "object", "left") == points
    data = mujoco.MjData(model)
    for depth, tilt in itertools.product((1e-6, 1e-4, 5e-3), (0.0, 3.0)):
        data.qpos[:2] = 0.003 + depth
        # About x, the pads' normal: every point of the pads stays in contact, whatever the depth.
        data.qpos[5:9] = [np.cos(np.radians(tilt / 2)), np.sin(np.radians(tilt / 2)), 0, 0]
        mujoco.mj_forward(model, data)
        right = model.geom("right").id
        assert sum(right in (c.geom1, c.geom2) for c in data.contact) == points


def test_a_capsule_on_a_flat_pad_is_refused_since_its_points_depend_on_the_tilt():
    with pytest.raises(ValueError, match=r"1 or 2 points.*give contact_points"):
        cp.shared_contact_points(bench.gripper("capsule"), "right", "object")


@pytest.mark.parametrize("load", [1.5, 1.9, 2.1, 2.5])
def test_the_stability_limit_is_where_the_simulation_becomes_unstable(load):
    # One body on a plane: the mass felt is m = 1/Â, m + M = M/d, so the exact limit is number * d = 2.
    timestep, impedance = 1 / 480, 0.9
    model = bench.drop("sphere", timestep=timestep, height=-5e-4)
    weight = cp.inverse_weight(model, "object", "table")
    inertia = 1 / weight / (1 - impedance)
    wanted = cp.Compliance(1e4, load * inertia / timestep - timestep * 1e4 / 2)
    number = cp.stability_number(wanted, weight, contact_points=1, impedance=impedance, timestep=timestep)
    assert float(number) * impedance == pytest.approx(load)
    model.pair_solref[0] = -np.array([1e4, wanted.damping]) * (1 - impedance) * weight
    model.pair_solimp[0, :2] = impedance
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20 * 480)  # the slow decay, C/K, takes 0.4 s at most
    # Stable: the rest, to rounding. Unstable: a chatter that only lift-off bounds.
    speed = abs(data.qvel[2])
    assert speed > 1e-3 if load > cp.STABILITY_LIMIT else speed < 1e-6


def speed_after_a_push(model: mujoco.MjModel) -> float:
    """Fastest speed left [m/s] 3 s after the object, squeezed with 5 N, got 10 mm/s from one pad towards the other."""
    data = mujoco.MjData(model)
    data.ctrl[:] = 5.0
    mujoco.mj_step(model, data, round(0.5 / model.opt.timestep))
    data.joint(2).qvel[0] += 0.01
    mujoco.mj_step(model, data, round(3.0 / model.opt.timestep))
    return float(np.abs(data.qvel).max())


@pytest.mark.parametrize(("impedance", "quiet"), [(0.7, True), (0.9, False)])
def test_a_large_virtual_mass_rings_beside_damped_fingers(impedance, quiet):
    model = bench.gripper(timestep=1 / 480, servo=False, table=False)
    comply(model, cp.Compliance(1e5, 100.0), impedance=impedance)
    speed = speed_after_a_push(model)
    assert speed < 2e-4 if quiet else speed > 5e-3  # the quiet rest is the friction creep of the push


@pytest.mark.parametrize(("share", "quiet"), [(0.9, True), (6.0, False)])
def test_below_the_virtual_mass_bound_a_grasp_is_quiet_without_contact_damping(share, quiet):
    model = bench.gripper(timestep=1 / 960, servo=False, table=False)
    bound = cp.virtual_mass_bound(bench.FINGER_MASS, 0.421, bench.FINGER_DAMPING, model.opt.timestep)
    per_point = share * bound * cp.inverse_weight(model, "right", "object") / 2
    # The least damping that keeps the friction rows, which share it, in their place.
    parameters = comply(model, cp.Compliance(1e4, 1e-3), impedance=per_point / (1 + per_point), friction_damping=50.0)
    np.testing.assert_allclose(parameters.virtual_mass, share * bound)
    speed = speed_after_a_push(model)
    assert speed < 1e-3 if quiet else speed > 1e-2


@pytest.mark.parametrize("impratio", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("friction_damping", [None, 50.0, 120.0])
def test_a_held_object_creeps_at_the_stated_speed(impratio, friction_damping):
    model = bench.gripper(servo=False, table=False, impratio=impratio)
    comply(model, SOFT, friction_damping=friction_damping)
    load = 0.421 * 9.81 / 2  # each pad carries half the weight
    assert bench.creep_speed(model) == pytest.approx(load / ((friction_damping or 100.0) * impratio), rel=0.01)


def test_bullets_step_damping_is_that_of_implicit_euler():
    # Poles of implicit Euler against those of the continuous oscillator with damping c + k dt; first order in dt.
    mass, dt = 1.0, 1e-3
    compliance = cp.Compliance(1e4, 5.0)
    step = np.linalg.inv(np.eye(2) - dt * np.array([[0, 1], [-1e4 / mass, -5.0 / mass]]))
    decay = -np.log(np.abs(np.linalg.eigvals(step)))[0] / dt
    effective = cp.with_bullet_step_damping(compliance, dt)
    assert effective.damping == pytest.approx(15.0)
    assert decay == pytest.approx(effective.damping / (2 * mass), rel=0.02)


def test_values_of_many_simulations_give_one_row_each():
    stiffness, weights = np.array([1e3, 1e4, 2e4]), np.array([10.0, 11.0, 12.0])
    rows = cp.contact_parameters(
        cp.Compliance(stiffness, 100.0), weights, contact_points=2, impedance=0.6, timestep=1 / 960
    )
    assert (rows.solref.shape, rows.solimp.shape, rows.virtual_mass.shape) == ((3, 2), (3, 5), (3,))
    for i in range(3):
        one = cp.contact_parameters(
            cp.Compliance(stiffness[i], 100.0), weights[i], contact_points=2, impedance=0.6, timestep=1 / 960
        )
        np.testing.assert_array_equal(rows.solref[i], one.solref)
        np.testing.assert_array_equal(rows.virtual_mass[i], one.virtual_mass)


@pytest.mark.parametrize(("stiffness", "damping"), [(3e4, 1000.0), (1e6, 1.0), (1e5, 300.0)])
def test_what_the_stability_error_suggests_is_accepted(stiffness, damping):
    wanted = cp.Compliance(stiffness, damping)
    settings = {"contact_points": 2, "impedance": 0.5, "timestep": 1 / 480}
    with pytest.raises(ValueError, match="not stable at a time step of") as error:
        cp.contact_parameters(wanted, 11.5, **settings)
    step, impedance = re.search(r"time step <= (\S+) s, impedance >= ([\d.]+)", str(error.value)).groups()
    cp.contact_parameters(wanted, 11.5, **{**settings, "timestep": float(step)})
    cp.contact_parameters(wanted, 11.5, **{**settings, "impedance": float(impedance)})
    if fine := re.search(r"damping <= (\S+) N", str(error.value)):
        cp.contact_parameters(cp.Compliance(stiffness, float(fine[1])), 11.5, **settings)
    least = cp.least_impedance(wanted, 11.5, contact_points=2, timestep=1 / 480)
    cp.contact_parameters(wanted, 11.5, **{**settings, "impedance": least})
    with pytest.raises(ValueError, match="not stable"):
        cp.contact_parameters(wanted, 11.5, **{**settings, "impedance": least - 1e-3})


def test_the_stability_error_names_the_simulation():
    with pytest.raises(ValueError, match=r"\(simulation 1\): damping 1000 N·s/m"):
        cp.contact_parameters(cp.Compliance(1e4, [100.0, 1000.0]), 11.5, contact_points=2, timestep=1 / 480)


@pytest.mark.parametrize(
    ("stiffness", "damping", "said"),
    [
        (0.0, 1.0, r"stiffness \[N/m\] must be positive, got 0"),
        (np.nan, 1.0, "stiffness .* got nan"),
        ("hard", 1.0, "stiffness .* got 'hard'"),
        (1e4, -1.0, "damping .* got -1"),
        (1e4, np.inf, "damping .* got inf"),
        ([1.0, 2.0], [1.0, 2.0, 3.0], "shapes do not broadcast: stiffness"),
    ],
)
def test_an_impossible_compliance_is_refused(stiffness, damping, said):
    with pytest.raises(ValueError, match=said):
        cp.Compliance(stiffness, damping)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pair": "rigth"}, "no contact pair 'rigth' in the model: it has .*right"),
        ({"compliance": cp.RIGID}, "stiffness .* must be finite"),
        ({"impedance": 1.0}, "impedance must be in"),
        ({"contact_points": 1.5}, "contact_points must be a whole number"),
        ({"friction_damping": -1.0}, "friction_damping .* must be positive"),
        ({"friction_damping": 1e4}, "friction_damping not stable"),
        ({"compliance": cp.Compliance([1e4, 2e4], 100.0)}, "for a batch, use contact_parameters"),
    ],
)
def test_a_refused_setting_leaves_the_model_as_it_was(change, said):
    model = bench.gripper()
    before = model.pair_solref.copy(), model.pair_solimp.copy(), model.pair_solreffriction.copy()
    with pytest.raises(ValueError, match=said):
        cp.set_pair_compliance(model, **{"pair": "right", "compliance": SOFT, **change})
    np.testing.assert_array_equal(before[0], model.pair_solref)
    np.testing.assert_array_equal(before[1], model.pair_solimp)
    np.testing.assert_array_equal(before[2], model.pair_solreffriction)


def test_options_that_break_the_law_are_refused():
    for flag, said in (
        (mujoco.mjtEnableBit.mjENBL_OVERRIDE, "override"),
        (mujoco.mjtEnableBit.mjENBL_DIAGEXACT, "diagexact"),
    ):
        model = bench.gripper()
        model.opt.enableflags |= int(flag)
        with pytest.raises(ValueError, match=said):
            cp.set_pair_compliance(model, "right", SOFT)
    model = bench.gripper()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    with pytest.raises(ValueError, match="discrete"):
        cp.set_pair_compliance(model, "right", SOFT)
    model = bench.gripper()
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    with pytest.raises(ValueError, match="elliptic"):
        cp.set_pair_compliance(model, "right", SOFT, friction_damping=50.0)


def test_the_inverse_weight_is_the_one_of_mujoco():
    model = bench.gripper()
    assert cp.inverse_weight(model, "right", "object") == pytest.approx(1 / bench.FINGER_MASS + 1 / 0.421)
    assert cp.inverse_weight(model, "table", "object") == pytest.approx(1 / 0.421)
    with pytest.raises(ValueError, match="fixed to the world"):
        cp.inverse_weight(model, "table", "table")


@pytest.mark.parametrize("offset", [0.0, 0.002])
@pytest.mark.parametrize("rate", [480, 960])
def test_the_force_curve_at_usual_steps_is_within_2_percent_of_a_tenth_of_a_millisecond(rate, offset):
    curves = []
    for timestep in (1 / rate, 1 / 9600):
        model = bench.gripper(timestep=timestep, offset=offset)
        comply(model, SOFT)
        curves.append(bench.closing(model))
    coarse, fine = curves
    touched = fine.max(axis=1) > 0
    assert np.sqrt(((coarse - fine)[touched] ** 2).mean()) < 0.02 * fine.max()


def test_the_default_impedance_distorts_the_touch_less_than_mujocos_own():
    curves = {}
    for impedance, timestep in ((0.02, 1 / 96000), (cp.DEFAULT_IMPEDANCE, 1 / 9600), (0.9, 1 / 9600)):
        model = bench.gripper(timestep=timestep)
        comply(model, SOFT, impedance=impedance)
        curves[impedance] = bench.closing(model, seconds=0.2)
    error = {d: np.abs(curves[d] - curves[0.02]).max() / curves[0.02].max() for d in (cp.DEFAULT_IMPEDANCE, 0.9)}
    assert error[cp.DEFAULT_IMPEDANCE] < 0.06  # measured: 4.6 %
    assert error[0.9] > 0.2  # measured: 28 %
