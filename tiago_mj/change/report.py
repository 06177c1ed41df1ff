"""A comparison on the terminal, as a page, and as files."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from tiago_mj.change.result import AFTER, BEFORE, FILE_NAME, Change, Comparison, Explanation, text
from tiago_mj.gap.parts import Named
from tiago_mj.gap.report import words
from tiago_mj.io import atomic, extra, pages

#: The page.
PAGE: Final = "comparison.html"
#: What is said of each kind, in a few words, and whether that settles it.
KIND_NAMES: Final = {
    "nothing_changed": ("nothing changed", "no_gap"),
    "changed": ("changed", "effect"),
    "ambiguous": ("ambiguous", "ambiguous"),
    "unknown_change": ("unknown change", "unknown"),
}
#: Rows of the ranking on the terminal.
ROWS: Final = 5


def label(change: Change) -> str:
    """Effect and targets in a few words."""
    return words.label(Named(change.name, change.target, {}))


def size(value: float | None, unit: str) -> str:
    """A parameter in one set; where there is no limit, that."""
    if value is None:
        return "none"
    factor, shown = words.scaled(value, unit)
    return " ".join(piece for piece in (words.bare(words.number(value * factor)), shown) if piece)


def values(change: Change) -> str:
    """From what to what: ``0 → 0.2 N·m``."""
    return f"{size(change.before, change.amount.unit)} → {size(change.after, change.amount.unit)}"


def sentence(change: Change) -> str:
    """One change: what, from where to where, and by how much."""
    parameter = change.parameter.replace("_", " ")
    amount = words.amount(change.amount)
    more = "the later set" if change.acts_in == AFTER else "the earlier set"
    return f"{label(change)}: {parameter} {values(change)}; what {more} has beyond the other: {amount}"


def headline(found: Comparison) -> str:
    """The answer in one sentence."""
    chance = words.percent(found.probability)
    if found.kind == "nothing_changed":
        return f"Nothing changed between the two sets, as far as these recordings show (probability {chance})."
    if found.kind == "unknown_change":
        return "Something changed, and no effect of the library explains it."
    names = words.listed([told(one) for one in found.alternatives], "or")
    if found.kind == "ambiguous":
        return f"Something changed, and these recordings do not tell which: {names}."
    return f"{names} changed between the two sets (probability {chance})."


def told(one: Explanation) -> str:
    """An explanation in a few words."""
    return words.listed([label(change) for change in one.changes]) or "nothing"


def basis(found: Comparison) -> str:
    """How the sets were compared, in one sentence."""
    counts = f"{len(found.before.recordings)} recordings before and {len(found.after.recordings)} after"
    if found.same_commands:
        return (
            f"{counts}; {found.same_commands} pairs repeat the same commands: their differences were compared, where "
            "the model's errors cancel."
        )
    reference = "earlier" if found.reference == BEFORE else "later"
    return (
        f"{counts}, of other motions or without commands: both sets were fitted with the same numbers of the robot, "
        f"and the residual of the {reference} set was added to the tolerance of both."
    )


def lines(found: Comparison, written: dict[str, Path]) -> list[tuple[str, str]]:
    """(style, line) of what :func:`show` prints."""
    sure = found.kind in ("nothing_changed", "changed")
    out = [("bold green" if sure else "bold yellow", headline(found))]
    out += [("", f"  {sentence(change)}") for one in found.alternatives for change in one.changes]
    out += [("", basis(found))]
    out += [("yellow", note) for note in found.notes]
    if found.common:
        out.append(("", f"Both sets have: {words.listed([words.clause(one) for one in found.common])}"))
    if len(found.ranking) > 1:
        out.append(("bold", "Which"))
        for one in found.ranking[:ROWS]:
            mark = "*" if one in found.alternatives else " "
            out.append(
                ("", f"{mark} {words.percent(one.probability):>12}  {told(one)}, leaves {words.number(one.left)}")
            )
    return [*out, *(("dim", f"Written: {path}") for path in written.values())]


def show(found: Comparison, written: dict[str, Path], *, console: Any = None) -> None:
    """Print the answer; ``console``: a ``rich.console.Console``, standard output if None."""
    rich_text = extra.load("rich.text", "the terminal's answer")
    console = console or extra.load("rich.console", "the terminal's answer").Console(highlight=False)
    for style, line in lines(found, written):
        console.print(rich_text.Text(line, style=style), soft_wrap=not console.is_terminal)


def styles() -> Markup:
    """The diagnosis report's style sheet: light, dark, and on a phone."""
    return Markup(
        resources.files("tiago_mj.gap.report").joinpath("templates", "report.css").read_text(encoding="utf-8")
    )


def render(found: Comparison) -> str:
    """The page."""
    kind, look = KIND_NAMES[found.kind]
    environment = pages.environment("tiago_mj.change")
    environment.filters.update(percent=words.percent, number=words.number, amount=words.amount)
    return environment.get_template("comparison.html.j2").render(
        d=found,
        kind=kind,
        look=look,
        headline=headline(found),
        basis=basis(found),
        label=label,
        values=values,
        told=told,
        common=[words.clause(one) for one in found.common],
        styles=styles(),
        policy=pages.of_page(),
    )


def write(found: Comparison, folder: Path) -> dict[str, Path]:
    """Write ``comparison.json`` and the page: both or none; paths by name."""
    parts = (FILE_NAME, PAGE)
    with atomic.replacing_set(folder, parts=parts) as new:
        atomic.write_text(new / FILE_NAME, text(found))
        atomic.write_text(new / PAGE, render(found))
    return {name: folder / name for name in parts}
