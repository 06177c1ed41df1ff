"""Pages that hold names from other people's files: what is hidden is shown, and what a page may do is little."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tiago_mj.io import pages

sys.path.insert(0, str(Path(__file__).parent / "gap"))
from made_diagnoses import CASES

from tiago_mj.gap.report import html

EVIL = "grasp\u202egnp.\u200bexe<script>alert(1)</script>"


@pytest.fixture(scope="module")
def page():
    given = CASES["effect"]
    trials = tuple(replace(overlay, trial=EVIL) for overlay in given.overlays)
    return html.render(replace(given, robot=EVIL, overlays=trials))


def test_hidden_characters_of_names_are_shown_escaped(page):
    assert not re.search("[\u200b-\u200f\u202a-\u202e\u2066-\u2069]", page)
    assert "grasp\\u202egnp.\\u200bexe&lt;script&gt;" in page
    assert "<script>alert" not in page


def test_a_figure_shows_them_escaped_too():
    assert pages.shown({"name": ["a\u202eb", 1.0, None]}) == {"name": ["a\\u202eb", 1.0, None]}


def test_the_report_names_its_two_scripts_by_their_hashes_and_allows_no_other(page):
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)[1]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert len(re.findall(r"'sha256-[A-Za-z0-9+/]{43}='", rules["script-src"])) == 2
    assert "unsafe" not in rules["script-src"]
    assert "http" not in policy
    own = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(own) == 1
    assert str(pages.of_page(own)).split("'sha256-")[1].split("'")[0] in rules["script-src"]
