"""docs/effects.md says what the declarations say, and they say all that it needs."""

import importlib.util
import re
from pathlib import Path

import pytest

from tiago_mj.effects import EFFECTS, describe

DOCS = Path(__file__).parents[2] / "docs"
LIBRARY = [name for name, declared in EFFECTS.items() if declared.__module__.startswith("tiago_mj.")]


@pytest.fixture(scope="module")
def generator():
    spec = importlib.util.spec_from_file_location("make_effects_page", DOCS / "make_effects_page.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_that_of_the_declarations(generator):
    written = (DOCS / "effects.md").read_text(encoding="utf-8")
    assert written == generator.page(), "run python docs/make_effects_page.py"


def test_the_pages_python_runs():
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "effects.md").read_text(encoding="utf-8"), re.S)
    names = {}
    for block in blocks:
        exec(block, names)
        names["env"].reset(seed=0)
    assert len(blocks) == 2


#: How a sentence on where to look begins: with what one does.
VERBS = ("look", "compare", "turn", "weigh", "put", "measure", "hold", "load", "leave", "read", "move", "start")


@pytest.mark.parametrize("name", LIBRARY)
def test_a_declaration_says_in_one_plain_line_where_to_look_on_the_robot(name):
    check = describe(EFFECTS[name]).check
    assert check.split()[0] in VERBS, "it says what to do"
    assert check[-1] in ".?"
    assert len(re.findall(r"[.?!](?:\s|$)", check)) <= 2, "one sentence, or a test and where to look"
    assert 3 <= len(check.split()) <= 22
    assert len(check) <= 110
    assert not re.search(r"[`_={}\\]", check), "for a reader without the code"


def test_no_two_effects_but_those_of_one_stage_are_looked_for_in_the_same_way():
    by = {}
    for name in LIBRARY:
        by.setdefault(describe(EFFECTS[name]).check, []).append(EFFECTS[name].stage)
    assert all(len(set(stages)) == 1 and len(stages) <= 2 for stages in by.values())


@pytest.mark.parametrize("name", LIBRARY)
def test_a_declaration_says_what_it_is_how_it_looks_and_where_its_magnitude_is_from(name, generator):
    declared = EFFECTS[name]
    told = describe(declared)
    for part in ("what", "formula", "looks", "typical", "source"):
        assert getattr(told, part), part
    assert all(key in told.formula for key in declared.parameters), "the formula names every parameter"
    known = (*generator.SOURCES, "chosen", "llach/", "the paper")
    assert any(source in told.source for source in known), told.source
    if told.source != "chosen.":
        assert re.search(r"\d", told.typical), "a source is of a number"


def test_a_docstring_without_labels_is_what_the_effect_is():
    class Plain:
        """One paragraph.

        And another,
        of two lines.
        """

    told = describe(Plain)
    assert told.what == "One paragraph.\n\nAnd another, of two lines."
    assert (told.formula, told.source) == ("", "")
