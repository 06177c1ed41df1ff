"""Domain randomisation as each target is given it: the joint posterior, behind stand-ins that check the values."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
import types

import mujoco
import numpy as np
import pytest
from robots import ARM, JOINTS, diagnosed, effect

from tiago_mj import cli
from tiago_mj.effects.spec import Entry
from tiago_mj.export import command
from tiago_mj.export.draws import draws_of
from tiago_mj.export.found import model_path, read, resolve
from tiago_mj.export.targets.registry import TARGETS
from tiago_mj.randomisation.posterior import Block, Left, Number, Posterior, Weighed

torch = pytest.importorskip("torch", reason="the events are of torch's tensors; needs the extra 'train'")

#: A servo's stiffness and the friction of the same joint, which depend on each other.
STIFF = Entry("servo_stiffness", ("elbow",), {"factor": 0.5}, fitted=True)
RUBS = Entry("coulomb_friction", ("elbow",), {"force": 0.7}, fitted=True)
NUMBERS = (Number(0, "factor", False, 0.2, 4.0, "-"), Number(1, "force", False, 0.0, 12.0, "N·m"))
JOINT = Block((STIFF, RUBS), NUMBERS, ((0.0025, -0.0036), (-0.0036, 0.01)))  # a correlation of -0.72
HEAVY = Entry("payload", ("elbow",), {"mass": 0.4}, fitted=True)


def alone(entry, key, deviation, unit, low=None):
    return Block((entry,), (Number(0, key, False, low, None, unit),), ((deviation**2,),))


def posterior():
    late = Entry("command_delay", None, {"seconds": 0.02}, fitted=True)
    bias = Entry("encoder_bias", ("elbow",), {"offset": 0.0}, fitted=True)
    armature = Entry("armature", ("shoulder",), {"mass": 0.0}, fitted=True)
    return Posterior(
        "diagnosis/diagnosis.json",
        "",
        (Weighed(0.6, JOINT), Weighed(0.3, alone(HEAVY, "mass", 0.05, "kg", 0.0))),
        alone(late, "seconds", 0.002, "s", 0.0),
        (Left(alone(armature, "mass", 0.001, "kg·m²", -0.01), 1.0), Left(alone(bias, "offset", 0.01, "rad"), 0.4)),
    )


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """The draws, which are the same whatever is written of them."""
    return draws_of(robot(tmp_path_factory.mktemp("table")), posterior())


@pytest.fixture
def exported(tmp_path, monkeypatch, capsys, table):
    """Folder that the command wrote for a target, with what it printed."""
    folder = diagnosed(tmp_path, [effect("servo_stiffness", "elbow", factor=0.5)])
    monkeypatch.setattr(command.reading, "read", lambda path: posterior())
    monkeypatch.setattr(command, "draws_of", lambda robot, posterior: table)

    def run(to, *words):
        out = tmp_path / to
        assert cli.main(["export", str(folder), "--to", to, "--out", str(out), "--randomisation", *words]) == 0
        return out, capsys.readouterr().out

    return run


def robot(tmp_path):
    found = read(diagnosed(tmp_path, []))
    return resolve(found, model_path(found, None))


def run_python(path, monkeypatch, **modules):
    """Run a module that was written, with stand-ins for the packages that it imports."""
    for name, names in modules.items():
        module = types.ModuleType(name.replace("_", "."))
        for key, value in names.items():
            setattr(module, key, value)
        monkeypatch.setitem(sys.modules, name.replace("_", "."), module)
    names = {"__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return names


# The table ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_table_of_draws_keeps_what_goes_together(tmp_path):
    draws = draws_of(robot(tmp_path), posterior(), count=800, seed=1)
    stiffness, friction = draws.drives["stiffness"]["elbow"], draws.drives["friction"]["elbow"]
    first = stiffness != 18.0  # of the explanation that changes the servo; 4.5 behind a gear of 2 at the joint
    # Two of three draws; the standard error of 800 is 1.7 %, five of them.
    assert first.mean() == pytest.approx(2 / 3, abs=0.085)
    # Of some 530 draws with a correlation of -0.72 the standard error is (1 - 0.72²) / √530 = 0.02, five of them.
    assert np.corrcoef(stiffness[first], friction[first])[0, 1] == pytest.approx(-0.72, abs=0.1)
    assert stiffness[first].mean() == pytest.approx(9.0, abs=5 * 18 * 0.05 / np.sqrt(530))
    mass = draws.fields["body_mass"]["fore"]
    np.testing.assert_array_equal(mass[first], mass[first][0])
    assert mass[~first].std() == pytest.approx(0.05, rel=0.25)
    assert draws.lags(0.002)["rail"] == (8, 12)  # 20 ms ± 1.645 · 2 ms in steps of 2 ms


def test_a_part_that_the_model_does_not_have_is_one_line(tmp_path):
    other = Posterior(
        "made", "", (Weighed(1.0, alone(Entry("armature", ("wrist",), {"mass": 1.0}), "mass", 0.1, "kg")),)
    )
    with pytest.raises(ValueError, match=r"^effect 'armature' has target 'wrist'") as fault:
        draws_of(robot(tmp_path), other, count=1)
    assert "\n" not in str(fault.value)


# mjlab ----------------------------------------------------------------------------------------------------------------


class Term:
    def __init__(self, **given):
        self.__dict__.update(given)


def fields_needed(*fields, recompute):
    def decorated(function):
        function.model_fields, function.recompute = fields, recompute
        return function

    return decorated


def test_mjlab_events_write_one_row_of_the_table_into_each_world(exported, monkeypatch):
    out, said = exported("mjlab")
    levels = types.SimpleNamespace(none=0, set_const_0=2, set_const=3)
    manager = {"EventTermCfg": Term, "RecomputeLevel": levels, "requires_model_fields": fields_needed}
    monkeypatch.setitem(sys.modules, "mjlab", types.ModuleType("mjlab"))
    monkeypatch.setitem(sys.modules, "mjlab.managers", types.ModuleType("mjlab.managers"))
    module = types.ModuleType("mjlab.managers.event_manager")
    vars(module).update(manager)
    monkeypatch.setitem(sys.modules, "mjlab.managers.event_manager", module)
    names = run_python(out / "mjlab_events.py", monkeypatch)
    table = json.loads((out / "draws.json").read_text())
    nominal, worlds = mujoco.MjModel.from_xml_string(ARM), 200
    model = types.SimpleNamespace()
    wanted = names["simulators"].model_fields
    for field in wanted:
        value = torch.tensor(np.array(getattr(nominal, field)), dtype=torch.float32)
        setattr(model, field, value.repeat(worlds, *[1] * value.ndim))
    bodies = ("rail", "upper", "fore")
    asset = types.SimpleNamespace(
        joint_names=JOINTS,
        body_names=bodies,
        indexing=types.SimpleNamespace(
            joint_v_adr=torch.tensor([0, 1, 2]), body_ids=torch.tensor([nominal.body(name).id for name in bodies])
        ),
        actuators=[
            types.SimpleNamespace(target_names=[name], global_ctrl_ids=torch.tensor([k]))
            for k, name in enumerate(JOINTS)
        ],
    )
    env = types.SimpleNamespace(
        num_envs=worlds, device="cpu", scene={"robot": asset}, sim=types.SimpleNamespace(model=model)
    )
    term = names["EVENTS"]["simulators"]
    assert (term.mode, term.func) == ("reset", names["simulators"])
    assert names["simulators"].recompute == 3  # masses change
    torch.manual_seed(0)
    term.func(env, torch.arange(100))
    assert {"dof_frictionloss", "dof_armature", "body_mass", "actuator_gainprm", "actuator_biasprm"} <= set(wanted)
    columns = table["columns"]
    rows = zip(
        columns["stiffness"]["elbow"], columns["dof_frictionloss"]["elbow"], columns["body_mass"]["fore"], strict=True
    )
    known = {tuple(np.float32(x) for x in row) for row in rows}
    stiffness, friction, mass = (
        *(model.actuator_gainprm[:, 2, 0], model.dof_frictionloss[:, 2]),
        model.body_mass[:, nominal.body("fore").id],
    )
    assert all(tuple(row) in known for row in zip(*(x[:100].numpy() for x in (stiffness, friction, mass)), strict=True))
    torch.testing.assert_close(model.actuator_biasprm[:100, 2, 1], -stiffness[:100])
    assert len(stiffness[:100].unique()) > 20
    assert (stiffness[100:] == 4.5).all()  # of worlds that are not reset; the file's gain, before its gear
    assert "| command_delay, drawn | all | approximate | `with_delays`" in said
    assert "the correlation is lost" in said
    assert "| encoder_bias, drawn | elbow | not | no number of the robot's model" in said
    assert names["LAGS"] == dict.fromkeys(JOINTS, (8, 12))


def test_mjlab_s_own_actuators_draw_the_delays(exported, monkeypatch):
    out, _ = exported("mjlab")
    made = dataclasses.make_dataclass("Cfg", ["target_names_expr", "delay_min_lag", "delay_max_lag"])
    text = (out / "mjlab_events.py").read_text()
    begin, end = text.index("def with_delays"), text.index("\n\nEVENTS")
    names = {"dataclasses": dataclasses, "LAGS": {"elbow": (8, 12)}}
    exec(text[begin:end], names)
    rail, elbow = names["with_delays"]((made(("rail",), 10, 10), made(("elbow",), 10, 10)))
    assert (rail.delay_min_lag, rail.delay_max_lag) == (10, 10)
    assert (elbow.delay_min_lag, elbow.delay_max_lag) == (8, 12)


# Isaac Lab ------------------------------------------------------------------------------------------------------------


class Articulation:
    """Remembers what is written into the simulation, as Isaac Lab's has it."""

    device = "cpu"

    def __init__(self, worlds, kind):
        self.written = {}
        self.actuators = {"arm": kind(worlds)}
        self.mass, self.inertia = torch.ones(worlds, 3), torch.ones(worlds, 3, 9)
        self.root_physx_view = self

    def find_joints(self, names, preserve_order):
        assert preserve_order
        return [JOINTS.index(name) for name in names], names

    def find_bodies(self, names, preserve_order):
        return [("rail", "upper", "fore").index(name) for name in names], names

    def get_masses(self):
        return self.mass.clone()

    def get_inertias(self):
        return self.inertia.clone()

    def set_masses(self, values, ids):
        self.mass[ids] = values[ids]

    def set_inertias(self, values, ids):
        self.inertia[ids] = values[ids]

    def __getattr__(self, name):
        if not name.startswith("write_joint_"):
            raise AttributeError(name)

        def write(values, joint_ids, env_ids, **more):
            assert values.shape == (len(env_ids), len(joint_ids))
            self.written[name] = (values, [JOINTS[k] for k in joint_ids], more)

        return write


class ImplicitActuator:
    def __init__(self, worlds):
        self.joint_names = list(JOINTS)
        self.stiffness, self.damping, self.effort_limit = (torch.full((worlds, 3), -1.0) for _ in range(3))


class DelayedPDActuator(ImplicitActuator):
    pass


@pytest.mark.parametrize("kind", [ImplicitActuator, DelayedPDActuator])
def test_isaac_lab_s_event_writes_one_row_of_the_table_into_each_environment(kind, exported, monkeypatch):
    out, said = exported("isaaclab")
    for name, values in {
        "isaaclab": {},
        "isaaclab.managers": {"EventTermCfg": Term, "SceneEntityCfg": lambda name: types.SimpleNamespace(name=name)},
        "isaaclab.utils": {"configclass": lambda one: one},
    }.items():
        module = types.ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    names = run_python(out / "isaaclab_events.py", monkeypatch)
    asset = Articulation(60, kind)

    class Scene(dict):
        num_envs = 60

    env = types.SimpleNamespace(scene=Scene(robot=asset))
    term = names["EventCfg"].simulators
    assert (term.mode, term.func) == ("reset", names["simulators"])
    torch.manual_seed(0)
    term.func(env, torch.arange(40))
    columns = json.loads((out / "draws.json").read_text())["columns"]
    friction, joints, more = asset.written["write_joint_friction_coefficient_to_sim"]
    assert joints == ["elbow"]
    torch.testing.assert_close(more["joint_dynamic_friction_coeff"], friction)
    stiffness = asset.actuators["arm"].stiffness
    rows = zip(columns["stiffness"]["elbow"], columns["friction"]["elbow"], columns["mass"]["fore"], strict=True)
    known = {tuple(np.float32(x) for x in row) for row in rows}
    given = (stiffness[:40, 2], friction[:, 0], asset.mass[:40, 2])
    assert all(tuple(row) in known for row in zip(*(x.numpy() for x in given), strict=True))
    assert (stiffness[40:] == -1).all()
    assert (asset.mass[40:] == 1).all()
    torch.testing.assert_close(asset.inertia[:, 2, 0], asset.mass[:, 2])
    assert ("write_joint_stiffness_to_sim" in asset.written) == (kind is ImplicitActuator)
    assert "write_joint_armature_to_sim" in asset.written
    assert "| command_delay, drawn | all | approximate | `LAGS`" in said


# The others -----------------------------------------------------------------------------------------------------------


def test_playground_s_tables_are_models_that_were_drawn(exported, monkeypatch):
    out, said = exported("playground")
    jax = types.ModuleType("jax")
    jax.numpy = types.ModuleType("jax.numpy")
    jax.numpy.asarray = np.asarray
    jax.vmap = lambda function: lambda keys: np.array([function(key) for key in keys])
    jax.random = types.SimpleNamespace(randint=lambda key, shape, low, high: key % high)
    jax.tree_util = types.SimpleNamespace(tree_map=lambda function, tree: Tree())
    monkeypatch.setitem(sys.modules, "jax", jax)
    monkeypatch.setitem(sys.modules, "jax.numpy", jax.numpy)

    class Tree(dict):
        def tree_replace(self, changes):
            return Tree({**self, **changes})

    names = run_python(out / "playground_randomisation.py", monkeypatch)
    nominal = mujoco.MjModel.from_xml_string(ARM)
    model, axes = names["randomizer"](nominal)(Tree(), [3, 503])
    assert set(axes) == set(model)
    assert set(axes.values()) == {0}
    assert {"dof_frictionloss", "dof_armature", "body_mass", "actuator_gainprm", "dof_invweight0"} <= set(model)
    np.testing.assert_array_equal(model["body_mass"][0], model["body_mass"][1])  # the same row
    assert model["dof_frictionloss"].shape == (2, nominal.nv)
    columns = json.loads((out / "draws.json").read_text())["columns"]
    assert model["dof_frictionloss"][0, 2] == columns["dof_frictionloss"]["elbow"][3]
    assert model["dof_frictionloss"][0, 0] == nominal.dof_frictionloss[0]
    assert "| command_delay, drawn | all | not |" in said


def test_gymnasium_is_given_the_posterior_itself(exported):
    out, said = exported("gymnasium")
    names = {"__file__": str(out / "simulators.py")}
    exec((out / "simulators.py").read_text(), names)
    assert names["POSTERIOR"] == posterior()
    drawn = names["draw_effects"](np.random.default_rng(4))
    assert drawn == posterior().sample(np.random.default_rng(4))
    assert "| encoder_bias, drawn | elbow | exact |" in said


@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if target.randomisation is not None])
def test_written_again_without_it_nothing_is_left_of_it(name, exported, tmp_path, capsys):
    out, _ = exported(name)
    files = TARGETS[name].randomisation.files
    assert all((out / file).exists() for file in files)
    assert cli.main(["export", str(tmp_path / "diagnosis"), "--to", name, "--out", str(out)]) == 0
    assert not any((out / file).exists() for file in files)


@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if target.randomisation is None])
def test_a_target_that_cannot_hold_it_says_so(name, exported):
    out, said = exported(name)
    assert "| servo_stiffness, drawn | elbow | not | the format has one number for each" in said
    assert not (out / "draws.json").exists()
    assert "servo_stiffness, drawn" in (out / "export.md").read_text()


def test_without_a_diagnosis_beside_the_calibration_it_is_refused_in_one_line(tmp_path, capsys):
    folder = diagnosed(tmp_path, [])
    shutil.copy(folder / "calibration.yaml", tmp_path / "calibration.yaml")
    words = ["--to", "mjlab", "--randomisation", "--out", str(tmp_path / "out")]
    assert cli.main(["export", str(tmp_path / "calibration.yaml"), *words]) == 2
    assert "holds no diagnosis.json: give the folder that tiago-mj diagnose --out wrote" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
