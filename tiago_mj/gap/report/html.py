"""``report.html``: one file that needs nothing else, neither network nor another file.

Plotly's script is in it, compressed, and unpacked by the browser after the text has been drawn; figures are drawn as
they come into view. Whatever comes from files is escaped.
"""

from __future__ import annotations

import base64
import functools
import gzip
import re
from importlib import resources
from pathlib import Path
from typing import Any, Final, Protocol

import jinja2
from markupsafe import Markup, escape

from tiago_mj.gap.report import (
    advice,
    commands,
    like_parts,
    overlays,
    pattern,
    residual,
    shrinking,
    tables,
    verdict,
    words,
)
from tiago_mj.gap.report.consistency import has_probability
from tiago_mj.gap.report.contradiction import checked
from tiago_mj.gap.result import PHASES, Diagnosis
from tiago_mj.io import atomic, extra, pages
from tiago_mj.recordings.lint.summary import summary

KIND_NAMES: Final = {
    "no_gap": "no gap",
    "effect": "effect named",
    "ambiguous": "ambiguous",
    "unknown": "unknown cause",
}
#: In their place where the search did not come to its end.
NOT_FINISHED: Final = "search not finished"
#: Rows of the ranking that are shown at once, and channels whose figures are.
RANKED, DRAWN = 10, 6


class Seen(Protocol):
    """Pictures of the robots (:class:`tiago_mj.view.beside.Pictures`)."""

    @property
    def scene(self) -> str | None:
        """A page of its own, written as ``scene.html``; None: there is none."""

    @property
    def png(self) -> str:
        """A still, base64; empty: there is none."""

    @property
    def caption(self) -> str:
        """Of the still."""


def render(diagnosis: Diagnosis, seen: Seen | None = None) -> str:
    """The page, with pictures of the robots where there are some."""
    diagnosis = checked(diagnosis)
    environment = _environment(diagnosis)
    drawn = _drawn(diagnosis)
    packed = _packed() if drawn else ""
    script = Markup(environment.get_template("report.js").render(phase_names=PHASES))
    return environment.get_template("report.html.j2").render(
        d=diagnosis,
        kind=KIND_NAMES.get(diagnosis.kind, diagnosis.kind) if diagnosis.complete else NOT_FINISHED,
        headline=verdict.headline(diagnosis),
        remainder=verdict.remainder(diagnosis),
        left_looks=residual.sentences(diagnosis),
        on_model=verdict.on_model(diagnosis),
        sure=verdict.sure(diagnosis),
        told=has_probability(diagnosis),
        part=verdict.part_only(diagnosis),
        ranked_told=has_probability(diagnosis) or diagnosis.kind == "no_gap",
        likelier=verdict.first(diagnosis),
        nothing_more=verdict.nothing_more(diagnosis),
        many=words.MANY,
        best=[tables.shown(effect) for effect in diagnosis.best.effects],
        heat=tables.heat(diagnosis.where, shares=diagnosis.kind != "no_gap"),
        heat_remains=tables.heat(diagnosis.remains_where) if diagnosis.remains else None,
        interval=tables.interval,
        stages=[(stage, name, stage in residual.stages(diagnosis)) for stage, name in tables.STAGE_NAMES.items()],
        several=len(residual.stages(diagnosis)) > 1,
        shrinking=shrinking.by_channel(diagnosis),
        pairs=shrinking.by_phase(diagnosis),
        task=shrinking.on_the_task(diagnosis),
        on_task=verdict.on_task(diagnosis),
        between=words.interval_percent(diagnosis.shrink.low, diagnosis.shrink.high),
        ranking=tables.ranking(diagnosis),
        numbers=tables.numbers(diagnosis),
        like_parts=like_parts.sentences(diagnosis),
        three_figures=verdict.with_numbers(diagnosis),
        ranked=RANKED,
        not_excited=tables.not_excited(diagnosis),
        lint=summary(diagnosis.findings),
        advice=advice.advice(diagnosis),
        load=commands.load(diagnosis),
        ceiling=verdict.ceiling(diagnosis.best, replays=diagnosis.replays) if has_probability(diagnosis) else "",
        why_ceiling=verdict.why_ceiling(replays=diagnosis.replays),
        overlays=drawn,
        figures=pages.shown({row["id"]: row["figure"] for trial in drawn for row in trial["rows"]}),
        drawn=DRAWN,
        phase_names=PHASES,
        phases=list(dict.fromkeys(p for trial in drawn for p in trial["phases"])),
        plotly=packed,
        script=script,
        policy=pages.of_page([script, _plotly()] if drawn else []),
        seen=seen,
    )


def _environment(diagnosis: Diagnosis) -> jinja2.Environment:
    """Templates with the words and figures of a diagnosis as filters."""
    environment = pages.environment("tiago_mj.gap.report")
    environment.filters.update(
        number=words.number,
        percent=words.percent,
        channel=words.channel,
        begin=words.begin,
        labels=functools.partial(pattern.labels, of=pattern.joints(diagnosis)),
        bare=words.bare,
        glued=glued,
        coded=coded,
        worded=worded,
        breakable=breakable,
    )
    return environment


def write(diagnosis: Diagnosis, path: Path) -> None:
    """Write the page whole."""
    atomic.write_text(path, render(diagnosis))


def glued(sentence: str) -> str:
    """With no line break between a number and its unit or per cent sign, nor inside an interval."""
    sentence = re.sub(r"(?<=\d)–(?=\d)", "\N{WORD JOINER}–\N{WORD JOINER}", sentence)
    return re.sub(r"(?<=[0-9∞]) (?=[%a-zA-Zµ]{1,2}(?:[·/²]|\b|$)|%)", "\N{NO-BREAK SPACE}", sentence)


def coded(sentence: str) -> Markup:
    """Escaped, with what stands in backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(glued(sentence)))))


def worded(command: str) -> Markup:
    """A command, escaped, whose words are not broken at their hyphens."""
    return Markup(" ").join(Markup("<span>{}</span>").format(word) for word in command.split(" "))


def breakable(name: str) -> Markup:
    """A name from a file, escaped, that may be broken after its dots and underscores."""
    return Markup("<wbr>").join(re.findall(r".[^._]*[._]*", name, re.DOTALL)) if name else Markup()


@functools.cache
def _plotly() -> str:
    """Plotly's script."""
    extra.load("plotly", "the report")
    return resources.files("plotly").joinpath("package_data", "plotly.min.js").read_bytes().decode()


@functools.cache
def _packed() -> str:
    """The same, gzip, base64."""
    return base64.b64encode(gzip.compress(_plotly().encode(), 9, mtime=0)).decode()


def _drawn(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Per overlay its trial and its channels, those with most of the gap first."""
    total = sum(len(overlay.measured) for overlay in diagnosis.overlays)
    share: dict[str, float] = {}
    for place in diagnosis.where:
        share[place.channel] = share.get(place.channel, 0.0) + place.share
    trials = []
    for index, overlay in enumerate(diagnosis.overlays):
        figures = overlays.figures(overlay, total)
        rows = [
            {
                "id": f"figure-{index}-{number}",
                "channel": name,
                "share": words.percent(share[name]) if share.get(name, 0.0) > 0.0005 else "",
                "figure": figures[name],
            }
            for number, name in enumerate(sorted(figures, key=lambda name: -share.get(name, 0.0)))
            if figures[name]["data"]
        ]
        seen = {phase for phase, _, _ in overlays.stretches(overlay.time, overlay.phases)}
        named = [name for index, name in enumerate(PHASES) if index in seen]
        trials.append({"trial": overlay.trial, "rows": rows, "phases": named})
    return trials if total else []
