"""A diagnosis's page in a browser: captured whole and printed it has its figures, and it is no wider than a phone."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "gap"))
from made_diagnoses import CASES, LONG, diagnosis

from tiago_mj.gap.report import html

WAITING = "document.querySelectorAll('.plot .waiting').length"
DRAWN = "document.querySelectorAll('.plot .main-svg').length"


def opened(page, tmp_path, given):
    path = tmp_path / "report.html"
    path.write_text(html.render(given), encoding="utf-8")
    page.goto(path.as_uri())


def emptied(page, selector):
    """Wait until there is none; not by a function of the page, as its policy lets no text be evaluated."""
    from playwright.sync_api import expect

    expect(page.locator(selector)).to_have_count(0, timeout=90_000)


@pytest.mark.slow
def test_a_page_that_nobody_scrolls_has_all_its_figures(page, tmp_path):
    opened(page, tmp_path, CASES["effect"])
    count = page.evaluate("document.querySelectorAll('.plot').length")
    emptied(page, ".plot .waiting")
    assert page.evaluate("scrollY") == 0
    assert page.evaluate(DRAWN) >= count == 6


@pytest.mark.slow
def test_a_printed_page_has_the_figures_of_its_folded_parts(page, tmp_path):
    opened(page, tmp_path, diagnosis(channels=LONG))
    emptied(page, ".plot:not(details .plot) .waiting")
    assert page.evaluate(WAITING) == len(LONG) - html.DRAWN, "what is folded away is not drawn before"
    page.pdf(path=tmp_path / "report.pdf")
    assert page.evaluate(WAITING) == 0
    assert (tmp_path / "report.pdf").stat().st_size > 100_000


@pytest.mark.slow
@pytest.mark.parametrize("name", ["effect", "ambiguous_three", "unknown_with_known", "twelve_long_channels"])
def test_no_verdict_is_wider_than_a_phone(name, page, tmp_path):
    page.set_viewport_size({"width": 390, "height": 844})
    opened(page, tmp_path, replace(CASES[name], limits={"joint": {"gripper_right_finger_joint": 16.0}}))
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.get_by_role("heading", name="What to do now").bounding_box()["y"] < 2 * 844


@pytest.mark.slow
def test_a_script_that_got_into_the_page_does_not_run(page, tmp_path):
    text = html.render(CASES["effect"])
    for there, script in (
        ("</main>", "<script>window.ran = 1</script>"),
        ("<h1", "<img src=x onerror='window.ran = 2'>"),
    ):
        assert there in text
        text = text.replace(there, script + there, 1)
    path = tmp_path / "report.html"
    path.write_text(text, encoding="utf-8")
    refused = []
    page.expected = refused
    page.on("console", lambda said: refused.append(said.text))
    page.goto(path.as_uri())
    emptied(page, ".plot .waiting")
    assert page.evaluate("window.ran") is None
    assert any("Content Security Policy" in words for words in refused)
