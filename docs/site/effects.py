"""A page per effect, and the catalogue of them, of their declarations."""

from __future__ import annotations

from docs import make_effects_page as single
from tiago_mj.effects import EFFECTS, describe
from tiago_mj.effects.declare import STAGES, Effect, twins

#: What the library itself declares, in the order of the signal chain.
LIBRARY = {
    name: declared
    for stage in STAGES
    for name, declared in EFFECTS.items()
    if declared.stage == stage and declared.__module__.startswith("tiago_mj.")
}


def title(stage: str) -> str:
    """A stage as a heading."""
    return stage.replace("_", " ").capitalize()


def page(name: str, plot: str, caption: str) -> str:
    """The page of an effect, in Markdown.

    Args:
        name: of the effect.
        plot: SVG in one line.
        caption: what the plot shows.
    """
    declared = LIBRARY[name]
    told = describe(declared)
    rows = [*map(single.row, declared.parameters.values()), *map(single.more, declared.details.values())]
    lines = [
        f"# `{name}`",
        told.what.replace("``", "`"),
        f"    {told.formula}",
        f'<figure class="plot" markdown="0">{plot}<figcaption>{caption}</figcaption></figure>',
        f"**In a recording:** {told.looks.replace('``', '`')}",
        "## Parameters",
        "| parameter | unit | identity | default | bounds |\n|---|---|---|---|---|\n" + "\n".join(rows),
        "At its *identity* it changes nothing. The *default* is what `{}` means: clearly visible. *Bounds* are what a "
        "diagnosis tries. A pair is for sliding joints; hinges.",
        "## In use",
        _example(name, declared),
        "## Facts",
        "\n".join(_facts(name, declared)),
    ]
    return "\n\n".join(lines) + "\n"


def _example(name: str, declared: type[Effect]) -> str:
    values = ", ".join(f'"{key}": {p.default[0]:g}' for key, p in declared.parameters.items() if p.nominal is None)
    return (
        "```python\nimport gymnasium\nimport tiago_mj\n\n"
        f'env = gymnasium.make("tiago_mj/GripperTactile-v0", effects={{"{name}": {{{values}}}}})\n```'
    )


def _facts(name: str, declared: type[Effect]) -> list[str]:
    told = describe(declared)
    alike = [f"[`{other}`]({other}.md)" for other, one in LIBRARY.items() if one.gap_class == declared.gap_class]
    alike.remove(f"[`{name}`]({name}.md)")
    rows = [
        f"- **Stage:** {title(declared.stage).lower()}, {single.ABOUT[declared.stage]}.",
        f"- **Acts on:** `{declared.targets}` ([targets](../effects.md#targets)).",
        f"- **Typical:** {told.typical} *Source:* {told.source}".replace("``", "`"),
        f"- **On the robot:** {told.check}",
        f"- **MuJoCo:** {told.native or 'has none; it is computed outside of the simulation.'}".replace("``", "`"),
    ]
    if twins(name):
        rows.append(f"- **Hardly told from:** {', '.join(f'[`{other}`]({other}.md)' for other in twins(name))}.")
    if alike:
        rows.append(f"- **Looks much like:** {', '.join(alike)} (class *{declared.gap_class}*).")
    return rows


def catalogue() -> str:
    """The page that tells how effects are used and lists them with a line each."""
    text = single.page()
    head = text[: text.index(f"## {title(STAGES[0])}: ")]
    for name in LIBRARY:
        head = head.replace(f"](#{name})", f"](effects/{name}.md)")
    head = head.replace(
        "This page is written from their\ndeclarations by `python docs/make_effects_page.py`: edit those.",
        "Each has a page with a plot of\nhow it looks in a recording.",
    )
    lines = [head.rstrip(), "## All effects"]
    for stage in STAGES:
        lines += [f"### {title(stage)}: {single.ABOUT[stage]}", "| effect | what it is |\n|---|---|\n" + _rows(stage)]
    return "\n\n".join(lines) + "\n"


def _rows(stage: str) -> str:
    rows = []
    for name, declared in LIBRARY.items():
        if declared.stage == stage:
            what = describe(declared).what.split("\n\n")[0].replace("``", "`").replace("|", "\\|")
            rows.append(f'| <a id="{name}"></a>[`{name}`](effects/{name}.md) | {what} |')
    return "\n".join(rows)
