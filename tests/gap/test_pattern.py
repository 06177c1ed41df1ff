"""Verdicts with many terms: a sentence says the pattern, a table has the terms."""

from __future__ import annotations

import pytest
from made_diagnoses import diagnosis, replace

from tiago_mj.gap.report import html, pattern, terminal, verdict
from tiago_mj.gap.report import json as report_json
from tiago_mj.gap.result import Explanation, Named, Value

JOINTS = tuple(f"J{k}" for k in range(1, 7))


def term(name, joint, key, value, unit):
    return Named(name, (joint,), {key: Value(value, 0.9 * value, 1.1 * value, unit)})


def friction(joints=JOINTS):
    return tuple(term("coulomb_friction", j, "force", 1.9 + 1.3 * k, "N·m") for k, j in enumerate(joints))


def rotors(joints=JOINTS[:4]):
    return tuple(term("armature", j, "inertia", 0.1 * (k + 1), "kg·m²") for k, j in enumerate(joints))


def of(best, **changes):
    return diagnosis(best=best, channels=tuple(f"effort.{j}" for j in JOINTS), **changes)


def test_a_dozen_terms_are_told_as_a_pattern_with_where_and_between_which_values():
    said = verdict.headline(of((*friction(), *rotors())))
    assert said.startswith(
        "The simulator lacks Coulomb friction on all six joints, 1.9 to 8.4 N·m; and armature on J1 to J4, 0.1 to "
        "0.4 kg·m²; adding all of them closes 93 % (88–96 %) of the gap on recordings that were kept aside"
    )


def test_more_kinds_than_a_sentence_holds_are_counted():
    gains = tuple(term("torque_constant", j, "factor", 0.9 + 0.1 * k, "-") for k, j in enumerate(JOINTS[:3]))
    others = (term("viscous_friction", "J2", "damping", 3.0, "N·m·s/rad"), term("payload", "J6", "mass", 2.0, "kg"))
    said = pattern.in_short((*friction(), *rotors(), *gains, *others), frozenset(JOINTS))
    assert said.endswith("; torque constant on J1 to J3, factor 0.9 to 1.1; and two further terms")
    assert said.count(";") == 3


def test_all_joints_are_said_only_where_these_are_all_and_a_run_only_where_none_is_left_out():
    assert "on J1 to J6" in pattern.in_short(friction())
    gap = pattern.in_short(friction((*JOINTS[:2], *JOINTS[3:5])), frozenset(JOINTS))
    assert "on J1, J2, J4 and J5, 1.9 to 5.8 N·m" in gap
    assert pattern.run(("arm_3_joint", "arm_1_joint", "arm_2_joint")) == ("arm_1_joint", "arm_3_joint")
    assert pattern.run(("shoulder", "elbow", "wrist")) is None
    assert pattern.run(("arm_1", "leg_2", "arm_3")) is None


def test_slides_and_hinges_have_values_of_their_own():
    both = (*friction(JOINTS[:3]), term("coulomb_friction", "lift", "force", 120.0, "N"))
    assert pattern.in_short(both).endswith("1.9 to 4.5 N·m and 120 N")


def test_what_rivals_share_is_said_once_and_what_tells_them_apart_beside_it():
    load = Named("payload", ("J6",), {"mass": Value(2.0, 1.8, 2.2, "kg")})
    rivals = [Explanation((*friction(), load), 0.5, 40.0), Explanation(friction(), 0.4, 39.0)]
    said = verdict.headline(of(rivals[0].effects, kind="ambiguous", alternatives=rivals))
    assert said.count("Coulomb friction") == 1
    assert "on all six joints, 1.9 to 8.4 N·m; beside that payload on J6 – or nothing more" in said
    assert "these recordings cannot tell which" in said


@pytest.mark.parametrize("count", [3, 4])
def test_the_terms_stand_one_by_one_in_a_table_where_the_sentence_has_only_the_pattern(count):
    found = of(friction(JOINTS[:count]))
    said = [line for _, line in terminal.lines(found, {})]
    assert ("Term by term" in said) == (count > 3)
    assert all(any(joint in line and "N·m (" in line for line in said) for joint in JOINTS[:count])
    assert ('<table class="terms">' in html.render(found)) == (count > 3)


def test_the_file_begins_with_the_same_sentence_as_every_report():
    found = of((*friction(), *rotors()))
    data = report_json.as_data(replace(found, headline="of an earlier version"))
    assert list(data)[1] == "headline"
    assert data["headline"] == verdict.headline(found)
