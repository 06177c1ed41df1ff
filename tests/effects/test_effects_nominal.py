"""What effects may take from a model ends at what the model has, for users and for the search alike."""

import json
import subprocess
import sys

import gymnasium
import mujoco
import numpy as np
import pytest
from effects_bench import GRIPPER, TIAGO, make

from tiago_mj.effects import EFFECTS, Entry, check_entries, read_effects
from tiago_mj.effects.checks import TAKEN_FROM
from tiago_mj.effects.declare import Effect, effect
from tiago_mj.effects.fields import parameter
from tiago_mj.effects.host import ScalarHost
from tiago_mj.effects.inertia import removable_inertia
from tiago_mj.effects.nominal import STOCKS, removable
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.wiring import wire

#: Fields of a model that must not fall below 0, and effects that can make them less.
LESS = {
    "servo_damping": ("actuator_biasprm", -1),
    "coulomb_friction": ("dof_frictionloss", 1),
    "viscous_friction": ("dof_damping", 1),
    "armature": ("dof_armature", 1),
    "payload": ("body_mass", 1),
    "object_size": ("geom_size", 1),
}
TWO_LINKS = """
<mujoco><worldbody><body name="upper" pos="0 0 1">
    <inertial pos="0 0 -.13" mass=".55" diaginertia=".004 .004 .0002"/><joint name="shoulder" axis="0 1 0"/>
    <body name="lower" pos="0 0 -.26">
        <inertial pos="0 0 -.12" mass=".35" diaginertia=".002 .002 .0001"/><joint name="elbow" axis="0 1 0"/>
    </body></body></worldbody>
    <actuator><position name="shoulder" joint="shoulder" kp="35" forcerange="-9 9"/>
    <position name="elbow" joint="elbow" kp="18" forcerange="-6 6"/></actuator></mujoco>
"""


@pytest.fixture(scope="module", params=[GRIPPER, TIAGO])
def core(request):
    return make(env=request.param)


def first(name):
    return next(iter(EFFECTS[name].parameters.values()))


def reached(name, core):
    """Indices of the targets that an entry without a target reaches, and what can be taken there."""
    declared, wiring = EFFECTS[name], core.wiring()
    names = wiring.targets.names(declared.targets)
    indices = [len(names) - 1] if declared.common else range(len(names))
    return {names[k]: removable(declared, core.model, wiring, k) for k in indices}


@pytest.mark.parametrize("name", EFFECTS)
def test_whatever_can_make_a_number_of_the_model_less_says_from_what_it_takes(name, core):
    """Of every effect: its lowest value leaves the model's numbers where they are or above, or it is declared."""
    wiring, p = core.wiring(), first(name)
    lows = [low for low, _ in p.bounds]
    if p.identity != 0 or min(lows) >= 0:
        assert EFFECTS[name].takes_from is None
        return
    before = {field: getattr(core.model, field).copy() for field in (field for field, _ in LESS.values())}
    data = mujoco.MjData(core.model)
    entry = Entry(name, None, {p.name: min(lows)})
    runner = Runner(ScalarHost(data), wiring, [[entry]], np.zeros)
    runner.start(core.dt, core.n_substeps, core.contact())
    fallen = {
        field for field, sign in LESS.values() if (sign * (getattr(core.model, field) - before[field]) < -1e-12).any()
    }
    runner.restore()
    for field in fallen - {"dof_frictionloss"} if name == "asymmetric_friction" else fallen:  # it adds in one direction
        assert EFFECTS[name].takes_from is not None, field
        assert LESS[name][0] == field


@pytest.mark.parametrize("name", [name for name in EFFECTS if EFFECTS[name].takes_from is not None])
def test_all_that_there_is_may_be_taken_and_no_more(name, core):
    key = first(name).name
    for target, there in reached(name, core).items():
        where = {} if EFFECTS[name].targets == "object" else {"target": target}
        check_entries(read_effects([{"name": name, **where, "parameters": {key: -there}}]), core.model, core.wiring())
        beyond = read_effects([{"name": name, **where, "parameters": {key: -1.01 * there - 1e-3}}])
        with pytest.raises(ValueError, match=rf"effect '{name}': {key} is -.*, but the model has .*: give ") as caught:
            check_entries(beyond, core.model, core.wiring())
        assert "\n" not in str(caught.value)
        said = str(caught.value).rpartition("give ")[2]
        least = 0.0 if said == "0 or more" else float(said.removeprefix("at least "))
        assert -there * (1 + 1e-9) <= least <= -0.99 * there  # what is said is taken, and nearly all that there is
        check_entries(read_effects([{"name": name, **where, "parameters": {key: least}}]), core.model, core.wiring())


def test_the_declared_stocks_are_those_that_are_known():
    assert set(STOCKS) == set(TAKEN_FROM)
    assert {d.takes_from for d in EFFECTS.values()} <= {None, *STOCKS}


def test_an_own_effect_cannot_take_from_what_its_targets_do_not_have():
    class Grease(Effect):
        takes_from = "servo_damping"
        damping = parameter("N·s/m", identity=0.0, default=1.0, bounds=(-5.0, 5.0))

        def added_damping(self, now):
            return self.damping

    with pytest.raises(ValueError, match=r"takes_from='servo_damping': with targets='joint' use frictionloss, damping"):
        effect("grease", stage="transmission", targets="joint")(Grease)
    assert "grease" not in EFFECTS


def test_entries_of_one_effect_count_together():
    """TIAGo's arm_1 has 1 N·m of friction."""
    one = {"name": "coulomb_friction", "target": "arm_1_joint", "parameters": {"force": -0.6}}
    make([one], TIAGO)
    with pytest.raises(ValueError, match=r"force is -1\.2 N·m on arm_1_joint, but the model has 1 N·m of dry friction"):
        make([one, one], TIAGO)
    make([one, one, {**one, "parameters": {"force": 0.5}}], TIAGO)


def test_what_a_diagnosis_found_is_not_questioned():
    make({"coulomb_friction": {"force": {"value": -2.0}}})


def test_many_environments_refuse_it_too():
    with pytest.raises(ValueError, match="the model has 0 N of dry friction: give 0 or more"):
        gymnasium.make_vec(f"tiago_mj/{GRIPPER}", num_envs=2, effects={"coulomb_friction": {"force": -2}})


@pytest.mark.parametrize("words", [
    ["record", "--env", GRIPPER, "--policy", "pi", "--episodes", "1", "--out", "{out}"],
    ["record", "--model", "{model}", "--policy", "random", "--episodes", "1", "--out", "{out}"],
])  # fmt: skip
def test_the_command_line_refuses_it_in_one_line(words, tmp_path):
    model = tmp_path / "two.xml"
    model.write_text(TWO_LINKS)
    effects = json.dumps({"coulomb_friction": {"force": -0.5}})
    words = [word.format(out=tmp_path / "out", model=model) for word in (*words, "--effects")]
    done = subprocess.run(
        [sys.executable, "-m", "tiago_mj.cli", *words, effects], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "but the model has 0 N" in done.stderr
    assert done.stderr.count("\n") == 1


def test_two_links_keep_a_mass_matrix_in_every_pose_whatever_their_joints_lack():
    """With the 30 % that TIAGo's joints may lack it had none where the links are stretched."""
    model = mujoco.MjModel.from_xml_string(TWO_LINKS)
    lacking = removable_inertia(model, np.arange(2))
    data, matrix = mujoco.MjData(model), np.zeros((2, 2))
    for elbow in np.linspace(-np.pi, np.pi, 91):
        data.qpos[:] = (0.4, elbow)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, matrix)
        assert np.linalg.eigvalsh(matrix - np.diag(lacking)).min() > 1e-5
    assert (lacking > 0.2 * np.array([0.0133, 0.0070])).all()


def test_no_armature_that_is_asked_for_leaves_two_links_without_inertia():
    model = mujoco.MjModel.from_xml_string(TWO_LINKS)
    wiring = wire(model, joints=("shoulder", "elbow"), actuators=("shoulder", "elbow"), interface="position")
    data = mujoco.MjData(model)
    runner = Runner(ScalarHost(data), wiring, [[Entry("armature", None, {"mass": -0.05})]], np.zeros)
    runner.start(0.01, 5)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, matrix)
    assert np.linalg.eigvalsh(matrix).min() > 0


def test_the_thinnest_object_keeps_a_width():
    core = make({"object_size": {"radius": {"value": -0.015}}}, object_width=0.02)
    core.reset(seed=0)
    np.testing.assert_allclose(core.model.geom("object").size[0], 0.1 * 0.01)
