"""``tiago-mj view`` on the command line: its complaints, its file, its end."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from tiago_mj.cli import main

pytest.importorskip("viser")


def complaint(capsys, *words):
    assert main(["view", *map(str, words)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "give --env ID, or recordings"),
        (["--env", "Nothing-v0"], "unknown"),
        (["--env", "GripperTactile-v0", "--policy", "nobody"], "unknown"),
        (["--env", "GripperTactile-v0", "--effects", '{"backlash": {"width": 9}}'], "backlash"),
        (["--env", "GripperTactile-v0", "--save", "scene.html"], "--save is of recordings"),
        (["--env", "GripperTactile-v0", "--fix-base"], "--fix-base is of recordings"),
        (["--env", "GripperTactile-v0", "--robot", "go2"], "--robot is of recordings"),
        (["logs", "--model", "arm.xml", "--robot", "go2"], "--model and --robot say which robot this is: give one"),
        (["--env", "GripperTactile-v0", "--port", "99999"], "--port is 99999"),
        (["nowhere.csv"], "nowhere.csv"),
    ],
)
def test_bad_input_is_one_line(capsys, words, said):
    assert said in complaint(capsys, *words)


def test_recordings_and_a_diagnosis_that_do_not_fit(capsys, recorded, diagnosed, tmp_path):
    assert "no such folder" in complaint(capsys, recorded, "--diagnosis", tmp_path / "none")
    assert "no diagnosis at" in complaint(capsys, recorded, "--diagnosis", tmp_path)
    assert "--policy is of an environment" in complaint(capsys, recorded, "--policy", "pi")
    assert "there is no such recording" in complaint(capsys, recorded, "--trial", "other", "--save", "a.html")
    assert "name an HTML file" in complaint(capsys, recorded, "--save", "scene.viser")
    other = complaint(capsys, recorded, "--env", "GripperClose-v0", "--diagnosis", diagnosed)
    assert "GripperTactile-v0" in other


def test_a_port_in_use_is_one_line(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        said = complaint(capsys, "--env", "GripperTactile-v0", "--port", port)
    assert f"--port {port}: another program listens there" in said


def test_the_saved_page_is_whole_and_needs_nothing_else(recorded, diagnosed, tmp_path, capsys):
    path = tmp_path / "scene.html"
    assert main(["view", str(recorded), "--diagnosis", str(diagnosed), "--save", str(path)]) == 0
    said = capsys.readouterr().out
    assert "pi-001" in said
    assert "viser" not in said
    text = path.read_text()
    assert len(text) < 5e6
    assert "__VISER_EMBED_DATA__" in text
    assert "Coulomb friction on every joint" in text
    assert "simulated − measured [mm]" in text
    assert 'src="http' not in text
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_without_a_trace(number):
    words = ["view", "--env", "GripperTactile-v0", "--port", "0"]
    program = subprocess.Popen(
        [sys.executable, "-m", "tiago_mj.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        line = program.stdout.readline()
        assert line.startswith("watch it at http://127.0.0.1:")
        port = int(line.split(":")[2].split(";")[0])
        socket.create_connection(("127.0.0.1", port), timeout=5).close()
        time.sleep(0.5)
        program.send_signal(number)
        out, err = program.communicate(timeout=30)
    finally:
        program.kill()
    assert program.returncode == 0
    assert (out, err) == ("", "")
    with socket.socket() as free, pytest.raises(ConnectionRefusedError):
        free.connect(("127.0.0.1", port))


SIGNALLED = """
import os, random, signal, threading
from tiago_mj.view.server import wait
rng = random.Random(0)
for _ in range(200):
    soon = [threading.Timer(rng.uniform(0, 2e-3), os.kill, (os.getpid(), signal.SIGTERM))]
    # Begun in the first call: a signal that comes before it waits ends any program.
    wait(lambda: soon.pop().start() if soon else None, 0.0)
"""


def test_it_ends_whenever_it_is_told():
    """An Event's lock, held where the signal came, kept one in some hundred from ending."""
    program = subprocess.Popen([sys.executable, "-c", SIGNALLED])
    try:
        assert program.wait(timeout=60) == 0
    finally:
        program.kill()
