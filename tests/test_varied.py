"""Numbers without a source, halved and doubled: where they stand, what is changed, and which of a group decided."""

from __future__ import annotations

import importlib
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.varied import sites, told
from benchmarks.varied.__main__ import deciding, groups


def test_every_number_is_one_that_can_be_halved_and_doubled():
    found = sites.sites()
    assert found
    for site in found:
        module, name = site.split(":")
        value = getattr(importlib.import_module(module), name)
        about = 1.0 if name in sites.ABOUT_ONE else 0.0
        assert sites.times(value, 0.5, about) != value or value == 1, site
        assert sites.times(value, 2.0, about) != value, site


def test_what_is_derived_of_a_changed_number_follows():
    said = subprocess.run(
        [
            sys.executable,
            "-c",
            "from benchmarks.varied import sites\n"
            "finder = sites.install({'tiago_mj.gap.search.ranking:INADEQUATE_DISCREPANCY': 0.5})\n"
            "from tiago_mj.gap.search import ranking, rounds\n"
            "print(ranking.INADEQUATE_DISCREPANCY, rounds.HOPELESS_DISCREPANCY, len(finder.left))",
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    from tiago_mj.gap.search import ranking, rounds

    assert [float(word) for word in said] == [
        ranking.INADEQUATE_DISCREPANCY / 2,
        rounds.HOPELESS_DISCREPANCY / 2,
        0,
    ]


def test_what_is_imported_already_is_refused():
    importlib.import_module("tiago_mj.gap.search.ranking")
    with pytest.raises(ImportError, match="imported already"):
        sites.install({"tiago_mj.gap.search.ranking:NEAR_BEST_NATS": 2.0})


@pytest.mark.parametrize(
    ("value", "factor", "about", "expected"),
    [
        (3, 0.5, 0.0, 2),
        (1, 0.5, 0.0, 1),
        (3, 2.0, 0.0, 6),
        (0.25, 2.0, 0.0, 0.5),
        (0.9, 2.0, 1.0, 0.8),
        ((0.9, 1.0), 0.5, 1.0, (0.95, 1.0)),
    ],
)
def test_whole_numbers_stay_whole_and_distances_are_multiplied(value, factor, about, expected):
    assert sites.times(value, factor, about) == pytest.approx(expected)


def test_each_number_of_a_table_is_multiplied():
    assert sites.times({"force": (2.0, 4)}, 0.5) == {"force": (1.0, 2)}


def test_a_word_is_no_number():
    with pytest.raises(TypeError, match="no number"):
        sites.times("verdict.json", 2.0)


def test_a_pass_halves_and_doubles_every_number_once():
    numbers = [f"module:N{i}" for i in range(29)]
    made = groups(numbers, 12, np.random.default_rng(3))
    assert sorted(change for group in made for change in group) == sorted((n, f) for n in numbers for f in (0.5, 2.0))
    assert all(len({name for name, _ in group}) == len(group) <= 12 for group in made)


def test_the_numbers_that_decide_are_found_in_their_group():
    group = tuple((f"n{i}", 2.0) for i in range(12))
    asked = []

    def changes(some):
        asked.append(some)
        return any(name in ("n3", "n8") for name, _ in some)

    assert deciding(group, changes) == ((("n3", 2.0), ("n8", 2.0)), ())
    assert len(asked) < len(group) + 8


def test_of_numbers_that_decide_together_none_is_told_apart():
    group = tuple((f"n{i}", 2.0) for i in range(4))
    assert deciding(group, lambda some: len(some) > 2) == ((), group)


def test_nothing_more_is_asked_of_a_group_that_changes_nothing():
    asked = []
    assert deciding((("a", 2.0), ("b", 0.5)), lambda some: bool(asked.append(some))) == ((), ())
    assert len(asked) == 1


def test_a_comment_says_how_many_answers_changed():
    still = {"tried": 8, "changed": 0, "mended": 0, "broken": 0}
    moved = {"tried": 7, "changed": 2, "mended": 0, "broken": 1}
    assert told.sentence([still, still]) == "Halved and doubled, none of 16 answers about hinges changes (varied.json)."
    assert told.sentence([still, moved]) == (
        "Halved and doubled, 2 of 15 answers about hinges change, 0 to right, 1 to wrong (varied.json)."
    )


@pytest.mark.parametrize("file", list(told.ABOUT))
def test_every_comment_says_what_came_of_its_numbers(file):
    """As counted in the result; a number that its cases never meet is told by another result."""
    together = {}
    for name, tally in told.tallies(told.RESULTS / file).items():
        module, own = name.split(":")
        above = sites.comment((sites.ROOT / f"{module.replace('.', '/')}.py").read_text(), own)
        if f"({file})" in above:
            together.setdefault((module, above), []).append(tally)
    assert together
    for (module, above), tallies in together.items():
        assert told.sentence(tallies, file) in above, module


def test_every_number_is_told_by_a_result():
    told_of = {name for file in told.ABOUT for name in told.tallies(told.RESULTS / file)}
    assert set(sites.sites()) <= told_of
