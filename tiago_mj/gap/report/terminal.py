"""The answer in short on the terminal (rich)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tiago_mj.gap.report import advice, commands, like_parts, pattern, residual, shrinking, tables, verdict, words
from tiago_mj.gap.report.contradiction import checked
from tiago_mj.gap.result import Diagnosis, Named
from tiago_mj.io import extra
from tiago_mj.recordings.lint.summary import summary

#: Lines of each list, and of the channels before and after.
MOST, CHANNELS = 5, 3


def show(diagnosis: Diagnosis, written: Mapping[str, Path] | None = None, *, console: Any = None) -> None:
    """Print the answer: verdict, where, which, how far, what to do next.

    Args:
        diagnosis: the answer.
        written: files by name (``report.html``, ``calibration.yaml``), for the last lines.
        console: a ``rich.console.Console``; standard output if None.
    """
    diagnosis = checked(diagnosis)
    rich_text = extra.load("rich.text", "the terminal's answer")
    console = console or extra.load("rich.console", "the terminal's answer").Console(highlight=False)
    for style, line in lines(diagnosis, written or {}):
        console.print(rich_text.Text(line, style=style), soft_wrap=not console.is_terminal)


def lines(diagnosis: Diagnosis, written: Mapping[str, Path]) -> list[tuple[str, str]]:
    """(style, line) of what :func:`show` prints."""
    d = diagnosis
    colour = {"no_gap": "bold green", "effect": "bold green"}.get(d.kind, "bold yellow")
    shown = [(colour, verdict.headline(d))]
    if not d.complete and d.stopped is None:  # of an earlier version, which did not say why
        shown.append(("yellow", "The search did not come to its end: this is the best answer so far."))
    if d.kind != "unknown" and verdict.remainder(d):
        shown.append(("", verdict.remainder(d)))
    if d.residual_shape is not None:
        shown.append(("", residual.sentences(d)))
    shown += [("yellow", note) for note in d.notes]
    for step in advice.go_on(d):
        shown.append(("", step.said.replace("`", "")))
        if step.command:
            shown.append(("", f"  {step.command}"))
    shown += _where(d) + _which(d) + _terms(d)
    if d.like:
        shown += [("bold", "Parts that are alike"), *(("", f"  {said}") for said in like_parts.sentences(d))]
    shown += _how_far(d) + _numbers(d)
    if d.not_excited:
        names = [words.title(name) for name in d.not_excited]
        more = f" and {len(names) - 2 * MOST} more" if len(names) > 2 * MOST else ""
        shown.append(("", f"Not excited, so not ruled out: {', '.join(names[: 2 * MOST])}{more}"))
    found = summary(d.findings)
    left = [row for row in found if not row.repaired]
    if found:
        several = f"{len(found)} kinds of findings, {len(found) - len(left)} of them repaired"
        alone = f"1 kind of finding, {'left as it is' if left else 'repaired'}"
        shown.append(("", f"Check of the recordings: {alone if len(found) == 1 else several}"))
        shown += [("dim", f"  {row}") for row in left[:MOST]]
    if d.next_motion is not None:
        chance = words.percent(d.next_motion.expected_probability)
        what = f"record {d.next_motion.file} next: one recording of it decides with a chance of {chance}"
        shown.append(("", f"On the real robot, {what}. Of a simulated robot this records it:"))
        shown.append(("", f"  {commands.record(d, d.next_motion.file)}"))
    if verdict.on_model(d):
        shown.append(("", verdict.on_model(d)))
    shown += [("dim", f"Written: {path}") for path in written.values()]
    return shown


def _where(d: Diagnosis) -> list[tuple[str, str]]:
    rows = sorted((p for p in d.where if p.share >= 0.005), key=lambda p: -p.share)
    if d.kind == "no_gap" or not rows:
        return []
    stage = f", stage: {tables.STAGE_NAMES.get(d.stage, d.stage)}" if d.stage else ""
    shown = [("bold", f"Where{stage}")]
    width = max(len(p.channel) for p in rows[:MOST])
    for p in rows[:MOST]:
        shown.append(("", f"  {words.percent(p.share):>6}  {p.channel:<{width}}  {p.phase}, {p.band}"))
    return shown


def _which(d: Diagnosis) -> list[tuple[str, str]]:
    if d.kind == "no_gap" or not d.ranking or not (d.complete or d.best.effects):
        return []
    of = ", as part of the cause, with its probability" if verdict.part_only(d) else ""
    shown = [("bold", f"Which{of}")]
    rows = tables.ranking(d)[:MOST]
    every = pattern.joints(d)
    wide = max(len("same" if row.again else row.probability) for row in rows)
    for row, one in zip(rows, d.ranking, strict=False):
        mark = "*" if row.chosen else "~" if row.tied else " "
        many = len(one.effects) > words.MANY
        said = pattern.in_short(one.effects, every) if many else " + ".join(map(_term, one.effects))
        chance = "same" if row.again else row.probability
        shown.append(("", f"{mark} {chance:>{wide}}{'  ' if wide else ''}{said or 'nominal simulator'}"))
    if any(row.tied and not row.chosen for row in tables.ranking(d)[:MOST]):
        shown.append(("dim", "  * best   ~ cannot be told from it"))
    if d.complete and any(row.again for row in tables.ranking(d)[:MOST]):
        shown.append(("dim", "  same: of a class listed above; the probability there is that of the whole class"))
    return shown


def _term(effect: Named) -> str:
    """An effect with its values, in a line."""
    return ", ".join([words.label(effect), *(f"{key} {said}" for key, said in tables.shown(effect)["parameters"])])


def _terms(d: Diagnosis) -> list[tuple[str, str]]:
    """The effects of the best explanation one by one, where there are too many for the sentence."""
    if len(d.best.effects) <= words.MANY:
        return []
    rows = [(words.label(effect), tables.shown(effect)["parameters"]) for effect in d.best.effects]
    width = max(len(label) for label, _ in rows)
    lines = [f"  {label:<{width}}  {', '.join(f'{key} {said}' for key, said in values)}" for label, values in rows]
    return [("bold", "Term by term"), *(("", line) for line in lines)]


def _how_far(d: Diagnosis) -> list[tuple[str, str]]:
    shrink = d.shrink
    if shrink.before is None or d.kind == "no_gap":
        return []
    after = f" → {words.number(shrink.after)}" if shrink.after is not None and d.best.effects else ""
    told = shrink.closed is not None and d.best.effects
    closed = f": {words.percent_within(shrink.closed, shrink.low, shrink.high)} closed" if told else ""
    gap = f"{words.number(shrink.before)}{after}, noise floor {words.number(shrink.floor)}{closed}"
    shown = [("bold", "How far"), ("", f"  gap on test trials {gap}")]
    if d.best.effects:
        rows = shrinking.by_channel(d).rows[:CHANNELS]
        width = max((len(row.channel) for row in rows), default=0)
        for row in rows:
            between = f" ({row.between})" if row.between else ""
            shown.append(("", f"  {row.channel:<{width}}  {row.before:>6} → {row.after:<6} {row.closed}{between}"))
        phases = [
            f"{name} {words.number(c.before, 2)} → {words.number(c.after, 2)}"
            for name, c in sorted(shrink.per_phase.items(), key=lambda item: -item[1].before)
            if c.closed is not None
        ]
        if phases:
            shown.append(("", f"  by phase: {', '.join(phases[:MOST])}"))
    if verdict.on_task(d):
        shown.append(("", f"  {verdict.on_task(d)}"))
    return shown


def _numbers(d: Diagnosis) -> list[tuple[str, str]]:
    rows = tables.numbers(d)
    if not rows:
        return []
    shown = [("bold", "The simulator's own numbers as fitted")]
    if verdict.with_numbers(d):
        shown.append(("", f"  {verdict.with_numbers(d)}"))
    width = max(len(row[0]) for row in rows[: 2 * MOST])
    shown += [("", f"  {what:<{width}}  {value}, nominal {nominal}") for what, value, nominal in rows[: 2 * MOST]]
    if len(rows) > 2 * MOST:
        shown.append(("", f"  and {len(rows) - 2 * MOST} more in calibration.yaml"))
    return shown
