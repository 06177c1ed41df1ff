"""A model's own files with effects: as few lines as there are effects, and the same motion."""

import difflib

import mujoco
import numpy as np
import pytest
from robots import ARM, compiled, diagnosed, effect, exported, robot

from tiago_mj.effects import EFFECTS, model_file
from tiago_mj.export import found, mjcf, replay, versions
from tiago_mj.export.holding import held, library
from tiago_mj.export.targets.mujoco import HOLDS

IN_A_FILE = [
    [effect("coulomb_friction", "elbow", force=0.7)],
    [effect("viscous_friction", "shoulder", damping=0.8), effect("armature", "elbow", mass=0.02)],
    [effect("servo_stiffness", "elbow", factor=0.6), effect("servo_damping", "shoulder", damping=1.5)],
    [effect("torque_constant", "all", factor=0.8), effect("force_limit", "shoulder", limit=2.5)],
    [effect("payload", "elbow", mass=0.4)],
    [effect("payload", "elbow", mass=0.4, x=0.12, y=0.02, z=-0.03)],
    [effect("payload", "elbow", mass=-0.1, x=0.05), effect("gravity_tilt", "all", angle=0.2)],
    [effect("command_delay", ["elbow", "rail"], seconds=0.0237)],
    [effect("joint_spring", ["elbow", "rail"], stiffness=5.0, rest=0.3, hardening=0.4)],
]


def changed_lines(before, after):
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]


def test_one_friction_is_one_line(tmp_path):
    out = exported(tmp_path, "mujoco", [effect("coulomb_friction", "elbow", force=0.7)])
    before, after = changed_lines(ARM, (out / "arm.xml").read_text())
    assert before[2:].strip() == '<joint name="elbow" class="light" axis="0 1 0" damping=".051" range="-2.3 2.2"/>'
    assert after[2:].strip() == (
        '<joint name="elbow" class="light" axis="0 1 0" damping=".051" range="-2.3 2.2" frictionloss="0.7" '
        'solreffriction="0.0005 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"/>'
    )
    diff = (out / "changes.diff").read_text()
    assert diff.startswith("--- a/arm.xml\n+++ b/arm.xml\n")
    assert len([line for line in diff.splitlines()[2:] if line[0] in "+-"]) == 2


def test_no_effect_changes_no_byte(tmp_path):
    written = mjcf.write(robot(tmp_path, []))
    assert not written.files
    assert (written.save(tmp_path / "out")).read_text() == ARM


@pytest.mark.parametrize("effects", IN_A_FILE, ids=lambda own: "+".join(one["name"] for one in own))
def test_the_file_moves_as_the_diagnosis_simulates(effects, tmp_path):
    one = robot(tmp_path, effects)
    written = mjcf.write(one)
    closing = replay.closing(one, written.compile())
    assert closing.before > 1e-4, "the effect shows"
    assert closing.after < 1e-9
    assert set(written.exact) == {own["name"] for own in effects}
    after = written.files[one.file].decode()
    assert ARM.count("<!--") == after.count("<!--")
    assert after.count("<position") == 3


def test_a_spring_beside_the_files_own_is_their_sum(tmp_path):
    text = ARM.replace('name="elbow" class="light"', 'name="elbow" class="light" stiffness="3" springref=".2"')
    one = robot(tmp_path, [effect("joint_spring", "elbow", stiffness=5.0, rest=1.0)], text)
    after = mjcf.write(one).compile()
    assert after.joint("elbow").stiffness[0] == pytest.approx(3 + 5)
    assert after.qpos_spring[after.joint("elbow").qposadr[0]] == pytest.approx((3 * 0.2 + 5 * 1.0) / 8)
    assert replay.closing(one, mjcf.write(one).compile()).after < 1e-9


def test_what_is_included_is_changed_in_its_own_file_and_meshes_come_along(tmp_path):
    begin, end = ARM.index("  <actuator>"), ARM.index("  <sensor>")
    text = ARM[:begin] + '  <include file="parts/servos.xml"/>\n' + ARM[end:]
    text = text.replace("<default>", '<asset><mesh name="m" file="w.obj"/></asset>\n  <default>', 1)
    text = text.replace('angle="radian"', 'angle="radian" meshdir="parts"')
    (tmp_path / "parts").mkdir()
    wedge = "v 0 0 0\nv .2 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "parts" / "w.obj").write_text(wedge)
    servos = f"<mujocoinclude>\n{ARM[begin:end]}</mujocoinclude>\n"
    (tmp_path / "parts" / "servos.xml").write_text(servos)
    one = robot(tmp_path, [effect("servo_stiffness", "elbow", factor=2.0)], text)
    main = mjcf.write(one).save(tmp_path / "out")
    assert main.read_text() == text
    after = (tmp_path / "out" / "parts" / "servos.xml").read_text()
    assert changed_lines(servos, after)[1].count('kp="9"') == 1
    assert compiled(main).actuator_gainprm[2, 0] == 9


def test_a_ratio_of_damping_stays_a_ratio_unless_it_would_change(tmp_path):
    text = ARM.replace('kp="35" kv="2.1"', 'kp="35" dampratio="0.7"')
    plain = mjcf.write(robot(tmp_path, [effect("coulomb_friction", "elbow", force=0.7)], text))
    assert b'dampratio="0.7"' in next(iter(plain.files.values()))
    heavier = robot(tmp_path, [effect("payload", "elbow", mass=0.4)], text)
    written = mjcf.write(heavier)
    assert b"dampratio" not in next(iter(written.files.values()))
    np.testing.assert_allclose(written.compile().actuator_biasprm, heavier.model.actuator_biasprm)
    older = mjcf.write(robot(tmp_path, [effect("coulomb_friction", "elbow", force=0.7)], text), version="3.11")
    assert b"dampratio" not in next(iter(older.files.values()))
    assert any("shoulder stands for its dampratio" in said for said in older.told)
    np.testing.assert_allclose(older.compile().actuator_biasprm, heavier.model.actuator_biasprm)


def test_a_motor_whose_words_do_not_do_is_written_as_a_general_actuator(tmp_path):
    short = '<position name="shoulder" joint="shoulder" kp="35" kv="2.1"'
    text = ARM.replace(short, '<motor name="shoulder" joint="shoulder"')
    effects = [effect("torque_constant", "shoulder", factor=0.8)]
    one = robot(tmp_path, effects, text, actuators=["shoulder"], interface="effort")
    after = next(iter(mjcf.write(one).files.values())).decode()
    assert '<general name="shoulder" joint="shoulder" ctrlrange="-1.2 1.2" gainprm="0.8"/>' in after


@pytest.mark.parametrize("name", library())
def test_the_table_says_exact_of_what_a_model_file_holds(name, tmp_path):
    one = robot(tmp_path, [])
    declared = EFFECTS[name]
    target = {"joint": ("elbow",), "command": ("elbow",)}.get(declared.targets)
    values = {key: p.default[1] * (10.0 if p.nominal else 1.0) for key, p in declared.parameters.items()}
    if declared.targets == "sensor" or declared.stage == "contact":  # of what this robot has not
        assert held(HOLDS, name).grade == "not"
        return
    entry = found.Entry(name, target, values, fitted=True)
    holds = model_file.holds(one.model, one.wiring, [entry], 0.01, 5)
    if EFFECTS[name].reaches_carrier:  # a constraint of MuJoCo's, where ours is a force
        assert (held(HOLDS, name).grade, holds) == ("approximate", True)
    else:
        assert (held(HOLDS, name).grade == "exact") == holds


def test_what_no_file_holds_is_told(tmp_path, capsys):
    effects = [effect("velocity_limit", "elbow", velocity=1.0), effect("payload", "elbow", mass=0.3)]
    exported(tmp_path, "mujoco", effects)
    said = capsys.readouterr().out
    assert "| velocity_limit | elbow | not | MuJoCo has no limit of a joint's speed |" in said
    assert "| payload | elbow | exact |" in said
    assert "% of the gap" in said


def test_a_delay_shorter_than_a_step_is_told_as_not_held(tmp_path, capsys):
    exported(tmp_path, "mujoco", [effect("command_delay", "all", seconds=0.0011)])
    assert "| command_delay | all | not | not with these numbers on this robot" in capsys.readouterr().out


def test_a_joint_that_is_not_written_out_is_said_in_one_line(tmp_path):
    text = ARM.replace('<body name="fore"', '<replicate count="1" sep="x"><body name="fore"')
    text = text.replace('mass=".3"/>\n        </body>', 'mass=".3"/>\n        </body></replicate>')
    text = text.replace('joint="elbow"', 'joint="elbowx0"')
    names = ["rail", "shoulder", "elbowx0"]
    effects = [effect("coulomb_friction", "elbowx0", force=0.7)]
    one = robot(tmp_path, effects, text, joints=names, actuators=["rail", "shoulder", "elbow"])
    with pytest.raises(ValueError, match="joint 'elbowx0' is not written out") as fault:
        mjcf.write(one)
    assert "\n" not in str(fault.value)


def test_what_an_older_version_does_not_know_is_said_in_one_line(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM.replace("<position", "<pid").replace("kv=", "kd="))
    versions.check(tmp_path / "arm.xml", "3.17")
    with pytest.raises(ValueError, match=r"<pid>, which MuJoCo 3.11 does not know"):
        versions.check(tmp_path / "arm.xml", "3.11")


def test_a_repaired_model_is_refused(tmp_path):
    text = ARM.replace("</mujoco>", '<custom><text name="tiago_mj_repaired" data="x"/></custom></mujoco>')
    with pytest.raises(ValueError, match="has the effects already"):
        robot(tmp_path, [], text)


def test_the_folder_that_was_written_is_read_back_with_the_same_numbers(tmp_path):
    effects = [effect("coulomb_friction", "elbow", force=0.7), effect("force_limit", "shoulder", limit=2.5)]
    out = exported(tmp_path, "mujoco", effects)
    model = compiled(out / "arm.xml")
    one = robot(tmp_path, effects)
    period = one.substeps * one.model.opt.timestep
    wanted = model_file.changed(one.model, one.wiring, one.entries, period, one.substeps).now.host.model
    for field in sorted(model_file.HELD - {model_file.GRAVITY}):
        np.testing.assert_allclose(getattr(model, field), getattr(wanted, field), rtol=1e-13, atol=0)
    assert diagnosed(tmp_path, effects).is_dir()
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "elbow") == 2
