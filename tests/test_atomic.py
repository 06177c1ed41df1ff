"""Files that belong together appear together, or not at all; other files stay."""

from __future__ import annotations

import os

import pytest

from tiago_mj import atomic

NAMES = ("a.json", "b.yaml")


def write(folder, text):
    with atomic.replacing_set(folder) as new:
        for name in NAMES:
            (new / name).write_text(text)


def fail(folder):
    with atomic.replacing_set(folder) as new:
        (new / NAMES[0]).write_text("second")
        raise OSError("disk is full")


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize("others", [{}, {"notes.txt": "mine"}], ids=["alone", "beside a note"])
def test_a_second_run_replaces_the_files_of_the_first_and_leaves_the_others(tmp_path, others):
    folder = tmp_path / "deep" / "out"
    write(folder, "first")
    for name, text in others.items():
        (folder / name).write_text(text)
    write(folder, "second")
    assert contents(folder) == {**dict.fromkeys(NAMES, "second"), **others}
    assert [path.name for path in folder.parent.iterdir()] == ["out"]


def test_what_fails_in_the_middle_leaves_the_files_of_before(tmp_path):
    folder = tmp_path / "out"
    write(folder, "first")
    with pytest.raises(OSError, match="disk is full"):
        fail(folder)
    assert contents(folder) == dict.fromkeys(NAMES, "first")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_in_which_somebody_stands_stays_the_same_folder(tmp_path, monkeypatch):
    folder = tmp_path / "out"
    write(folder, "first")
    monkeypatch.chdir(folder)
    write(folder, "second")
    assert {name: (tmp_path / "out" / name).read_text() for name in os.listdir(".")} == dict.fromkeys(NAMES, "second")


def test_a_folder_with_folders_in_it_keeps_them(tmp_path):
    folder = tmp_path / "out"
    write(folder, "first")
    (folder / "sub").mkdir()
    (folder / "sub" / "note.txt").write_text("mine")
    write(folder, "second")
    assert (folder / "sub" / "note.txt").read_text() == "mine"
    assert {(folder / name).read_text() for name in NAMES} == {"second"}
