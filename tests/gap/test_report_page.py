"""The page of a diagnosis: one file, escaped and small, with figures and tables of what was found."""

from __future__ import annotations

import base64
import gzip
import json
import re
import time

import numpy as np
import pytest
from made_diagnoses import CASES, GRIPPER, Read, diagnosis, every_case, overlay, places, replace, squeezed

from tiago_mj.gap.report import html as page
from tiago_mj.gap.report import overlays, shrinking, tables, verdict
from tiago_mj.gap.result import Named, NextMotion, Value
from tiago_mj.recordings.recording import Finding


@every_case
def test_a_page_is_one_small_file_that_needs_nothing_else(name):
    began = time.perf_counter()
    text = page.render(CASES[name])
    # 2 s is what a user may wait; compressing the script takes most of it, once.
    assert time.perf_counter() - began < 2
    assert len(text.encode()) < 6e6
    read = Read(text)
    assert {there for there in read.references if not there.startswith("#")} <= {"data:,"}
    assert all(f'id="{there[1:]}"' in text for there in read.references if there.startswith("#"))
    assert not re.search(r"@import|url\(", text[: text.index("</style>")])
    assert squeezed(verdict.headline(CASES[name])) in squeezed(read.words.replace("\N{WORD JOINER}", ""))
    for heading in ("Where", "Which", "How far", "What remains", "How these numbers were made"):
        assert heading in read.words
    assert "None" not in read.words
    assert "nan" not in read.words.lower().split()


@every_case
def test_figures_hold_to_plotlys_schema_one_per_channel_with_units(name):
    figure_of = pytest.importorskip("plotly.graph_objects").Figure
    scripts = Read(page.render(CASES[name])).scripts
    if not CASES[name].overlays:
        assert scripts == {}
        return
    figures = json.loads(scripts["figures"])
    assert len(figures) == len(CASES[name].overlays[0].measured)
    for figure in figures.values():
        figure_of(figure)  # raises on any unknown key or value
        assert figure["layout"]["xaxis"]["title"]["text"] == "time [s]"
        assert re.search(r"\[.+\]", figure["layout"]["yaxis"]["title"]["text"])
        roles = [trace["meta"]["role"] for trace in figure["data"]]
        assert roles[:2] == ["measured", "nominal"]
        assert ("repaired" in roles) == bool(CASES[name].best.effects)
    script = gzip.decompress(base64.b64decode(scripts["plotly"]))
    assert b"Plotly" in script


def test_what_comes_from_files_is_text_and_never_markup():
    evil = "<script>alert('x')</script>"
    channel = f"force.{evil}"
    rng = np.random.default_rng(0)
    shown = overlay(("force.right",), rng, trial=evil)
    renamed = {
        key: {channel: getattr(shown, key)["force.right"]} for key in ("measured", "nominal", "repaired", "floor")
    }
    given = diagnosis(
        best=(Named("force_lag", (evil,), {"time_constant": Value(0.03, 0.02, 0.04, evil)}),),
        channels=("force.right",),
        overlays=(replace(shown, units={channel: evil}, **renamed),),
        where=tuple(replace(p, channel=channel) for p in places(("force.right",), rng)),
        splits={"train": (evil,), "validation": (evil,), "test": (evil,)},
        findings=(Finding("quantum", evil, evil, evil),),
        notes=(evil,),
        robot=evil,
        command=evil,
        version=evil,
        next_motion=NextMotion(evil, ((evil, evil),), 0.5),
    )
    text = page.render(given)
    assert "<script>alert" not in text
    assert len(Read(text).scripts) == 3, "figures, Plotly, the page's own"
    assert Read(text).words.count(evil) > 10
    figures = json.loads(Read(text).scripts["figures"])
    assert all("<" not in f["layout"]["yaxis"]["title"]["text"] for f in figures.values()), "Plotly reads markup"
    assert all("<" not in trace["hovertemplate"] for f in figures.values() for trace in f["data"])


def test_a_twin_of_what_was_found_is_told_with_it():
    gain = Named("torque_constant", ("gripper_left_finger_joint",), {"factor": Value(0.8, 0.7, 0.9, "-")})
    assert "hardly tell it from servo stiffness." in Read(page.render(diagnosis(best=(gain,)))).words
    assert "hardly tell it" not in Read(page.render(CASES["effect"])).words


def test_the_heat_map_puts_the_loudest_channel_first_and_shares_sum_to_the_whole():
    shown = tables.heat(diagnosis().where)
    assert shown.by_share
    assert shown.rows[0][0] in (GRIPPER[0], GRIPPER[-1])
    total = sum(p.share for p in diagnosis().where)
    assert total == pytest.approx(1)
    strengths = [cell.strength for _, _, cells in shown.rows for cell in cells if cell]
    assert max(strengths) == 1
    assert any(cell is None for _, _, cells in shown.rows for cell in cells), "no contact onset on positions"


def test_a_map_without_excess_shows_the_gap_itself():
    flat = tuple(replace(p, share=0.0) for p in CASES["no_gap"].where)
    shown = tables.heat(flat)
    assert not shown.by_share
    assert all(cell.text for _, _, cells in shown.rows for cell in cells if cell)


@pytest.mark.parametrize(
    ("gap", "said"),
    [
        (0.0049, "0"),
        (0.056, "0.1"),
        (0.97, "1"),
        (9.84, "9.8"),
        (9.97, "10"),
        (62.3, "62"),
        (99.8, "100"),
        (264, "260"),
    ],
)
def test_a_gap_fits_into_its_narrow_cell(gap, said):
    place = replace(CASES["no_gap"].where[0], share=0.0, gap=gap)
    cells = [cell for _, _, row in tables.heat((place,)).rows for cell in row if cell]
    assert [cell.text for cell in cells] == [said]


def test_before_and_after_stand_side_by_side_by_channel_and_phase_and_what_got_worse_is_marked():
    given = diagnosis()
    shown = shrinking.by_phase(given)
    names = [name for name, _ in shown.rows]
    gaps = [given.shrink.per_channel[name].before for name in names[:-1]]
    assert names[-1] == "all"
    assert gaps == sorted(gaps, reverse=True)
    cells = {(name, phase): cell for name, row in shown.rows for phase, cell in zip(shown.phases, row, strict=True)}
    assert cells[GRIPPER[0], "contact onset"] is None
    assert [key for key, cell in cells.items() if cell and cell.worse] == [(GRIPPER[3], "free motion")]
    loudest = cells[GRIPPER[0], "rest"]
    assert (loudest.before, loudest.after) == ("3000", "1.1")
    assert loudest.strong_before == 1 > loudest.strong_after
    assert "over 99.9 % closed (95 to over 99.9 %)" in loudest.hover
    assert Read(page.render(given)).words.count("beforeafter") == len(shown.phases) + 1  # once by channel


def test_a_gap_near_the_floor_has_no_loud_colour():
    shown = shrinking.by_phase(CASES["no_gap"])
    assert max(cell.strong_before for _, cells in shown.rows for cell in cells) < 0.1


def test_returns_are_drawn_on_one_axis_with_their_trials():
    shown = shrinking.on_the_task(diagnosis())
    nominal, repaired, measured = shown.rows
    assert 0 <= repaired.at < measured.at < nominal.at <= 100
    assert nominal.low < nominal.at < nominal.high
    assert len(nominal.trials) == 2
    assert 3 <= len(shown.ticks) <= 6
    assert nominal.text == "−204.7"
    assert nominal.between == "−211 to −199"


def test_a_return_that_was_not_measured_is_left_open():
    shown = shrinking.on_the_task(CASES["never_measured"])
    assert [row.at is None for row in shown.rows] == [False, False, True]
    assert "It was not measured" in Read(page.render(CASES["never_measured"])).words
    assert shrinking.on_the_task(CASES["no_test_trial"]) is None


def test_thinning_a_long_signal_keeps_its_peaks_and_its_pauses():
    t = np.arange(200_000) / 1000
    y = np.sin(t)
    y[12_345], y[150_001] = 9.0, -7.0
    y[60_000:80_000] = np.nan
    x, thin = overlays.thinned(t, y, 1000)
    assert len(x) == len(thin) <= 1100
    known = [v for v in thin if v is not None]
    assert max(known) == 9.0
    assert min(known) == -7.0
    assert thin.count(None) == 1
    at = thin.index(None)
    assert 60 < x[at] < 80
    assert x == sorted(x)


def test_a_signal_that_is_sampled_in_every_third_row_is_still_a_line():
    t = np.arange(90) / 30
    y = np.where(np.arange(90) % 3 == 0, t, np.nan)
    x, shown = overlays.thinned(t, y, 500)
    assert len(x) == 30
    assert None not in shown


def test_phases_are_stretches_and_a_flickering_one_is_bounded():
    t = np.arange(6.0)
    assert overlays.stretches(t, np.array([0, 0, 1, 1, 1, 5])) == [(0, 0.0, 2.0), (1, 2.0, 5.0), (5, 5.0, 5.0)]
    flicker = np.arange(10_000) % 2
    assert len(overlays.stretches(np.arange(10_000.0), flicker)) <= overlays.STRETCHES + 1
    assert overlays.stretches(np.empty(0), np.empty(0, int)) == []
