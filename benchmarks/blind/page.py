"""HTML page of a run of the blind check: scores with intervals, a confusion matrix, the calibration of
probabilities, all cases."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.blind import intervals
from benchmarks.blind.score import Judged, class_of, right, stated

#: Wanted of each score, for the page alone: (text, whether the value does).
REACH: Final[Mapping[str, tuple[str, Any]]] = {
    "top1": ("≥ 92 %", lambda v: v >= 0.92),
    "in_set": ("≥ 98 %", lambda v: v >= 0.98),
    "set_size": ("≤ 1.4", lambda v: v <= 1.4),
    "pairs": ("≥ 75 %", lambda v: v >= 0.75),
    "false_names": ("≤ 3 %", lambda v: v <= 0.03),
    "unknown_flagged": ("≥ 85 %", lambda v: v >= 0.85),
    "false_flags": ("≤ 5 %", lambda v: v <= 0.05),
    "ece": ("≤ 0.08", lambda v: v <= 0.08),
    "brier_gain": ("> 0", lambda v: v > 0),
    "log_gain": ("> 0", lambda v: v > 0),
    "parameter_error": ("≤ 5 %", lambda v: v <= 0.05),
    "interval_coverage": ("85–95 %", lambda v: 0.85 <= v <= 0.95),
    "closed_share": ("≥ 90 %", lambda v: v >= 0.9),
    "next_motion": ("≥ 75 %", lambda v: v >= 0.75),
    "seconds": ("≤ 60", lambda v: v <= 60),
    "physics_steps": ("≤ 600 000", lambda v: v <= 6e5),
}
WORDS: Final[Mapping[str, str]] = {
    "top1": "single effect, named first",
    "in_set": "truth in the reported set",
    "set_size": "explanations in the set",
    "pairs": "two effects, both right",
    "false_names": "names where nothing is",
    "unknown_flagged": "outside the library: called unknown",
    "left_out": "deleted from the library: unknown, or its class",
    "soft_forms": "a softer form of the library's: unknown, or that",
    "false_flags": "called unknown where the library knows it",
    "undetectable": "hardly visible: rightly modest",
    "ece": "calibration error of the probabilities",
    "brier_gain": "Brier score below the best constant's, by",
    "log_gain": "log loss below the best constant's, by [nats]",
    "parameter_error": "median error of parameters",
    "interval_coverage": "90 % intervals that hold the truth",
    "closed_share": "closed share of what can be closed",
    "next_motion": "next motion resolves",
    "seconds": "seconds a diagnosis",
    "physics_steps": "physics steps a diagnosis",
    "failed": "no diagnosis at all",
}
_PLAIN_NUMBERS: Final = frozenset({"set_size", "seconds", "physics_steps", "ece", "brier_gain", "log_gain"})

_STYLE: Final = """
:root{color-scheme:light dark;--ink:#1c2227;--paper:#fff;--line:#d5dade;--soft:#f2f4f6;--good:#18794e;--bad:#b42318;
--bar:#3b6ea5}
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ec;--paper:#14181b;--line:#38414a;--soft:#1e2429;--good:#4cc38a;
--bad:#ff8f85;--bar:#7fb0e6}}
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:70rem;margin:2rem auto;
padding:0 1rem}
table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}
th,td{padding:.25rem .6rem;border-bottom:1px solid var(--line);text-align:left;vertical-align:top}
td.n,th.n{text-align:right}.good{color:var(--good)}.bad{color:var(--bad)}.wide{overflow-x:auto}
th.up{writing-mode:vertical-rl;transform:rotate(180deg);font-weight:400;padding:.4rem .1rem}
td.hit{background:color-mix(in srgb,var(--good) 25%,transparent)}
td.miss{background:color-mix(in srgb,var(--bad) 25%,transparent)}
small{color:color-mix(in srgb,var(--ink) 65%,transparent)}
"""


def page(judged: Sequence[Judged], scores: Mapping[str, Any], seal: str, command: str) -> str:
    """The whole page as HTML; links are relative to the run's folder."""
    kinds = Counter(j.kind for j in judged)
    said = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in kinds.items())
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width,initial-scale=1'>",
        f"<title>Blind check</title><style>{_STYLE}</style><h1>Blind check</h1>",
        f"<p>{len(judged)} cases: {html.escape(said)}. Labels sealed before the first diagnosis: <code>{seal}</code>.",
        f"Made with <code>{html.escape(command)}</code>.</p>",
        f"<p><b>{html.escape(scores['caution'])}</b></p>" if scores.get("caution") else "",
        _score_table(scores),
        "<h2>Who was taken for whom</h2><p>Single effects by class; undetectable ones in parentheses.</p>",
        _confusion(judged),
        "<h2>What the probabilities are worth</h2>",
        _reliability(judged),
        "<h2>Cases</h2>",
        _case_table(judged),
    ]
    return "\n".join(parts) + "</html>\n"


def number(name: str, value: float | None) -> str:
    """A score as it is read."""
    if value is None:
        return "–"
    return f"{value:.3g}" if name in _PLAIN_NUMBERS else f"{100 * value:.1f}\N{NO-BREAK SPACE}%"


def _score_table(scores: Mapping[str, Any]) -> str:
    baselines = scores.get("baselines", {})
    head = "".join(f"<th class='n'>{html.escape(name)}</th>" for name in baselines)
    rows = [
        f"<table><tr><th>score</th><th class='n'>value</th><th>90 % interval</th><th class='n'>n</th><th>reach</th>"
        f"{head}</tr>"
    ]
    for name, words in WORDS.items():
        entry = scores.get(name)
        if entry is None:
            continue
        wanted, reached = REACH.get(name, ("", None))
        value = entry["value"]
        mark = "" if value is None or reached is None else (" class='good'" if reached(value) else " class='bad'")
        span = "" if value is None else f"{number(name, entry['low'])} – {number(name, entry['high'])}"
        others = "".join(
            f"<td class='n'>{number(name, table.get(name, {}).get('value'))}</td>" for table in baselines.values()
        )
        rows.append(
            f"<tr><td>{words} <small>{name}</small></td><td class='n'><b{mark}>{number(name, value)}</b></td>"
            f"<td>{span}</td><td class='n'>{entry['n']}</td><td>{wanted}</td>{others}</tr>"
        )
    return "".join(rows) + "</table>"


def _taken_for(j: Judged) -> str:
    if j.answer is None:
        return "failed"
    if j.verdict in ("unknown", "no_gap"):
        return j.verdict.replace("_", " ")
    return " + ".join(j.best or ()) or "no gap"


def _confusion(judged: Sequence[Judged]) -> str:
    singles = [j for j in judged if j.kind in ("none", "one", "outside", "left_out")]
    cells: Counter[tuple[str, str]] = Counter()
    faint: Counter[tuple[str, str]] = Counter()
    for j in singles:
        true = "no effect" if j.kind == "none" else " + ".join(j.truth)
        if j.kind in ("outside", "left_out"):
            true = f"{j.kind.replace('_', ' ')}: {true}"
        (cells if j.detectable or j.kind == "none" else faint)[true, _taken_for(j)] += 1
    rows = sorted({row for row, _ in (*cells, *faint)})
    columns = sorted({column for _, column in (*cells, *faint)})
    out = [
        "<div class='wide'><table><tr><th></th>",
        *(f"<th class='up'>{html.escape(c)}</th>" for c in columns),
        "</tr>",
    ]
    for row in rows:
        out.append(f"<tr><th>{html.escape(row)}</th>")
        for column in columns:
            sure, weak = cells[row, column], faint[row, column]
            own = row.removeprefix("left out: ")  # of what was deleted, one of its class is right, too
            same = column == own or (row == "no effect" and column == "no gap") or (":" in row and column == "unknown")
            kind = " hit" if same and sure else " miss" if sure else ""
            text = (str(sure) if sure else "") + (f" ({weak})" if weak else "")
            out.append(f"<td class='n{kind}'>{text}</td>")
        out.append("</tr>")
    return "".join(out) + "</table></div>"


def _reliability(judged: Sequence[Judged]) -> str:
    """Share of right answers over the probability that was said, of bins of as many answers each, as a picture."""
    rows = [row for j in judged if (row := stated(j)) is not None]
    if not rows:
        return "<p>No probabilities.</p>"
    size, edge = 360, 45
    scale = size - edge - 10

    def at(x: float, y: float) -> tuple[float, float]:
        return edge + x * scale, size - edge - y * scale

    (x0, y0), (x1, y1) = at(0, 0), at(1, 1)
    shapes = [
        f"<rect x='{x0}' y='{y1}' width='{scale}' height='{scale}' fill='none' stroke='var(--line)'/>",
        f"<line x1='{x0}' y1='{y0}' x2='{x1}' y2='{y1}' stroke='var(--line)' stroke-dasharray='4'/>",
    ]
    for tick in (0.0, 0.5, 1.0):
        x, _ = at(tick, 0)
        _, y = at(0, tick)
        shapes.append(
            f"<text x='{x}' y='{y0 + 18}' text-anchor='middle' fill='currentColor' font-size='12'>{tick:g}</text>"
        )
        shapes.append(
            f"<text x='{x0 - 6}' y='{y + 4}' text-anchor='end' fill='currentColor' font-size='12'>{tick:g}</text>"
        )
    for said, share, count in intervals.reliability(np.array(rows)):
        x, y = at(said, share)
        shapes.append(
            f"<circle cx='{x:.1f}' cy='{y:.1f}' r='6' fill='var(--bar)' fill-opacity='.7'>"
            f"<title>{count} cases</title></circle>"
        )
    shapes.append(
        f"<text x='{(x0 + x1) / 2}' y='{size - 6}' text-anchor='middle' fill='currentColor' font-size='13'>"
        "probability that was said</text>"
        f"<text x='12' y='{(y0 + y1) / 2}' text-anchor='middle' fill='currentColor' font-size='13' "
        f"transform='rotate(-90 12 {(y0 + y1) / 2})'>share that was right</text>"
    )
    return (
        f"<svg viewBox='0 0 {size} {size}' width='{size}' role='img' aria-label='reliability'>{''.join(shapes)}</svg>"
    )


def _case_table(judged: Sequence[Judged]) -> str:
    rows = [
        "<div class='wide'><table><tr><th>case</th><th>setting</th><th>truth</th><th>detectable</th><th>verdict</th>"
        "<th class='n'>probability</th><th></th></tr>"
    ]
    for k, j in enumerate(judged):
        label = j.label
        effects = "; ".join(
            f"{e['name']} ({', '.join(f'{p} {v:.3g}' for p, v in e['parameters'].items())})" for e in label["effects"]
        )
        kind = j.kind.replace("_", " ")
        said, probability, link = "failed", "", f"{k:03d}"
        if j.answer is not None:
            verdict = j.answer["verdict"]
            named = " + ".join(e["name"] for e in verdict["effects"])
            said = f"{j.verdict.replace('_', ' ')}{': ' + named if named else ''}"
            probability = "–" if verdict.get("probability") is None else f"{verdict['probability']:.2f}"
            link = f"<a href='cases/{k:03d}/diagnosis/report.html'>{k:03d}</a>"
        mark, outcome = ("good", "right") if right(j) else ("bad", "wrong")
        rows.append(
            f"<tr><td>{link}</td><td>{html.escape(label['setting'])}, {html.escape(label['interface'])}</td>"
            f"<td><small>{kind}</small> {html.escape(effects)}</td>"
            f"<td>{'yes' if j.detectable else 'no' if label['effects'] else ''}</td><td>{html.escape(said)}</td>"
            f"<td class='n'>{probability}</td><td class='{mark}'>{outcome}</td></tr>"
        )
    return "".join(rows) + "</table></div>"


__all__ = ["class_of", "number", "page"]
