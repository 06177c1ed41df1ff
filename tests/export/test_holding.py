"""The table of effects and targets is complete, and the page is that of the declarations."""

import importlib.util
from pathlib import Path

import pytest

from tiago_mj.effects import EFFECTS
from tiago_mj.export import holding
from tiago_mj.export.targets.registry import TARGETS

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_that_of_the_declarations():
    spec = importlib.util.spec_from_file_location("make_export_page", DOCS / "make_export_page.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (DOCS / "export.md").read_text(encoding="utf-8") == module.page(), "run python docs/make_export_page.py"


def test_every_effect_and_target_is_in_the_table_once():
    effects = holding.library()
    assert len(effects) == len(set(effects)) == 53
    assert set(holding.QUANTITIES) <= set(EFFECTS)
    table = holding.table({name: one.holds for name, one in TARGETS.items()}, effects).splitlines()
    assert [row.split("`")[1] for row in table[2:]] == effects
    assert all(row.count("|") == 2 + len(TARGETS) for row in table)


@pytest.mark.parametrize("name", TARGETS)
def test_every_cell_has_a_reason_and_every_quantity_an_effect(name):
    target = TARGETS[name]
    known = {holding.quantity(effect) for effect in EFFECTS} | set(holding.NOWHERE)
    assert set(target.holds) <= known
    for effect in holding.library():
        one = holding.held(target.holds, effect)
        assert one.grade in ("exact", "approximate", "not")
        assert len(one.how) > 5
        assert one.how[-1] != "."


def test_what_nobody_declared_is_not_held():
    assert holding.held({}, "command_delay").grade == "not"
    assert holding.held({"joint_sensor": holding.exact("there")}, "encoder_bias").grade == "exact"
