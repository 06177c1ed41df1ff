"""``tiago-mj export``: what it prints and writes, and one line for whatever it cannot use."""

import json
import shutil

from robots import ARM, diagnosed, effect

from tiago_mj import cli
from tiago_mj.effects import read_effects
from tiago_mj.export.holding import library
from tiago_mj.export.targets.registry import TARGETS

FRICTION = [effect("coulomb_friction", "elbow", force=0.7)]


def refused(capsys, *words):
    try:
        status = cli.main([str(word) for word in ("export", *words)])
    except SystemExit as stop:
        status = stop.code
    said = capsys.readouterr()
    assert (status, said.out) == (2, "")
    assert said.err.count("\n") == 1
    return said.err


def test_a_folder_that_is_no_diagnosis_is_said_in_one_line(tmp_path, capsys):
    out = ("--out", tmp_path / "out")
    assert "no diagnosis at" in refused(capsys, tmp_path / "nowhere", *out)
    (tmp_path / "empty").mkdir()
    assert "holds no calibration.yaml" in refused(capsys, tmp_path / "empty", *out)
    (tmp_path / "empty" / "calibration.yaml").write_text("- 1\n")
    assert "is no calibration" in refused(capsys, tmp_path / "empty", *out)
    (tmp_path / "empty" / "calibration.yaml").write_text("{")
    assert "no valid YAML" in refused(capsys, tmp_path / "empty", *out)
    (tmp_path / "empty" / "calibration.yaml").write_text("schema: tiago_mj.calibration/9\n")
    assert "this version reads" in refused(capsys, tmp_path / "empty", *out)
    assert not (tmp_path / "out").exists()


def test_an_unknown_target_or_version_is_said_in_one_line(tmp_path, capsys):
    folder, out = diagnosed(tmp_path, FRICTION), ("--out", tmp_path / "out")
    assert "did you mean 'isaaclab'" in refused(capsys, folder, "--to", "isaac_lab", *out)
    assert "use one of 3.11, 3.17, 4.0" in refused(capsys, folder, "--mujoco", "2.3", *out)
    assert "give DIAGNOSIS and --out" in refused(capsys, folder)
    assert "--mujoco is for targets" in refused(capsys, folder, "--to", "urdf", "--mujoco", "3.11", *out)


def test_a_model_that_is_not_there_or_another_is_said_in_one_line(tmp_path, capsys):
    folder, out = diagnosed(tmp_path, FRICTION), ("--out", tmp_path / "out")
    (tmp_path / "arm.xml").rename(tmp_path / "other.xml")
    assert "give --model PATH/arm.xml" in refused(capsys, folder, *out)
    assert "no such file" in refused(capsys, folder, "--model", tmp_path / "arm.xml", *out)
    (tmp_path / "other.xml").write_text(ARM.replace('joint name="elbow"', 'joint name="wrist"', 2))
    assert "'elbow'" in refused(capsys, folder, "--model", tmp_path / "other.xml", *out)
    (tmp_path / "other.xml").write_text("<mujoco>")
    refused(capsys, folder, "--model", tmp_path / "other.xml", *out)


def test_a_diagnosis_of_an_environment_goes_to_gymnasium(tmp_path, capsys):
    folder = diagnosed(tmp_path, FRICTION, robot="tiago_mj/GripperTactile-v0")
    assert "use --to gymnasium" in refused(capsys, folder, "--out", tmp_path / "out")
    assert cli.main(["export", str(folder), "--to", "gymnasium", "--out", str(tmp_path / "out")]) == 0
    assert read_effects(tmp_path / "out" / "calibration.yaml")[0].name == "coulomb_friction"


def test_the_model_is_found_beside_the_diagnosis_or_given(tmp_path, capsys):
    folder = diagnosed(tmp_path, FRICTION)
    assert cli.main(["export", str(folder), "--out", str(tmp_path / "one")]) == 0
    shutil.copy(tmp_path / "arm.xml", tmp_path / "other.xml")
    words = ["--model", str(tmp_path / "other.xml"), "--out", str(tmp_path / "two")]
    assert cli.main(["export", str(folder / "calibration.yaml"), *words]) == 0
    assert (tmp_path / "one" / "arm.xml").read_bytes() == (tmp_path / "two" / "other.xml").read_bytes()
    assert f"wrote {tmp_path / 'two' / 'other.xml'}" in capsys.readouterr().out


def test_json_says_what_the_text_says_and_nothing_else_is_printed(tmp_path, capsys):
    folder = diagnosed(tmp_path, [*FRICTION, effect("velocity_limit", "elbow", velocity=1.0)])
    assert cli.main(["export", str(folder), "--out", str(tmp_path / "out"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["target"] == "mujoco"
    assert [one["grade"] for one in said["effects"]] == ["exact", "not"]
    assert 0 < said["replayed"]["after"] < said["replayed"]["before"]
    assert {path.rsplit("/", 1)[1] for path in said["files"]} == {"arm.xml", "changes.diff", "export.md"}


def test_what_an_earlier_export_left_goes(tmp_path):
    folder, out = diagnosed(tmp_path, FRICTION), tmp_path / "out"
    for target in ("newton", "newton"):
        assert cli.main(["export", str(folder), "--to", target, "--out", str(out)]) == 0
    assert sorted(one.name for one in out.iterdir()) == ["changes.diff", "export.md", "model", "newton_drives.usda"]


def test_the_table_has_all_effects_and_all_targets(capsys):
    assert cli.main(["export", "--table"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(library()) == 2 + 53
    assert [name.strip(" `") for name in lines[0].split("|")[2:-1]] == list(TARGETS)
    assert cli.main(["export", "--table", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert set(said["backlash"]) == set(TARGETS)
    assert said["backlash"]["gymnasium"]["grade"] == "exact"
    assert said["backlash"]["mujoco"]["grade"] == "approximate"
    assert all(one["how"] for row in said.values() for one in row.values())
