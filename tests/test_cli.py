"""The command line: what it prints, what it writes, and one line for whatever it cannot use."""

from __future__ import annotations

import base64
import errno
import json
import os
import pickle
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import gymnasium
import imageio.v3 as iio
import numpy as np
import pytest

import tiago_mj
from tiago_mj import cli
from tiago_mj.io import extra
from tiago_mj.rollout import command
from tiago_mj.rollout.options import environment_id, read_options
from tiago_mj.view.film import Film, strip_indices


def complaint(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Run a command that must be refused, and return what it says."""
    try:
        status = cli.main(words)
    except SystemExit as stop:
        status = stop.code
    said = capsys.readouterr()
    assert status == 2
    assert said.out == ""
    assert said.err.count("\n") == 1, "a complaint is one line"
    assert "Traceback" not in said.err
    return said.err


def test_version_is_printed(capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"tiago-mj {tiago_mj.__version__}\n"


def test_help_and_version_import_nothing_heavy():
    code = "import sys; from tiago_mj import cli\ntry: cli.main(['--help'])\nexcept SystemExit: pass\n"
    code += "print([m for m in ('mujoco', 'matplotlib', 'scipy', 'torch', 'jinja2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert all(name in done.stdout for name in cli.COMMANDS)


@pytest.mark.parametrize("name", cli.DECLARED)
def test_the_help_of_a_command_imports_nothing_heavy(name):
    code = f"import sys; from tiago_mj import cli\ntry: cli.main(['{name}', '--help'])\nexcept SystemExit: pass\n"
    code += "print([m for m in ('mujoco', 'matplotlib', 'scipy', 'pandas', 'jinja2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "--json" in done.stdout


def test_arguments_offer_what_their_commands_take():
    from tiago_mj.models.convert import assembly
    from tiago_mj.recordings.imports import command, xl330
    from tiago_mj.rollout import scale
    from tiago_mj.view import film

    parser = cli.build_parser("convert", "import", "rollout")
    commands = next(action for action in parser._actions if action.dest == "command").choices

    def action(name: str, option: str):
        return next(one for one in commands[name]._actions if one.dest == option)

    for option, choices in (("collision", assembly.COLLISIONS), ("visual", assembly.VISUALS), ("base", assembly.BASES)):
        assert action("convert", option).choices == choices
    assert action("import", "kind").choices == (*command.PUBLIC, *command.OWN)
    assert action("import", "commands").choices == xl330.COMMANDS
    assert action("rollout", "backend").choices == scale.BACKENDS
    assert action("rollout", "film").help.startswith(", ".join(film.SUFFIXES))


def test_a_rollout_prints_returns_contacts_and_forces_of_every_episode(capsys):
    assert cli.main(["rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--seed", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == [word for name in command.HEADER for word in name.split()]
    number, seed, total, success, both, right, left, peak = lines[3].split()
    assert (number, seed, success) == ("2", "4", "yes")
    assert -600 < float(total) < 0  # 300 steps without contact cost 600
    assert 0 < float(both) < 1.25
    assert float(right) == pytest.approx(1, abs=0.0385)  # what counts as success
    assert float(left) == pytest.approx(1, abs=0.0385)
    assert 1 < float(peak) < 2.7  # 16 N are 2.64
    assert "2 of 2 episodes end in success" in lines[-1]


def test_a_rollout_as_json_says_the_same(capsys):
    words = ["rollout", "--env", "tiago_mj/GripperTactile-v0", "--policy", "random", "--episodes", "2", "--json"]
    assert cli.main(words) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["env"] == "tiago_mj/GripperTactile-v0"
    assert [episode["seed"] for episode in data["episodes"]] == [0, 1]
    assert data["return_mean"] == pytest.approx(np.mean([episode["episode_return"] for episode in data["episodes"]]))
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out) == data  # the seed decides everything, the policy's actions too


def test_a_rollout_is_of_the_environment_with_its_arguments(capsys):
    words = ["rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--env-option", "object_offset=0", "--json"]
    episodes = {}
    for servo in ("pal", "ideal"):
        assert cli.main([*words, "--env-option", f"servo={servo}"]) == 0
        data = json.loads(capsys.readouterr().out)
        assert data["env_options"] == {"object_offset": 0, "servo": servo}
        (episodes[servo],) = data["episodes"]
    # The servo that tracks velocities at once is the sooner at the object.
    assert episodes["ideal"]["both_contacts"] < episodes["pal"]["both_contacts"]
    film = complaint(capsys, *words, "--film", "a.png", "--env-option", "render_mode=human")
    assert "does not take this" in film


def test_options_are_json_or_plain_words():
    found = read_options(["servo=ideal", 'object=["box", "wood"]', "goal=[0.5, 1.5]", "control_hz=25", "a=b=c"])
    assert found == {"servo": "ideal", "object": ["box", "wood"], "goal": [0.5, 1.5], "control_hz": 25, "a": "b=c"}


def test_an_environment_without_load_cells_can_be_rolled_out(capsys):
    assert cli.main(["rollout", "--env", "TIAGoPALGripper-v0", "--policy", "random", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["episodes"][0]["steps"] == 300


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".png"])
def test_a_film_shows_the_episode(suffix, tmp_path):
    path = tmp_path / "deep" / f"film{suffix}"
    env = gymnasium.make("tiago_mj/GripperTactile-v0", render_mode="rgb_array", width=160, height=128)
    film = Film(env)
    env.reset(seed=0)
    for step in range(41):
        if step:
            env.step(np.array([-1.0, -1.0]))
        film(step)
    env.close()
    film.write(path)
    pictures = iio.imread(path) if suffix == ".png" else np.stack(list(iio.imiter(path)))
    if suffix == ".png":
        assert pictures.shape == (128, 6 * 160, 3)
        first, last = pictures[:, :160], pictures[:, -160:]
    else:
        assert pictures.shape == (14, 128, 160, 3)  # every third step of 40, and the start
        first, last = pictures[0], pictures[-1]
    assert np.abs(first.astype(int) - last).mean() > 1, "the fingers must be seen to move"
    assert [entry.name for entry in path.parent.iterdir()] == [path.name], "no temporary file may stay"


def test_a_filmstrip_holds_the_first_and_the_last_picture():
    assert strip_indices(151) == [0, 30, 60, 90, 120, 150]
    assert strip_indices(2) == [0, 1]


def test_an_unknown_environment_is_answered_with_those_there_are(capsys):
    said = complaint(capsys, "rollout", "--env", "Gripper-v0", "--policy", "pi")
    assert "Gripper-v0" in said
    assert all(name in said for name in tiago_mj.ENVIRONMENTS)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "COMMAND"),
        (("dance",), "dance"),
        (("rollout", "--env", "GripperTactile-v0"), "--policy"),
        (("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "0"), "--episodes is 0"),
        (("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "x"), "invalid int"),
        (("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--seed", "-1"), "--seed is -1"),
        (("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--env-option", "servo"), "no key=value"),
        (
            ("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--env-option", "sevro=ideal"),
            "did you mean 'servo'",
        ),
        (("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--film", "a.avi"), ".mp4, .gif, .png"),
        (("rollout", "--env", "GripperTactile-v0", "--policy", "pid"), "give pi, pi-tuned, "),
        (("rollout", "--env", "TIAGoPALGripper-v0", "--policy", "pi"), "use an environment with such a goal"),
        (("rollout", "--env", "TIAGoPushTactile-v0", "--policy", "pi"), "use an environment with such a goal"),
        (("demo", "--data", "no/such/folder"), "no/such/folder"),
        (("demo", "--seed", "-1"), "--seed is -1"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_input_gets_one_line_that_says_how_to_mend_it(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert said in complaint(capsys, *words)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "the drive is full: make room on it, or name another place"),
        (OSError(errno.EACCES, "Permission denied", "a/b.csv"), "a/b.csv: permission denied"),
    ],
)
def test_what_the_system_refuses_is_said_in_words(fault, said, capsys, monkeypatch):
    def run(arguments):
        raise fault

    monkeypatch.setattr(command, "run", run)
    line = complaint(capsys, "rollout", "--env", "GripperTactile-v0", "--policy", "pi")
    assert line == f"tiago-mj rollout: {said}\n"


def test_an_error_shows_where_it_came_from_when_asked(monkeypatch):
    monkeypatch.setenv(cli.TRACEBACK, "1")
    with pytest.raises(ValueError, match="unknown"):
        cli.main(["rollout", "--env", "Gripper-v0", "--policy", "pi"])


def test_a_file_that_is_no_policy_is_named(tmp_path, capsys):
    path = tmp_path / "policy.zip"
    path.write_text("not a zip file")
    assert "is not a file saved by stable-baselines3" in complaint(
        capsys, "rollout", "--env", "GripperTactile-v0", "--policy", str(path)
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", "{}")
    assert "unknown algorithm" in complaint(capsys, "rollout", "--env", "GripperTactile-v0", "--policy", str(path))


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """A file with an untrained TD3."""
    sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")
    path = tmp_path_factory.mktemp("policy") / "td3.zip"
    env = gymnasium.make("tiago_mj/GripperTactile-v0")
    sb3.TD3("MlpPolicy", env, policy_kwargs={"net_arch": [8]}, buffer_size=10, seed=0, device="cpu").save(path)
    env.close()
    return path


class Touch:
    """Makes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_what_a_policy_file_holds_is_not_run_unless_trusted(tmp_path, capsys):
    pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")
    path, mark = tmp_path / "policy.zip", tmp_path / "mark"
    pickled = base64.b64encode(pickle.dumps(Touch(mark))).decode()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps({"policy_delay": {":type:": "Touch", ":serialized:": pickled}}))
    words = ("rollout", "--env", "GripperTactile-v0", "--policy", str(path))
    assert "--trust" in complaint(capsys, *words)
    assert not mark.exists()
    assert "could not load it" in complaint(capsys, *words, "--trust")
    assert mark.exists(), "the file must be one that does harm when it is loaded"


def test_a_learned_policy_runs_when_trusted(policy, capsys):
    assert cli.main(["rollout", "--env", "GripperTactile-v0", "--policy", str(policy), "--trust", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["episodes"][0]["steps"] == 300


def test_a_learned_policy_for_other_observations_is_refused(policy, capsys):
    said = complaint(capsys, "rollout", "--env", "TIAGoTactile-v0", "--policy", str(policy), "--trust")
    assert "spaces do not match" in said


def test_without_the_learning_library_it_says_what_to_install(policy, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    said = complaint(capsys, "rollout", "--env", "GripperTactile-v0", "--policy", str(policy), "--trust")
    assert extra.install("train") in said


def test_ids_are_known_with_and_without_their_namespace():
    for name in tiago_mj.ENVIRONMENTS:
        assert environment_id(name) == environment_id(f"tiago_mj/{name}") == f"tiago_mj/{name}"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="pipes of another kind")
@pytest.mark.parametrize(("words", "status"), [
    (("agents",), 141),
    (("convert", "robot.urdf", "--out", "robot.xml"), 141),
    (("diagnose", "--help"), 0),  # argparse itself lets it pass
])  # fmt: skip
def test_a_command_whose_output_is_closed_ends_quietly(words, status, tmp_path):
    shutil.copy(Path(__file__).parents[1] / "examples" / "pendulum" / "pendulum.urdf", tmp_path / "robot.urdf")
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "tiago_mj.cli", *words],
        stdout=writer, stderr=subprocess.PIPE, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    os.close(writer)
    assert done.stderr == ""
    assert done.returncode == status


def test_another_broken_pipe_is_no_closed_output(monkeypatch, capsys):
    def broken(arguments):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("tiago_mj.doctor.run", broken)
    assert cli.main(["doctor"]) == 2
    assert capsys.readouterr().err == "tiago-mj doctor: broken pipe\n"
