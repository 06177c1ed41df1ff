"""The demonstration: with and without a recording of a real arm, with and without pictures."""

from __future__ import annotations

import html.parser
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from tiago_mj import cli
from tiago_mj.demo import arm_torque, hidden, page, report
from tiago_mj.demo.grasp import grasp
from tiago_mj.effects import EFFECTS
from tiago_mj.view import drawing, figures
from tiago_mj.view.film import Film

ROOT = Path(__file__).resolve().parents[2]
REALDATA = Path(os.environ.get("TIAGO_MJ_REALDATA", ROOT.parent / "shared" / "realdata"))
needs_recording = pytest.mark.skipif(
    not (REALDATA / arm_torque.FOLDER).is_dir(), reason=f"no recording of a real arm at {REALDATA}"
)


class Links(html.parser.HTMLParser):
    """Collects what a page refers to, and its words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href", "srcset", "poster")]
        assert tag not in ("script", "link", "iframe"), "the page needs nothing but itself"

    def handle_data(self, data):
        self.words += data


def run(capsys: pytest.CaptureFixture[str], out: Path, *words: str) -> tuple[str, dict, Links]:
    """Run the command: what it printed, its numbers, its page."""
    assert cli.main(["demo", "--out", str(out), *words]) == 0
    printed = capsys.readouterr().out
    return printed, json.loads((out / "demo.json").read_text()), Links((out / "demo.html").read_text())


def check_grasp_and_curve(printed: str, data: dict, shown: Links) -> None:
    done, curve = data["grasp"], data["curve"]
    assert done["success"]
    assert -250 < done["return"] < -150  # the paper's controller: -198 ± 15; how it closes decides
    assert {"right", "left"} == set(done["contact_times"])
    assert 0 < done["contact_times"]["left"] < done["contact_times"]["right"]  # the object is nearer to the left finger
    assert done["goal_newtons"] == pytest.approx(6.06, abs=0.005)
    assert curve["slopes_agree"]
    assert len(curve["measured"]) == 6
    assert f"return {done['return']:.1f}" in printed
    assert "within their spread" in printed
    assert "255" in shown.words
    assert "333" in shown.words
    assert data["made"]["command"] in shown.words
    assert all(source.startswith("data:") for source in shown.sources), "everything is in the page"


def no_opengl(monkeypatch):
    def broken(*given):
        raise RuntimeError("there is no OpenGL here")

    monkeypatch.setattr("mujoco.Renderer", broken)


@pytest.fixture
def undiagnosed(monkeypatch):
    """Without the diagnosis, which takes half a minute."""

    def missing(*given):
        raise ModuleNotFoundError("the diagnosis needs pandas, which is not installed")

    monkeypatch.setattr(hidden, "find", missing)


@pytest.mark.slow
def test_the_demo_finds_the_effect_that_it_hid(capsys, tmp_path):
    printed, data, shown = run(capsys, tmp_path / "out", "--seed", "2")
    found = data["hidden"]
    assert found["effect"] == "backlash"
    assert found["right"]
    assert found["holds"], "the interval has the truth in it"
    assert found["closed"] > 0.95
    assert found["said"] in printed
    assert found["value"] in shown.words
    assert (tmp_path / "out" / found["report"]).is_file()
    assert found["report"] in shown.sources
    if not data["grasp"]["no_film"]:
        assert (tmp_path / "out" / "nominal.mp4").stat().st_size > 10_000


def test_every_effect_that_may_be_hidden_is_drawn_within_its_bounds():
    drawn = [hidden.draw(seed) for seed in range(40)]
    assert {name for name, _, _ in drawn} == set(hidden.HIDDEN)
    for name, parameter, value in drawn:
        _, low, high = hidden.HIDDEN[name]
        assert parameter in EFFECTS[name].parameters
        assert low <= value <= high
    assert len({value for _, _, value in drawn}) == len(drawn)


def test_a_ghost_stands_farther_from_the_robot_than_its_simulator_does_and_is_seen():
    env = gymnasium.make("tiago_mj/GripperTactile-v0", render_mode="rgb_array", width=96, height=80)
    env.reset(seed=0)
    core = env.unwrapped
    robot = drawing.snapshot(core)
    closer = replace(robot, qpos=robot.qpos - 0.002)
    shown = hidden.haunted(robot, closer, "nominal", 5)
    np.testing.assert_allclose(shown.ghost.qpos, robot.qpos - 0.01)
    assert shown.caption.startswith("robot 0.0 N")
    fingers = [core.model.joint(name).bodyid[0] for name in core.joints]
    moved = drawing.jointed(core.model)
    assert moved[fingers].all()
    assert not moved[core.model.body("object").id], "nor what no joint of the robot moves"
    try:
        Film(env).check()
    except gymnasium.error.DependencyNotInstalled as fault:
        pytest.skip(str(fault))
    plain, ghostly = drawing.draw(core.model, [robot, shown], size=(96, 80), camera=hidden.CAMERA)
    env.close()
    changed = np.abs(ghostly.astype(int) - plain).max(axis=-1) > 40
    orange = (ghostly[..., 0].astype(int) > ghostly[..., 2] + 60) & changed
    assert orange.sum() > 20


@needs_recording
@pytest.mark.usefixtures("undiagnosed")
@pytest.mark.slow
def test_the_demo_with_a_recording_compares_the_arm_too(capsys, tmp_path):
    printed, data, shown = run(capsys, tmp_path / "out", "--data", str(REALDATA))
    check_grasp_and_curve(printed, data, shown)
    assert data["arm"]["genuine"]
    assert [row["joint"] for row in data["arm"]["joints"]] == list(arm_torque.COMPARABLE)
    assert f"{100 * data['arm']['joints'][0]['explained']:.0f} % of the variance" in printed
    assert "arm_5 to arm_7" in shown.words
    kinds = [source.split(";")[0] for source in shown.sources]
    if data["grasp"]["no_film"]:
        pytest.skip(f"no OpenGL here, so no film: {data['grasp']['no_film']}")
    assert sorted(kinds) == ["data:image/jpeg"] + ["data:image/png"] * 3 + ["data:video/mp4"]
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"demo.html", "demo.json", "film.mp4", "force.png", "curve.png", "arm.png"}


@pytest.mark.usefixtures("undiagnosed")
def test_the_demo_without_recording_and_without_opengl_goes_on(capsys, tmp_path, monkeypatch):
    no_opengl(monkeypatch)
    printed, data, shown = run(capsys, tmp_path / "out")
    check_grasp_and_curve(printed, data, shown)
    assert data["arm"] is None
    assert "libegl1" in data["grasp"]["no_film"], "it says what to install"
    assert data["grasp"]["no_film"] in " ".join(printed.split())
    for line in arm_torque.HOW_TO_GET:
        assert line in printed
        assert line in shown.words
    assert [source.split(";")[0] for source in shown.sources] == ["data:image/png"] * 2
    assert data["hidden"] is None
    assert "pandas" in shown.words
    *_, done, written, following = printed.splitlines()
    assert (done.split()[0], written.split()[0], following.split()[0]) == ("Done", "Written:", "Next:")


@pytest.mark.usefixtures("undiagnosed")
def test_a_failing_page_leaves_the_old_one_whole(capsys, tmp_path, monkeypatch):
    no_opengl(monkeypatch)
    (tmp_path / "demo.html").write_text("the old page")
    monkeypatch.setattr(page, "render", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        cli.main(["demo", "--out", str(tmp_path)])
    assert (tmp_path / "demo.html").read_text() == "the old page"
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")], "no temporary file may stay"


@needs_recording
class TestArm:
    def test_shares_explained_do_not_hang_on_the_cut_off(self):
        recording = arm_torque.load(REALDATA / arm_torque.FOLDER)
        shares = np.array(
            [[row.explained for row in arm_torque.compare(recording, cutoff=hertz).rows] for hertz in (1.0, 3.0, 8.0)]
        )
        assert np.ptp(shares, axis=0).max() < 0.015  # 0.013 measured; what the module says

    def test_measured_torques_have_the_sign_and_size_of_the_predicted(self):
        comparison = arm_torque.compare(arm_torque.load(REALDATA / arm_torque.FOLDER))
        for j, row in enumerate(comparison.rows):
            # A wrong sign of a motor constant would make these negative; a wrong reduction would miss by a factor of 3.
            assert np.corrcoef(comparison.measured[:, j], comparison.predicted[:, j])[0, 1] > 0.5, row.joint
        arm_2 = comparison.rows[1]  # mostly weight, which the model knows
        assert arm_2.predicted_rms == pytest.approx(arm_2.measured_rms, rel=0.2)

    def test_what_is_left_out_cannot_be_compared(self):
        comparison = arm_torque.compare(arm_torque.load(REALDATA / arm_torque.FOLDER))
        assert comparison.dead[0] < 0.01 * comparison.dead[1]
        assert comparison.torso[0] < 0.01 * comparison.torso[1]

    def test_an_altered_recording_is_known_from_the_published_one(self, tmp_path):
        folder = tmp_path / arm_torque.FOLDER
        shutil.copytree(REALDATA / arm_torque.FOLDER, folder)
        folder.chmod(0o755)
        for path in folder.iterdir():
            path.chmod(0o644)
        assert arm_torque.load(folder).genuine
        effort = folder / "tiago_effort.csv"
        effort.write_text(effort.read_text().replace("1.654", "1.655", 1))
        assert not arm_torque.load(folder).genuine


def test_no_folder_means_no_recording(tmp_path):
    assert arm_torque.find(None) is None
    assert arm_torque.find(tmp_path) is None


def test_a_broken_recording_is_named(tmp_path):
    folder = tmp_path / arm_torque.FOLDER
    folder.mkdir()
    with pytest.raises(ValueError, match=r"lacks tiago_position\.csv"):
        arm_torque.find(tmp_path)
    for name in arm_torque.SHA256:
        (folder / name).write_text("t,a\n0.0,oops\n")
    with pytest.raises(ValueError, match=r"tiago_position\.csv is not a table of numbers"):
        arm_torque.load(folder)
    for name in arm_torque.SHA256:
        (folder / name).write_text("t,a\n" + "0.0,1.0\n" * 200)
    with pytest.raises(ValueError, match="200 rows and 2 columns"):
        arm_torque.load(folder)


def test_a_grasp_that_never_touches_is_told_as_it_is(monkeypatch):
    class Still:
        def reset(self):
            pass

        def __call__(self, observation, info):
            return np.zeros(2, dtype=np.float32)

    no_opengl(monkeypatch)
    monkeypatch.setattr("tiago_mj.demo.grasp.ForcePI.for_env", lambda env: Still())
    done = grasp(seed=0)
    data = report.grasp_data(done)
    assert not data["success"]
    assert data["contact_times"] == {"right": None, "left": None}
    assert figures.png(figures.force(done.trace)).startswith(b"\x89PNG")
    simulated = [{"object": "wood", "slope": 1.5, "dead_band_mm": 0.0}]
    curve = {"slopes": (1.0, 2.0), "dead_bands_mm": (0.1, 0.2), "simulated": simulated, "slopes_agree": True}
    whole = {"final_force": {"right": 1.0, "left": 1.0}, "goal": 1.0}
    shown = {"seed": 0, "hidden": None, "no_hidden": "not asked", "grasp": data, "whole": whole, "arm": None}
    said = "\n".join(report.lines({**shown, "curve": {**curve, "unexplained_force": 0.1}}))
    assert "right finger never touches, left finger never touches" in said


def test_the_environment_shown_is_one_that_is_registered():
    assert "tiago_mj/GripperTactile-v0" in gymnasium.registry


def test_an_effect_that_was_not_found_in_time_is_told_as_that():
    hidden = {"effect": "Coulomb friction", "truth": "3.69 N", "right": False, "complete": False, "seconds": 48.8}
    assert report.headline({"hidden": hidden})[1].endswith(
        "not found in 49 s; run it again while the machine has less else to do."
    )
    assert report.outcome({"hidden": hidden}) == "an effect hidden and not found, "
    assert report.headline({"hidden": {**hidden, "complete": True}})[1].endswith("alone: not found.")
    assert report.outcome({"hidden": {**hidden, "right": True}}) == "an effect found, "
    assert report.outcome({"hidden": None}) == ""
