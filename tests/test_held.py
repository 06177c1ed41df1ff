"""What a killed process left is removed by the next one, and what another one is writing is not."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import threading
import time
from contextlib import ExitStack

import pytest

from tiago_mj.io import atomic, held

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="files cannot be locked there")


def hang(folder, kind):
    with atomic.replacing(folder / "a.txt") if kind == "file" else atomic.replacing_set(folder / "a") as new:
        if kind != "file":
            (new / "part.txt").write_text("half")
        time.sleep(60)


@pytest.fixture(params=["file", "set"])
def writer(request, tmp_path):
    process = multiprocessing.get_context("spawn").Process(target=hang, args=(tmp_path, request.param))
    process.start()
    until = time.monotonic() + 30
    while not list(tmp_path.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.01)
    time.sleep(0.1)
    yield process
    process.kill()
    process.join()


def test_what_another_process_writes_is_left_and_what_a_killed_one_left_is_removed(writer, tmp_path):
    atomic.write_text(tmp_path / "mine.txt", "mine")
    assert len(list(tmp_path.iterdir())) == 2
    os.kill(writer.pid, signal.SIGKILL)
    writer.join()
    with atomic.replacing_set(tmp_path / "other") as new:
        (new / "a.txt").write_text("a")
    assert {path.name for path in tmp_path.iterdir()} == {"mine.txt", "other"}


def test_files_that_only_look_alike_stay(tmp_path):
    for name in (".mine", "a.tiago_mj-1.txt", ".a.part"):
        (tmp_path / name).write_text("mine")
    held.sweep(tmp_path)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_second_process_in_a_folder_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(held, "PATIENCE", 0.0)
    with (
        held.alone(tmp_path / "out", "training"),
        pytest.raises(ValueError, match="another process is training in"),
        held.alone(tmp_path / "out", "training"),
    ):
        pass
    with held.alone(tmp_path / "out", "training"):
        pass


def test_who_expects_the_lock_of_a_lost_machine_waits_longer(tmp_path, monkeypatch):
    monkeypatch.setattr(held, "PATIENCE", 0.0)
    with ExitStack() as other:
        other.enter_context(held.alone(tmp_path / "out", "training"))
        threading.Timer(0.5, other.close).start()
        with held.alone(tmp_path / "out", "training", patience=30.0):
            pass


def test_who_waited_for_a_folder_that_was_then_removed_makes_it_anew(tmp_path):
    folder, entered = tmp_path / "kept", []

    def second():
        with held.alone(folder, "diagnosing"):
            entered.append(folder.is_dir() and (folder / held.LOCK).exists())

    with held.alone(folder, "diagnosing"):
        other = threading.Thread(target=second)
        other.start()
        time.sleep(0.3)
        assert not entered
        shutil.rmtree(folder)
    other.join()
    assert entered == [True]
