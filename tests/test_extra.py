"""How an extra is installed: from the clone, into the interpreter that lacks it."""

import importlib.metadata
import json
import shlex
import sys
from pathlib import Path

import pytest

from tiago_mj.io import extra


class Installed:
    """A distribution as pip leaves it."""

    def __init__(self, said):
        self.said = said

    def read_text(self, name):
        assert name == "direct_url.json"
        return self.said


@pytest.fixture
def installed(monkeypatch):
    def give(said):
        monkeypatch.setattr(importlib.metadata, "distribution", lambda name: Installed(said))

    return give


def said_of(folder, *, editable):
    return json.dumps({"url": folder.as_uri(), "dir_info": {"editable": True} if editable else {}})


@pytest.mark.parametrize("editable", [False, True])
def test_from_the_clone_wherever_it_is_and_as_it_was_installed(tmp_path, installed, editable):
    folder = tmp_path / "my clone"
    folder.mkdir()
    (folder / "constraints.txt").touch()
    installed(said_of(folder, editable=editable))
    words = shlex.split(extra.install("train"))
    assert words[:4] == [sys.executable, "-m", "pip", "install"]
    assert words[4:6] == ["-c", str(folder / "constraints.txt")]
    assert words[6:] == ["-e"] * editable + [f"{folder}[train]"]
    assert shlex.split(extra.install(None))[-1] == str(folder)


@pytest.mark.parametrize("said", [None, "", "{", '{"url": "https://example.org/a.whl"}', '{"url": "file:///gone"}'])
def test_where_no_clone_is_known_it_is_for_the_folder_of_one(installed, said):
    installed(said)
    words = shlex.split(extra.install("train"), comments=True)
    assert words[-3:] == ["-c", "constraints.txt", ".[train]"]
    assert "clone" in extra.install("train")


def test_without_a_distribution_too(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    assert extra.clone() == (None, False)


def test_the_command_of_the_page_on_installing_is_that_of_reports():
    assert extra.in_clone("gap") in Path(__file__).parents[1].joinpath("docs", "install.md").read_text(encoding="utf-8")
