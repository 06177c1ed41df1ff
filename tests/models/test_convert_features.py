"""What a user's own URDF keeps and gains: meshes, frames, mimic joints, limits, servos."""

import json
from argparse import ArgumentParser

import mujoco
import numpy as np
import pytest
import trimesh
from broken_urdfs import INERTIAL, LIMIT, joint, link, robot

from tiago_mj.cli import convert as declared
from tiago_mj.models.convert import Options, command, convert
from tiago_mj.models.limits import joint_limits


def write(folder, *elements):
    path = folder / "robot.urdf"
    path.write_text(robot(*elements))
    return path


def mesh_link(name: str, address: str, scale: str = "", kind: str = "visual") -> str:
    return link(name, f'{INERTIAL}<{kind}><geometry><mesh filename="{address}" {scale}/></geometry></{kind}>')


@pytest.mark.parametrize("ending", ["stl", "obj", "dae", "ply"])
@pytest.mark.parametrize(
    "address", ["package://my_robot/meshes/part.{}", "meshes/part.{}", "model://my_robot/meshes/part.{}"]
)
def test_meshes_of_every_format_and_address_are_read(ending, address, tmp_path):
    package = tmp_path / "my_robot"
    (package / "meshes").mkdir(parents=True)
    trimesh.creation.box([0.1, 0.2, 0.3]).export(package / "meshes" / f"part.{ending}")
    path = write(package, mesh_link("base", address.format(ending), 'scale="2 2 1"', "collision"))
    report = convert(path, tmp_path / "out.xml")
    (fit,) = report.fitted
    assert (fit.link, fit.kind) == ("base", "box")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    np.testing.assert_allclose(sorted(model.geom("base_collision").size), [0.1, 0.15, 0.2], atol=1e-4)


def test_a_dae_in_millimetres_is_read_in_metres(tmp_path):
    part = tmp_path / "part.dae"
    trimesh.creation.box([100, 200, 300]).export(part)
    text = part.read_text()
    assert "<unit" not in text
    part.write_text(text.replace("<asset>", '<asset><unit name="millimeter" meter="0.001"/>', 1))
    model = convert(write(tmp_path, mesh_link("base", "part.dae", kind="collision"))).spec.compile()
    np.testing.assert_allclose(sorted(model.geom("base_collision").size), [0.05, 0.1, 0.15], atol=1e-4)


def test_packages_are_found_by_argument_and_by_environment(tmp_path, monkeypatch):
    (tmp_path / "elsewhere" / "my_robot").mkdir(parents=True)
    (tmp_path / "robots").mkdir()
    trimesh.creation.icosphere(radius=0.1).export(tmp_path / "elsewhere" / "my_robot" / "ball.stl")
    path = write(tmp_path / "robots", mesh_link("base", "package://my_robot/ball.stl"))
    assert convert(path, options=Options(package_paths=(tmp_path / "elsewhere",))).spec.compile().nmesh == 1
    assert (
        convert(path, options=Options(package_paths=(tmp_path / "elsewhere" / "my_robot",))).spec.compile().nmesh == 1
    )
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path / 'elsewhere'}")
    assert convert(path).spec.compile().nmesh == 1


def test_a_broken_or_unknown_mesh_is_one_line(tmp_path):
    (tmp_path / "part.stl").write_text("not a mesh")
    (tmp_path / "part.step").write_text("ISO-10303")
    for address in ("part.stl", "part.step"):
        with pytest.raises(ValueError, match=address) as caught:
            convert(write(tmp_path, mesh_link("base", address)))
        assert "\n" not in str(caught.value)
        assert ":2:" in str(caught.value)


def test_meshes_are_written_beside_the_file_and_the_pair_can_move(tmp_path):
    trimesh.creation.icosphere(radius=0.1).export(tmp_path / "ball.stl")
    path = write(tmp_path, mesh_link("base", "ball.stl", 'scale="1 1 -1"'))
    (tmp_path / "first").mkdir()
    for _ in range(2):  # the second time over what is there
        convert(path, tmp_path / "first" / "robot.xml", options=Options(collision="mesh", scene=False))
    assert sorted(p.name for p in (tmp_path / "first").iterdir()) == ["robot.xml", "robot_meshes"]
    (tmp_path / "first").rename(tmp_path / "second")
    (tmp_path / "ball.stl").unlink()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "second" / "robot.xml"))
    assert model.nmesh == 1
    assert model.geom_group.tolist() == [2]


def test_fixed_frames_stay_as_sites_and_fixed_links_as_bodies(tmp_path):
    place = '<origin xyz="0.1 0.2 0.3" rpy="0 0 1.5"/>'
    path = write(
        tmp_path,
        link("base"),
        link("arm"),
        link("camera"),
        link("optical_frame", ""),
        joint("elbow", "base", "arm", place + LIMIT),
        joint("mount", "arm", "camera", place, "fixed"),
        joint("optical", "camera", "optical_frame", place, "fixed"),
    )
    model = convert(path).spec.compile()
    assert [model.body(i).name for i in range(model.nbody)] == ["world", "base", "arm", "camera"]
    np.testing.assert_allclose(model.site("optical_frame").pos, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(model.site("optical_frame").quat, [np.cos(0.75), 0, 0, np.sin(0.75)])


def test_mimic_joints_follow(tmp_path):
    path = write(
        tmp_path,
        link("base"),
        link("a"),
        link("b"),
        joint("first", "base", "a", f'<axis xyz="0 0 1"/>{LIMIT}'),
        joint(
            "second", "base", "b", f'<axis xyz="0 0 1"/>{LIMIT}<mimic joint="first" multiplier="-0.5" offset="0.1"/>'
        ),
    )
    model = convert(path).spec.compile()
    assert model.nu == 1  # the follower has no servo of its own
    data = mujoco.MjData(model)
    data.act[0] = 0.6
    mujoco.mj_step(model, data, 5000)
    assert data.joint("first").qpos[0] == pytest.approx(0.6, abs=0.01)
    assert data.joint("second").qpos[0] == pytest.approx(0.1 - 0.5 * data.joint("first").qpos[0], abs=1e-3)


def test_limits_that_the_importer_drops_are_kept(tmp_path):
    soft = '<safety_controller soft_lower_limit="-0.9" soft_upper_limit="0.8" k_velocity="1"/>'
    path = write(tmp_path, link("base"), link("arm"), joint("elbow", "base", "arm", LIMIT + soft))
    convert(path, tmp_path / "robot.xml")
    limits = joint_limits(mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")), "elbow")
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (-1, 1, 1, 2)
    assert (limits.soft_lower, limits.soft_upper) == (-0.9, 0.8)


def test_without_additions_every_joint_gets_a_servo_that_reaches_and_holds_its_target(tmp_path):
    axis = '<axis xyz="0 1 0"/>'
    com = INERTIAL.replace("<inertial>", '<inertial><origin xyz="0.1 0 0"/>')
    strong = LIMIT.replace('effort="2"', 'effort="20"')
    path = write(tmp_path, link("base"), link("arm", com), joint("elbow", "base", "arm", axis + strong))
    report = convert(path)
    model = report.spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.5
    mujoco.mj_step(model, data, 500)  # 1 s at 2 ms
    data.ctrl[0] = 0
    mujoco.mj_step(model, data, 1000)
    # 1 kg at 0.1 m bends the servo by 0.98 N m / (20 N m / 0.01 rad).
    assert data.qpos[0] == pytest.approx(0.5, abs=0.001)
    assert any("elbow" in line and "servo" in line for line in report.added)


def test_a_joint_without_effort_limit_gets_no_servo_and_the_report_says_so(tmp_path):
    path = write(tmp_path, link("a"), link("b"), joint("free", "a", "b", "", "continuous"))
    report = convert(path)
    assert report.spec.compile().nu == 0
    assert any("free" in line and "no effort limit" in line for line in report.added)


def test_links_that_overlap_at_rest_are_excluded_and_reported(tmp_path):
    ball = f'{INERTIAL}<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    apart = '<origin xyz="0 0 0.15"/>'
    path = write(
        tmp_path,
        *(link(name, ball) for name in "abc"),
        joint("ab", "a", "b", f'<origin xyz="0 0 0.05"/>{LIMIT}'),
        joint("bc", "b", "c", apart.replace("0.15", "0.05") + LIMIT),
    )
    report = convert(path)
    assert report.excluded == (("a", "c"),)
    model = report.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_a_free_base_falls(tmp_path):
    model = convert(write(tmp_path, link("base")), options=Options(base="free", scene=False)).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.body("base").xpos[2] == pytest.approx(-9.81 / 2, rel=0.01)


def test_a_massless_moving_link_gets_the_floor_that_the_user_names(tmp_path):
    path = write(tmp_path, link("a"), link("b", ""), joint("j", "a", "b"))
    report = convert(path, options=Options(mass_floor=0.01))
    assert report.spec.compile().body("b").mass[0] == 0.01
    assert any("0.01 kg" in line for line in report.added)


def test_planar_and_floating_joints_have_their_freedoms(tmp_path):
    path = write(
        tmp_path,
        link("a"),
        link("b"),
        link("c"),
        joint("p", "a", "b", "", "planar"),
        joint("f", "a", "c", "", "floating"),
    )
    model = convert(path).spec.compile()
    assert model.nv == 9


def test_elements_that_are_dropped_are_counted(tmp_path):
    report = convert(write(tmp_path, link("a"), "<gazebo/>", "<gazebo/>", "<transmission/>"))
    assert report.dropped == ("2 x <gazebo>", "1 x <transmission>")


def test_additions_beside_the_urdf_are_applied(tmp_path):
    path = write(tmp_path, link("base"), link("arm"), joint("elbow", "base", "arm"))
    (tmp_path / "robot.yaml").write_text(
        """
option: {integrator: implicitfast, cone: elliptic}
bodies: {"*": {gravcomp: 1}}
joints: {elbow: {armature: 0.1, actuatorgravcomp: true}}
collision: {arm: [{capsule: [0.02, 0.1], pos: [0, 0, 0.1], name: forearm}]}
geoms: {forearm: {friction: 0.7, condim: 4}}
sites: [{name: tip, body: arm, pos: [0, 0, 0.2]}]
actuators: {elbow: {type: position, kp: 50, kv: 2}}
sensors: [{type: jointpos, name: angle, joint: elbow}, {type: framepos, name: tip_position, site: tip}]
exclude: [[base, arm]]
keyframes: {bent: {elbow: 0.5}}
"""
    )
    model = convert(path).spec.compile()
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.body_gravcomp[model.body("arm").id] == 1
    assert model.dof_armature[0] == 0.1
    assert model.geom("forearm").friction.tolist() == [0.7, 0.005, 0.0001]
    assert model.key("bent").qpos[0] == 0.5
    assert model.key("bent").ctrl[0] == 0.5  # a position servo's command
    assert model.actuator_forcerange[0].tolist() == [-2, 2]
    assert model.nexclude == 1
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.sensor("angle").data[0] == 0.5


def test_the_command_reports_as_text_and_as_json(tmp_path, capsys):
    path = write(tmp_path, link("base"), link("arm"), joint("elbow", "base", "arm"))
    parser = ArgumentParser()
    declared.add_arguments(parser)
    arguments = [str(path), "--out", str(tmp_path / "out.xml")]
    assert command.run(parser.parse_args(arguments)) == 0
    assert "wrote" in capsys.readouterr().out
    assert command.run(parser.parse_args([*arguments, "--json"])) == 0
    assert json.loads(capsys.readouterr().out)["robot"] == "r"


def test_a_root_link_named_world_is_the_world(tmp_path):
    path = write(tmp_path, link("world", ""), link("arm"), joint("elbow", "world", "arm"))
    model = convert(path).spec.compile()
    assert [model.body(i).name for i in range(model.nbody)] == ["world", "arm"]


def test_a_converted_arm_under_its_default_servos_stands_still_in_any_pose(tmp_path):
    """Its servos are stiff, and a forearm is lighter to turn where the upper arm may give way than at rest."""
    from benchmarks.user_robots.models import USER_ROBOTS

    path = USER_ROBOTS["bench_arm"].write(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for elbow in np.linspace(-2.0, 2.0, 9):
        mujoco.mj_resetData(model, data)
        data.qpos[:] = data.act[:] = 0.3, elbow
        for _ in range(round(1 / model.opt.timestep)):
            mujoco.mj_step(model, data)
        assert np.abs(data.qvel).max() < 1e-3


STAND = '<origin xyz="0 0 0.25"/><geometry><box size="0.2 0.2 0.5"/></geometry>'
ROD = '<origin xyz="0 0 -0.4"/><geometry><cylinder radius="0.02" length="0.8"/></geometry>'


def stand_and_rod(folder):
    """A rod that hangs from the top of a stand and swings to 0.3 m below its foot."""
    return write(
        folder,
        link("stand", f"{INERTIAL}<visual>{STAND}</visual><collision>{STAND}</collision>"),
        link("rod", f"{INERTIAL}<visual>{ROD}</visual><collision>{ROD}</collision>"),
        joint("swing", "stand", "rod", f'<origin xyz="0.3 0 0.5"/><axis xyz="0 1 0"/>{LIMIT}'),
    )


def test_a_converted_robot_has_light_and_a_floor_below_it_that_is_in_nobodys_way(tmp_path):
    convert(stand_and_rod(tmp_path), tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert model.nlight == 1
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.geom("floor").xpos[2] == pytest.approx(-0.3)  # the hanging rod's lower end
    data.joint("swing").qpos[0] = 0.2
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    bare = convert(stand_and_rod(tmp_path), options=Options(scene=False)).spec.compile()
    assert (bare.nlight, bare.ngeom) == (0, model.ngeom - 1)


def test_a_robot_with_a_free_base_stands_on_its_floor(tmp_path):
    path = write(tmp_path, link("stand", f"{INERTIAL}<collision>{STAND}</collision>"))
    model = convert(path, options=Options(base="free")).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.body("stand").xpos[2] == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize("kind", ["sphere", "box", "cylinder", "mesh"])
def test_the_floor_touches_the_lowest_point_of_every_shape(kind, tmp_path):
    trimesh.creation.cone(radius=0.1, height=0.3).export(tmp_path / "cone.stl")
    shape = {
        "sphere": '<sphere radius="0.1"/>',
        "box": '<box size="0.2 0.4 0.6"/>',
        "cylinder": '<cylinder radius="0.1" length="0.5"/>',
        "mesh": '<mesh filename="cone.stl"/>',
    }[kind]
    visual = f'<visual><origin xyz="0 0 -1" rpy="0.4 -0.7 0.2"/><geometry>{shape}</geometry></visual>'
    model = convert(write(tmp_path, link("base", f"{INERTIAL}{visual}"))).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    (seen,) = (g for g in range(model.ngeom) if model.geom(g).name != "floor")
    turn = data.geom_xmat[seen].reshape(3, 3)
    made = {
        "sphere": trimesh.creation.icosphere(subdivisions=5, radius=0.1),
        "box": trimesh.creation.box((0.2, 0.4, 0.6)),
        "cylinder": trimesh.creation.cylinder(radius=0.1, height=0.5, sections=720),
        "mesh": None,
    }[kind]
    points = model.mesh_vert if made is None else made.vertices
    lowest = (points @ turn.T + data.geom_xpos[seen])[:, 2].min()
    assert data.geom("floor").xpos[2] == pytest.approx(lowest, abs=1e-4)
