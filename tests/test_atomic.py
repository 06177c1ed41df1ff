"""Files that belong together appear together, or not at all; other files stay."""

from __future__ import annotations

import os
import stat
import subprocess
import sys

import pytest

from tiago_mj.io import atomic

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


@pytest.mark.skipif(sys.platform != "linux", reason="only there folders are exchanged")
def test_a_folder_in_which_another_process_works_stays_the_same_folder(tmp_path):
    folder = tmp_path / "out"
    write(folder / "sub", "first")
    before = folder.stat().st_ino
    with subprocess.Popen(["sleep", "60"], cwd=folder / "sub") as other:
        write(folder, "second")
        other.kill()
    assert folder.stat().st_ino == before
    assert {(folder / name).read_text() for name in NAMES} == {"second"}


def test_a_folder_with_folders_in_it_keeps_them(tmp_path):
    folder = tmp_path / "out"
    write(folder, "first")
    (folder / "sub").mkdir()
    (folder / "sub" / "note.txt").write_text("mine")
    write(folder, "second")
    assert (folder / "sub" / "note.txt").read_text() == "mine"
    assert {(folder / name).read_text() for name in NAMES} == {"second"}


def test_what_belongs_to_the_old_set_and_not_to_the_new_one_goes(tmp_path):
    folder = tmp_path / "out"
    write(folder, "first")
    (folder / "notes.txt").write_text("mine")
    with atomic.replacing_set(folder, parts=NAMES) as new:
        (new / NAMES[0]).write_text("second")
    assert contents(folder) == {NAMES[0]: "second", "notes.txt": "mine"}


@pytest.mark.parametrize("inside", [False, True], ids=["elsewhere", "standing in it"])
def test_folders_of_a_set_are_merged_with_those_that_are_there(inside, tmp_path, monkeypatch):
    folder = tmp_path / "out"
    (folder / "sub").mkdir(parents=True)
    for name in ("a.txt", "mine.txt"):
        (folder / "sub" / name).write_text("first")
    if inside:
        monkeypatch.chdir(folder)
    with atomic.replacing_set(folder) as new:
        (new / "sub" / "deep").mkdir(parents=True)
        (new / "sub" / "a.txt").write_text("second")
        (new / "sub" / "deep" / "b.txt").write_text("second")
    found = {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*.txt")}
    assert found == {"sub/a.txt": "second", "sub/mine.txt": "first", "sub/deep/b.txt": "second"}


def test_a_link_to_a_folder_stays_a_link(tmp_path):
    write(tmp_path / "real", "first")
    (tmp_path / "out").symlink_to(tmp_path / "real")
    write(tmp_path / "out", "second")
    assert (tmp_path / "out").is_symlink()
    assert contents(tmp_path / "real") == dict.fromkeys(NAMES, "second")


def test_links_and_modes_in_the_folder_stay_as_they_are(tmp_path):
    folder = tmp_path / "out"
    write(folder, "first")
    folder.chmod(0o750)
    (folder / "link").symlink_to(NAMES[0])
    write(folder, "second")
    assert folder.stat().st_mode & 0o777 == 0o750
    assert os.readlink(folder / "link") == NAMES[0]


@pytest.fixture
def of_another(tmp_path):
    """A folder, with one in it, of another user and group, who have no names here."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only root gives files away")
    folder = tmp_path / "out"
    write(folder, "first")
    (folder / "sub").mkdir()
    (folder / "sub" / "mine.txt").write_text("mine")
    for path in (folder, folder / "sub"):
        os.chown(path, 54321, 54322)
    return folder


def test_a_folder_of_another_user_and_group_stays_theirs(of_another):
    write(of_another, "second")
    assert {(path.stat().st_uid, path.stat().st_gid) for path in (of_another, of_another / "sub")} == {(54321, 54322)}
    assert (of_another / NAMES[0]).read_text() == "second"
    assert (of_another / "sub" / "mine.txt").read_text() == "mine"


def test_a_folder_that_could_not_stay_its_owners_is_not_exchanged(of_another, monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "chown", refuse)
    before = of_another.stat()
    write(of_another, "second")
    assert os.path.samestat(before, of_another.stat())
    assert (of_another / NAMES[0]).read_text() == "second"
    assert [path.name for path in of_another.parent.iterdir()] == ["out"]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere groups are handed on without the bit")
def test_a_new_folder_hands_its_group_on_where_the_one_around_it_does(tmp_path):
    tmp_path.chmod(0o2755)
    write(tmp_path / "out", "first")
    assert (tmp_path / "out").stat().st_mode & stat.S_ISGID


def test_what_is_gathered_comes_elsewhere(tmp_path):
    with atomic.gathering(tmp_path / "out", tmp_path / "kept"):
        write(tmp_path / "out" / "one", "first")
        write(tmp_path / "apart", "first")
    assert contents(tmp_path / "kept" / "one") == contents(tmp_path / "apart") == dict.fromkeys(NAMES, "first")
    assert not (tmp_path / "out").exists()
