"""A broken URDF or additions file gets one line that names file, element and mend; and nothing is written."""

import argparse
import re

import pytest
from broken_urdfs import BROKEN, GOOD, joint, link, robot, visual

from tiago_mj.cli import convert as declared
from tiago_mj.models.convert import ConversionError, Options, command, convert


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_urdf_gets_one_line_that_names_the_element_and_the_mend(fault, tmp_path):
    text, words = BROKEN[fault]
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    with pytest.raises(ConversionError) as caught:
        convert(path, tmp_path / "robot.xml")
    message = str(caught.value)
    assert "\n" not in message
    for word in [str(path), *words]:
        assert word in message, message
    assert re.search(r"; \S", message), message  # what is wrong; how to mend it
    assert [p.name for p in tmp_path.iterdir()] == ["robot.urdf"]


def test_a_robot_whose_meshes_are_elsewhere_converts_without_them(tmp_path):
    path = tmp_path / "robot.urdf"
    mesh = '<mesh filename="package://elsewhere/base.stl"/>'
    shapes = f"{visual(mesh)}<collision><geometry>{mesh}</geometry></collision>"
    path.write_text(robot(link("base", shapes), link("arm"), joint("elbow", "base", "arm")))
    model = convert(path, tmp_path / "robot.xml", options=Options(visual="none", collision="none")).spec.compile()
    assert (model.nmesh, model.nv) == (0, 1)
    assert model.body_mass.sum() > 0


def test_the_good_twin_of_the_broken_urdfs_converts(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(GOOD)
    assert convert(path, tmp_path / "robot.xml").spec.compile().nv == 1


@pytest.mark.parametrize(
    ("additions", "words"),
    [
        ("sensor: []", ["sensor", "sensors"]),
        ("sites: {}", ["sites", "list"]),
        ("[1, 2]", ["mapping"]),
        ("a: [", ["YAML"]),
        ("include: [nowhere.yaml]", ["nowhere.yaml"]),
        ("include: [robot.yaml]", ["itself"]),
        ("bodies: {hand: {gravcomp: 1}}", ["hand", "matches nothing", "base"]),
        ("bodies: {base: {colour: 1}}", ["colour", "gravcomp"]),
        ("bodies: {base: {gravcomp: much}}", ["gravcomp", "much"]),
        ("joints: {elbow: {armature: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]}}", ["armature", "elbow"]),
        ("option: {integrator: fast}", ["integrator", "implicitfast"]),
        ("option: {speed: 1}", ["speed"]),
        ("actuators: {wrist: {kp: 1}}", ["wrist", "elbow"]),
        ("actuators: {elbow: {type: pneumatic}}", ["pneumatic", "intvelocity"]),
        ("actuators: {elbow: {kp: -1}}", ["elbow", "negative"]),
        ("sites: [{name: s, body: hand}]", ["hand", "s"]),
        ("sites: [{name: s}]", ["body"]),
        ("sensors: [{type: touch, name: t, site: nowhere}]", ["t", "nowhere"]),
        ("sensors: [{type: smell, name: t, joint: elbow}]", ["smell"]),
        ("exclude: [[base, hand]]", ["hand"]),
        ("exclude: [base]", ["pair"]),
        ("keyframes: {home: {wrist: 1}}", ["home", "wrist"]),
        ("collision: {base: [{cube: 1}]}", ["cube", "box"]),
        ("collision: {base: [{box: [1, 1]}]}", ["box", "3"]),
        ("capsules: [hand]", ["hand"]),
    ],
)
def test_a_broken_additions_file_gets_one_line(additions, words, tmp_path):
    (tmp_path / "robot.urdf").write_text(GOOD)
    (tmp_path / "robot.yaml").write_text(additions)
    with pytest.raises(ConversionError) as caught:
        convert(tmp_path / "robot.urdf", tmp_path / "robot.xml")
    message = str(caught.value)
    assert "\n" not in message
    for word in ["robot.yaml" if "nowhere.yaml" not in words else "nowhere.yaml", *words]:
        assert word in message, message
    assert not (tmp_path / "robot.xml").exists()


@pytest.mark.parametrize("option", ["collision", "visual", "base"])
def test_an_unknown_option_is_answered_with_the_known_ones(option, tmp_path):
    (tmp_path / "robot.urdf").write_text(GOOD)
    with pytest.raises(ConversionError, match=f"{option}: .*use one of"):
        convert(tmp_path / "robot.urdf", options=Options(**{option: "best"}))


def test_the_command_prints_one_line_and_ends_with_2(tmp_path, capsys):
    (tmp_path / "robot.urdf").write_text(BROKEN["zero axis"][0])
    parser = argparse.ArgumentParser()
    declared.add_arguments(parser)
    assert command.run(parser.parse_args([str(tmp_path / "robot.urdf"), "--out", str(tmp_path / "robot.xml")])) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "zero axis" in err


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConversionError, match=r"nothing\.urdf"):
        convert(tmp_path / "nothing.urdf")


def test_a_folder_that_is_not_there_is_named(tmp_path):
    (tmp_path / "robot.urdf").write_text(GOOD)
    with pytest.raises(ConversionError, match="folder does not exist"):
        convert(tmp_path / "robot.urdf", tmp_path / "nowhere" / "robot.xml")


def test_a_failed_conversion_leaves_the_earlier_file_as_it_was(tmp_path):
    path, out = tmp_path / "robot.urdf", tmp_path / "robot.xml"
    path.write_text(GOOD)
    convert(path, out)
    before = out.read_bytes()
    path.write_text(BROKEN["cycle"][0])
    with pytest.raises(ConversionError):
        convert(path, out)
    assert out.read_bytes() == before
