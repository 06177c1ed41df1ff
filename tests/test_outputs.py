"""Where a command is to write is tried before it works: one line and exit status 2."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from tiago_mj import cli

FOLDERS = (
    ("diagnose", "nowhere", "--out"),
    ("diagnose-all", "nowhere", "--out"),
    ("compare", "nowhere", "nowhere", "--out"),
    ("record", "--env", "GripperTactile-v0", "--policy", "pi", "--out"),
    ("import", "ta11-curve", "builtin", "--out"),
    ("evaluate", "--env", "GripperTactile-v0", "--policy", "pi", "--out"),
    ("train", "--env", "GripperTactile-v0", "--out"),
    ("demo", "--out"),
    ("agents", "--export", "nowhere", "--name", "mine", "--to"),
)
FILES = (
    ("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--film"),
    ("view", "nowhere", "--save"),
    ("preflight", "nowhere", "--out"),
    ("calibrate-sensor", "nowhere", "--out"),
    ("convert", "nowhere.urdf", "--out"),
)


def refused(capsys, *words):
    begun = time.monotonic()
    with pytest.raises(SystemExit) as stop:
        cli.main([*map(str, words)])
    assert stop.value.code == 2
    assert time.monotonic() - begun < 20, "nothing is simulated"
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize("words", FOLDERS, ids=lambda words: words[0])
def test_a_file_where_a_folder_is_wanted_is_refused(words, tmp_path, capsys):
    (tmp_path / "there").write_text("mine")
    assert "this is a file: name a folder" in refused(capsys, *words, tmp_path / "there")
    assert "is a file: name another folder" in refused(capsys, *words, tmp_path / "there" / "below")
    assert (tmp_path / "there").read_text() == "mine"


@pytest.mark.parametrize("words", FILES, ids=lambda words: words[0])
def test_a_folder_or_a_device_where_a_file_is_wanted_is_refused(words, tmp_path, capsys):
    assert "this is a folder: name a file" in refused(capsys, *words, tmp_path)
    if os.path.exists("/dev/null"):
        assert "this is a device or a pipe: name a file" in refused(capsys, *words, "/dev/null")


@pytest.mark.parametrize("words", [FOLDERS[0], FILES[1]], ids=lambda words: words[0])
def test_a_name_that_no_file_can_have_is_refused(words, tmp_path, capsys):
    assert "give another name" in refused(capsys, *words, tmp_path / ("x" * 300))


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc, in which nothing can be made")
@pytest.mark.parametrize("words", [FOLDERS[0], FILES[1]], ids=lambda words: words[0])
def test_where_nothing_can_be_made_it_is_said_before_the_work(words, capsys):
    assert "nothing can be written into" in refused(capsys, *words, "/proc/tiago/out.html")


def test_what_is_tried_leaves_nothing(tmp_path, capsys):
    words = ("diagnose", tmp_path / "nowhere", "--out", tmp_path / "deep" / "out")
    assert cli.main([*map(str, words)]) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_film_that_nothing_here_can_encode_is_refused_before_the_episode(tmp_path):
    words = ["rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--film", str(tmp_path / "a.mp4")]
    env = {**os.environ, "IMAGEIO_FFMPEG_EXE": sys.executable}
    done = subprocess.run([sys.executable, "-m", "tiago_mj.cli", *words], env=env, capture_output=True, check=False)
    assert done.returncode == 2
    assert b".mp4 films cannot be written here" in done.stderr
    assert list(tmp_path.iterdir()) == []
