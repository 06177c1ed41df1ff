"""Every effect keeps the contract: names, units, exact absence, same answer from one simulation and from many."""

import json
import re

import gymnasium
import numpy as np
import pytest
from effects_bench import (
    GRIPPER,
    QUIET,
    TIAGO,
    batch_rollout,
    gripper_actions,
    gripper_positions,
    make,
    rollout,
    tiago_actions,
)

from tiago_mj.effects import EFFECTS, Entry, read_effects

INF = np.inf
LENGTH, SPEED = ("m", "rad"), ("m/s", "rad/s")
FORCE, DAMPING = ("N", "N·m"), ("N·s/m", "N·m·s/rad")
UNITS = "sensor units"

#: name: (target, class, {parameter: (unit, identity, default)}). Pairs: on a sliding joint, on a hinge. The limits'
#: defaults are shares of the nominal ones.
CONTRACT = {
    "command_delay": ("command", "delay", {"seconds": ("s", 0, 0.03)}),
    "clock_offset": ("clock", "delay", {"seconds": ("s", 0, 0.03)}),
    "clock_skew": ("clock", None, {"rate": ("-", 0, 0.005)}),
    "dropped_commands": ("command", None, {"probability": ("-", 0, 0.1)}),
    "command_lag": ("command", "lag", {"time_constant": ("s", 0, 0.04)}),
    "rate_limit": ("command", None, {"velocity": (SPEED, INF, 0.6)}),
    "command_deadband": ("command", None, {"width": (LENGTH, 0, 0.0003), "period": ("s", None, 0.0)}),
    "command_quantization": ("command", None, {"step": (LENGTH, 0, 0.0005), "period": ("s", None, 0.0)}),
    "servo_stiffness": ("command", "gain", {"factor": ("-", 1, 0.6)}),
    "servo_damping": ("command", "damping", {"damping": (DAMPING, 0, (40, 5))}),
    "force_limit": ("command", None, {"limit": (FORCE, INF, 0.4)}),
    "velocity_limit": ("joint", None, {"velocity": (SPEED, INF, 0.5)}),
    "torque_constant": ("command", "gain", {"factor": ("-", 1, 0.8)}),
    "motor_cogging": ("joint", None, {"amplitude": (FORCE, 0, 1.0), "period": (LENGTH, None, 0.005)}),
    "coulomb_friction": ("joint", "friction", {"force": (FORCE, 0, 3)}),
    "viscous_friction": ("joint", "damping", {"damping": (DAMPING, 0, (40, 5))}),
    "stribeck_friction": ("joint", "friction", {"static": (FORCE, 0, 3), "velocity": (SPEED, None, 0.01)}),
    "load_dependent_friction": ("joint", "friction", {"coefficient": ("-", 0, 0.15)}),
    "asymmetric_friction": ("joint", None, {"force": (FORCE, 0, 2)}),
    "torque_offset": ("joint", None, {"force": (FORCE, 0, 1)}),
    "coupled_motor_friction": ("joint", None, {"force": (FORCE, 0, 2)}),
    "coupled_motor_damping": ("joint", None, {"damping": (DAMPING, 0, (10, 1))}),
    "backlash": ("joint", "play", {"width": (LENGTH, 0, 0.001)}),
    "joint_elasticity": ("joint", "gain", {"stiffness": (("N/m", "N·m/rad"), INF, 3000)}),
    "joint_spring": ("joint", None, {"stiffness": (("N/m", "N·m/rad"), 0, (100, 1))}),
    "armature": ("joint", None, {"mass": (("kg", "kg·m²"), 0, 0.3)}),
    "coupling_error": ("joint", None, {"ratio": ("-", 0, 0.1)}),
    "payload": ("joint", None, {"mass": ("kg", 0, 0.5)}),
    "compliant_mount": (
        "joint",
        None,
        {"compliance": ("rad/(N·m)", 0, 0.0005), "frequency": ("Hz", None, 8.0)},
    ),
    "link_mass": ("joint", None, {"factor": ("-", 1, 1.1)}),
    "link_centre_x": ("joint", None, {"offset": ("m", 0, 0.01)}),
    "link_centre_y": ("joint", None, {"offset": ("m", 0, 0.01)}),
    "link_centre_z": ("joint", None, {"offset": ("m", 0, 0.01)}),
    "gravity_tilt": ("object", None, {"angle": ("rad", 0, 0.1)}),
    "contact_stiffness": ("object", None, {"factor": ("-", 1, 0.3)}),
    "contact_damping": ("object", None, {"factor": ("-", 1, 4)}),
    "contact_inertia": ("object", None, {"factor": ("-", 1, 0.5)}),
    "contact_friction": ("object", None, {"factor": ("-", 1, 0.3)}),
    "object_size": ("object", "geometry", {"radius": ("m", 0, 0.003)}),
    "object_offset": ("object", "geometry", {"distance": ("m", 0, 0.005)}),
    "object_mass": ("object", None, {"factor": ("-", 1, 2)}),
    "pad_creep": ("sensor", None, {"fraction": ("-", 0, 0.2), "time_constant": ("s", None, 0.3)}),
    "encoder_bias": ("joint", None, {"offset": (LENGTH, 0, 0.001)}),
    "encoder_scale": ("joint", None, {"factor": ("-", 1, 1.05)}),
    "encoder_quantization": ("joint", None, {"step": (LENGTH, 0, 0.0005)}),
    "velocity_filter": ("joint", None, {"time_constant": ("s", 0, 0.04)}),
    "force_bias": ("sensor", None, {"offset": (UNITS, 0, 0.1)}),
    "force_gain": ("sensor", "gain", {"factor": ("-", 1, 1.3)}),
    "force_nonlinearity": ("sensor", None, {"quadratic": ("1/sensor unit", 0, 0.1)}),
    "force_drift": ("sensor", None, {"rate": ("sensor units/s", 0, 0.1)}),
    "force_lag": ("sensor", "lag of force", {"time_constant": ("s", 0, 0.03)}),
    "force_delay": ("sensor", "lag of force", {"seconds": ("s", 0, 0.03)}),
    "force_hysteresis": ("sensor", None, {"width": (UNITS, 0, 0.1)}),
    "force_crosstalk": ("sensor", None, {"ratio": ("-", 0, 0.1)}),
    "force_saturation": ("sensor", None, {"limit": (UNITS, INF, 0.8)}),
    "force_dead_zone": ("sensor", None, {"width": (UNITS, 0, 0.08)}),
    "force_quantization": ("sensor", None, {"step": (UNITS, 0, 0.05)}),
    "force_noise": ("sensor", None, {"factor": ("-", 1, 3)}),
    "force_dropout": ("sensor", None, {"probability": ("-", 0, 0.05)}),
}
RELATIVE = {"rate_limit": "velocity", "velocity_limit": "velocity", "force_limit": "effort"}

#: What these motions cannot show: the gripper alone stands on a base that does not move, no finger carries the other
#: one, and none turns.
INVISIBLE = {
    (name, "gripper")
    for name in ("payload", "coupled_motor_friction", "coupled_motor_damping", *(f"link_centre_{k}" for k in "xyz"))
}

#: Until a little after the fingers have begun to open again [s].
OPENS = 0.75

SETUPS = {
    "gripper": (GRIPPER, {}, gripper_actions(OPENS)),
    "gripper, ideal servo": (GRIPPER, {"servo": "ideal"}, gripper_actions(OPENS)),
    "gripper by position": (GRIPPER, {"control": "position"}, gripper_positions(OPENS)),
    "gripper by position, ideal servo, 25 Hz": (
        GRIPPER,
        {"control": "position", "servo": "ideal", "control_hz": 25.0},
        gripper_positions(hz=25),
    ),
    "tiago": (TIAGO, {}, tiago_actions(0.85)),
}


def identity(name):
    return {p.name: p.default[0] if p.identity is None else p.identity for p in EFFECTS[name].parameters.values()}


def pair(value):
    return value if isinstance(value, tuple) else (value, value)


def test_the_dictionary_holds_exactly_the_effects_of_the_contract():
    assert set(EFFECTS) == set(CONTRACT)


@pytest.mark.parametrize("name", CONTRACT)
def test_target_class_units_identity_and_default_are_the_contracts(name):
    targets, gap_class, parameters = CONTRACT[name]
    declared = EFFECTS[name]
    assert (declared.targets, declared.gap_class) == (targets, gap_class or name)
    assert set(declared.parameters) == set(parameters)
    for key, (unit, absent, default) in parameters.items():
        p = declared.parameters[key]
        assert (p.unit, p.identity, p.default) == (pair(unit), absent, pair(default))
        assert p.nominal == RELATIVE.get(name)
        for (low, high), value in zip(p.bounds, p.default, strict=True):
            assert low < high
            assert low <= value <= high


def together(names, size):
    """Effects in groups of so many, each of neighbours that are far apart in the chain."""
    names = list(names)
    count = -(-len(names) // size)
    return [names[k::count] for k in range(count)]


@pytest.mark.parametrize("setup", SETUPS)
def test_at_its_identity_every_effect_leaves_every_bit_as_it_was(setup):
    env, arguments, actions = SETUPS[setup]
    nominal = rollout(None, actions, env, **arguments)
    for names in together(EFFECTS, 4):
        absent = rollout({name: identity(name) for name in names}, actions, env, **arguments)
        for column in ("state", "position", "velocity", "force", "reading"):
            np.testing.assert_array_equal(getattr(absent, column), getattr(nominal, column), err_msg=str(names))


@pytest.mark.parametrize("setup", SETUPS)
def test_at_its_default_every_effect_is_seen_and_nothing_diverges(setup):
    env, arguments, actions = SETUPS[setup]
    nominal = rollout(None, actions, env, **arguments)
    for name in EFFECTS:
        # The commands change at four instants only: with the default 0.1 as likely as not none of those is lost.
        magnitude = {"probability": 0.6} if name == "dropped_commands" else {}
        other = rollout({name: magnitude}, actions, env, **arguments)
        assert np.isfinite(other.state).all(), name
        assert np.isfinite(other.reading).all(), name
        # Twice the fastest that is commanded on the fingers; the joint range and a contact's give.
        assert np.abs(other.true_velocity[:, -2:]).max() < 0.16, name
        assert (other.true_position[:, -2:] > -0.002).all(), name
        assert (other.true_position[:, -2:] < 0.047).all(), name
        seen = [
            np.abs(getattr(other, c) - getattr(nominal, c)).max() for c in ("position", "velocity", "reading", "force")
        ]
        hidden = any(name == unseen and setup.startswith(where) for unseen, where in INVISIBLE)
        assert (max(seen) == 0) if hidden else (max(seen) > 1e-5), name


def _tried(values):
    """As a diagnosis gives them: a user's would be refused where the model has less to take away."""
    return {key: {"value": value} for key, value in values.items()}


@pytest.mark.parametrize("end", [0, 1])
def test_no_value_that_a_fit_may_try_makes_the_gripper_diverge(end):
    for name, declared in EFFECTS.items():
        values = {p.name: p.bounds[0][end] for p in declared.parameters.values()}
        if name in RELATIVE:
            values = {key: value * (0.08 if RELATIVE[name] == "velocity" else 16) for key, value in values.items()}
        r = rollout({name: _tried(values)}, gripper_actions(), sensing=QUIET)
        assert np.isfinite(r.state).all(), name
        assert np.abs(r.true_velocity).max() < 0.2, name
        assert r.force.max() < 60, name


JUMPS = ("command_deadband", "command_quantization")


@pytest.mark.parametrize("end", [0, 1])
def test_no_value_that_a_fit_may_try_makes_the_arm_diverge(end):
    arm = [f"arm_{k}_joint" for k in range(1, 8)]
    actions = tiago_actions(seconds=0.6)
    for name, declared in EFFECTS.items():
        values = {p.name: p.bounds[1][end] for p in declared.parameters.values()}
        if name in RELATIVE:  # of the arm's slowest and weakest joint
            values = {key: value * (1.76 if RELATIVE[name] == "velocity" else 3) for key, value in values.items()}
        target = arm if declared.targets in ("joint", "command") and not declared.common else "all"
        r = rollout([{"name": name, "target": target, "parameters": _tried(values)}], actions, TIAGO)
        assert np.isfinite(r.state).all(), name
        # 0.2 rad/s are commanded. A wrist of 0.5 g·m² that 10 N·m or a spring push, or of friction let go, leaps at
        # some rad/s; an arm falls through a play of 0.1 rad or onto a spring of 1 N·m/rad, and goes by jumps on a grid.
        leaps = dict.fromkeys(("asymmetric_friction", "torque_offset", "joint_spring"), 10)
        falls = {**leaps, "backlash": 3, "joint_elasticity": 3, **dict.fromkeys(JUMPS, 5)}
        assert np.abs(r.true_velocity[:, 1:8]).max() < falls.get(name, 1), name


#: What can be less than nominal, or point the other way; all else is a size, a time, a share or a factor.
SIGNED = {
    "clock_skew", "servo_damping", "coulomb_friction", "viscous_friction", "asymmetric_friction", "armature",
    "coupling_error", "torque_offset", "link_centre_x", "link_centre_y", "link_centre_z", "payload", "gravity_tilt",
    "object_size", "object_offset", "encoder_bias",
    "force_bias", "force_nonlinearity", "force_drift", "force_crosstalk",
}  # fmt: skip


@pytest.mark.parametrize("name", CONTRACT)
def test_a_fit_tries_only_what_is_possible(name):
    for p in EFFECTS[name].parameters.values():
        for low, high in p.bounds:
            assert (low < 0) == (name in SIGNED)
            if p.identity is None and p.tried:
                assert low >= 0  # 0 is another form
                assert all(low <= value <= high for value in p.tried)
            elif p.identity == 1 or p.identity is None or np.isinf(p.identity):
                assert low > 0  # factors, limits, and what a switch needs beside it
            if p.name in ("probability", "fraction"):
                assert high < 1
            if p.nominal is not None:
                assert high <= 1  # beyond the nominal limit it would not be seen


def broadcasting(seed):
    """Uniform numbers that are the same for every simulation of a batch, and for a single one."""
    rng = np.random.default_rng(seed)
    return lambda shape: np.broadcast_to(rng.random((1, *shape[1:])), shape)


@pytest.mark.parametrize("setup", SETUPS)
def test_one_simulation_and_a_batch_of_many_agree_to_the_last_bit(setup):
    env, arguments, actions = SETUPS[setup]
    alone = ("dropped_commands", "force_dropout")
    sims = [{name: {} for name in names} for names in together([name for name in EFFECTS if name not in alone], 3)]
    sims += [{"velocity_limit": {}}, {"velocity_limit": {}, "payload": {}, "armature": {}, "link_mass": {}}]
    sims += [None, {"dropped_commands": {}, "coulomb_friction": {}, "object_size": {}, "force_lag": {}}]
    states, positions, velocities, readings = batch_rollout(sims, actions, env, uniform=broadcasting(1), **arguments)
    for k, sim in enumerate(sims):

        def draw_alike(core):
            core._runner.chain.now.uniform = broadcasting(1)

        one = rollout(sim, actions, env, prepare=draw_alike, sensing=QUIET, **arguments)
        np.testing.assert_array_equal(states[:, k], one.state, err_msg=str(sim))
        np.testing.assert_array_equal(positions[:, k], one.position, err_msg=str(sim))
        np.testing.assert_array_equal(velocities[:, k], one.velocity, err_msg=str(sim))
        np.testing.assert_array_equal(readings[:, k], one.reading, err_msg=str(sim))


def model_numbers(core):
    fields = [name for name in dir(core.model) if isinstance(getattr(core.model, name), np.ndarray)]
    numbers = {name: np.array(getattr(core.model, name)) for name in fields}
    return numbers | {"gravity": core.model.opt.gravity.copy(), "timestep": np.array(core.model.opt.timestep)}


@pytest.mark.parametrize("env", [GRIPPER, TIAGO])
def test_nothing_of_an_effect_or_an_object_remains_in_the_model_after_another_reset(env):
    drawn = {"object": ["cylinder", "box_soft"], "object_mass": (0.1, 1.0), "object_width": (0.03, 0.05)}
    everything = {name: {} for name in EFFECTS}
    core, plain = make(everything, env, **drawn), make(None, env, **drawn)
    for seed in (1, 2, 3):
        core.reset(seed=seed)
        plain.reset(seed=seed)
        for _ in range(20):
            core.step(np.zeros(core.action_space.shape))
        core.make_nominal()
        nominal, restored = model_numbers(plain), model_numbers(core)
        for name, value in nominal.items():
            np.testing.assert_array_equal(restored[name], value, err_msg=f"{name}, seed {seed}")


def test_an_episode_does_not_remember_the_one_before():
    everything = {name: {} for name in EFFECTS if name not in ("payload",)}
    core = make(everything, object_mass=(0.1, 1.0))
    fresh = make(everything, object_mass=(0.1, 1.0))
    core.reset(seed=1)
    for action in gripper_actions():
        core.step(action)
    for one in (core, fresh):
        one.reset(seed=5)
    for action in gripper_actions():
        a, b = core.step(action)[0], fresh.step(action)[0]
        np.testing.assert_array_equal(a["observation"], b["observation"])


def test_two_environments_in_one_process_do_not_share_their_effects():
    actions = gripper_actions()
    alone = rollout({"coulomb_friction": {}, "clock_skew": {}}, actions)
    nominal = rollout(None, actions)
    one, two = make({"coulomb_friction": {}, "clock_skew": {}}), make(None)
    one.reset(seed=0)
    two.reset(seed=0)
    for k, action in enumerate(actions, start=1):
        one.step(action)
        two.step(action)
        np.testing.assert_array_equal(one.state.position, alone.position[k])
        np.testing.assert_array_equal(two.state.position, nominal.position[k])


@pytest.mark.parametrize("env", ["TIAGoReach-v0", "GripperClose-v0", "TIAGoPALGripper-v0"])
def test_environments_without_object_or_load_cells_take_every_effect(env):
    core = make({name: {} for name in EFFECTS}, env)
    core.reset(seed=0)
    for _ in range(5):
        core.step(np.zeros(core.action_space.shape))
    assert np.isfinite(core.data.qpos).all()


# Forms of effects= ---------------------------------------------------------------------------------------------------

LEFT_FINGER = "gripper_left_finger_joint"
FORMS = [
    {"name": "coulomb_friction", "target": LEFT_FINGER, "parameters": {"force": 2.5}},
    {"name": "force_lag"},
]


def calibration(effects, schema="tiago_mj.calibration/1"):
    return {"schema": schema, "robot": "tiago_mj/GripperTactile-v0", "effects": effects, "source": {"file": "d.json"}}


def test_every_form_of_writing_effects_means_the_same(tmp_path):
    forces = {"force": {"value": 2.5, "low": 2.1, "high": 2.9}}
    yaml = tmp_path / "calibration.yaml"
    yaml.write_text(json.dumps(calibration([{**FORMS[0], "parameters": forces}, FORMS[1]])))
    forms = [
        FORMS,
        json.dumps(FORMS),
        [Entry("coulomb_friction", (LEFT_FINGER,), {"force": 2.5}), Entry("force_lag")],
        [{**FORMS[0], "target": [LEFT_FINGER]}, {**FORMS[1], "target": "all", "parameters": {"time_constant": 0.03}}],
        str(yaml),
        yaml,
    ]
    first = rollout(forms[0], gripper_actions())
    for form in forms[1:]:
        np.testing.assert_array_equal(rollout(form, gripper_actions()).state, first.state)
        np.testing.assert_array_equal(rollout(form, gripper_actions()).reading, first.reading)


def test_the_short_form_reaches_all_targets_and_takes_the_defaults():
    short = rollout({"coulomb_friction": {}, "force_gain": {"factor": 1.1}}, gripper_actions())
    long = rollout(
        [
            {"name": "coulomb_friction", "target": "all", "parameters": {"force": 3.0}},
            {"name": "force_gain", "target": ["right", "left"], "parameters": {"factor": 1.1}},
        ],
        gripper_actions(),
    )
    np.testing.assert_array_equal(short.state, long.state)
    np.testing.assert_array_equal(short.reading, long.reading)


def test_an_entry_on_one_finger_leaves_the_other_as_it_was():
    action = np.tile([-0.5, -0.5], (60, 1))  # free motion
    nominal = rollout(None, action)
    one = rollout([{"name": "viscous_friction", "target": LEFT_FINGER}], action)
    np.testing.assert_array_equal(one.position[:, 0], nominal.position[:, 0])
    assert one.position[-1, 1] - nominal.position[-1, 1] > 1e-4


def test_relative_defaults_are_shares_of_the_targets_own_limit():
    blocked = np.tile([-1.0, -1.0], (300, 1))
    r = rollout({"force_limit": {}}, blocked, object_offset=0.0)
    assert r.force[-1] == pytest.approx(0.4 * 16, rel=0.01)


BAD = {
    "nearly an effect": (
        {"back_lash": {}},
        r"effect 'back_lash' is unknown: did you mean 'backlash'\? \(all are in docs",
    ),
    "beginning of one": ({"coulomb": {}}, r"effect 'coulomb' is unknown: did you mean 'coulomb_friction'\?"),
    "unknown effect": ({"ghosts": {}}, r"effect 'ghosts' is unknown: all are in docs/effects.md and in tiago_mj.eff"),
    "nearly a parameter": ({"backlash": {"widht": 1e-3}}, r"no parameter 'widht': did you mean 'width'\?"),
    "no fraction": ({"pad_creep": {"fraction": 5}}, r"fraction is 5, give a number from 0 to 1"),
    "a clock that stands": ({"clock_skew": {"rate": -1}}, r"rate is -1, give a number from -0.9 to 9"),
    "unknown parameter": ({"force_lag": {"tau": 1}}, r"'force_lag' has no parameter 'tau': use time_constant"),
    "unknown key": ([{"name": "force_lag", "where": "right"}], r"unknown key 'where'"),
    "no name": ([{"target": "right"}], r"has no name"),
    "NaN": ({"force_lag": {"time_constant": float("nan")}}, r"time_constant is nan"),
    "infinite": ({"coulomb_friction": {"force": INF}}, r"force is inf, give a finite number"),
    "text": ({"force_lag": {"time_constant": "30 ms"}}, r"time_constant is '30 ms', give a number"),
    "null": ({"force_lag": {"time_constant": None}}, r"time_constant is None"),
    "no mapping": ({"force_lag": 0.03}, r"parameters 0.03: give a mapping"),
    "negative time": ({"force_lag": {"time_constant": -0.1}}, r"time_constant is -0.1, give a number of at least 0"),
    "impossible factor": ({"servo_stiffness": {"factor": 0}}, r"factor is 0, give a number above 0"),
    "probability": ({"dropped_commands": {"probability": 1.5}}, r"probability is 1.5, give a number from 0 to 1"),
    "unknown target": ([{"name": "force_lag", "target": "middle"}], r"target 'middle'.*right, left"),
    "wrong kind of target": ([{"name": "force_lag", "target": LEFT_FINGER}], r"sensor targets are right, left"),
    "target of no use": ([{"name": "force_lag", "target": 3}], r"target 3: give a name, a list of names, or 'all'"),
    "neither": (7, r"effects are int: give a list"),
    "broken JSON": ('[{"name": ', r"no valid JSON"),
    "missing file": ("nowhere.yaml", r"no calibration file 'nowhere.yaml'"),
    "wrong schema": (calibration([], schema="tiago_mj.diagnosis/1"), r"schema 'tiago_mj.diagnosis/1'.*calibration/1"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_refused_in_one_clear_line(case):
    effects, says = BAD[case]
    with pytest.raises(ValueError, match=says) as caught:
        gymnasium.make(f"tiago_mj/{GRIPPER}", effects=effects)
    assert "\n" not in str(caught.value)


SLIPS = {
    "millimetres for metres": ({"backlash": {"width": 0.5}}, "is 0.5 m, where 1 mm is typical and 60 mm the most"),
    "and in any unit": ({"backlash": {"width": 5}}, r"did you mean 5 mm \(0.005\) or 5° \(0.0873\)\?"),
    "milliseconds for seconds": ({"command_delay": {"seconds": 30}}, r"30 s, .*: did you mean 30 ms \(0.03\)\?"),
    "grams for kilograms": ({"payload": {"mass": 500}}, r"did you mean 500 g \(0.5\)\?"),
    "beyond all robots": ({"coulomb_friction": {"force": 1e6}}, r"1e\+06 N or 1e\+06 N·m, where 3 N or 3 N·m is"),
}


@pytest.mark.parametrize("case", SLIPS)
def test_a_magnitude_that_cannot_be_meant_is_refused_with_the_likely_slip(case):
    effects, says = SLIPS[case]
    with pytest.raises(ValueError, match=says) as caught:
        gymnasium.make("tiago_mj/GripperTactile-v0", effects=effects)
    assert "\n" not in str(caught.value)


LARGE = {
    "coulomb_friction": {"force": 15},
    "armature": {"mass": 3},
    "payload": {"mass": 5},
    "force_bias": {"offset": 50},
}


def test_what_large_robots_have_and_what_a_diagnosis_found_is_taken():
    assert len(read_effects(LARGE)) == len(LARGE)
    fitted = {"name": "coulomb_friction", "parameters": {"force": {"value": 900, "low": 880, "high": 920}}}
    assert read_effects([fitted])[0].parameters == {"force": 900}


def test_a_file_that_is_no_yaml_is_refused_in_one_clear_line(tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text("effects: [a: b: c\n\t")
    with pytest.raises(ValueError, match=re.escape("calibration.yaml is no valid YAML")) as caught:
        read_effects(str(path))
    assert "\n" not in str(caught.value)
