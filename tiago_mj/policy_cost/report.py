"""What effects cost, as a table with the answer in words, and as data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from tiago_mj.io.aligned import aligned
from tiago_mj.io.quantities import fixed
from tiago_mj.policy_cost.effect_costs import Difference, EffectCost, Level, PolicyCost
from tiago_mj.policy_cost.intervals import Interval

SCHEMA: Final = "tiago_mj.policy_cost/1"
#: Digits of a return before and after its point, together.
DIGITS: Final = 4
MEND: Final = (
    "To mend an effect is to take it from the robot, by repair or compensation, while the others stay and the policy "
    "stays as it is. What training with the effect would bring is not part of these numbers."
)
OPEN_LOOP: Final = (
    "Open loop: the logged actions are sent again, whatever the simulator answers. A policy would react, so that what "
    "is told is how much the effects change the outcome of these very actions."
)
HEADER: Final = ("", "return", "95 % interval", "success")
EFFECTS_HEADER: Final = ("effect", "costs", "95 % interval", "success", "alone", "95 % interval")


def as_data(found: PolicyCost, about: Mapping[str, Any], notes: Sequence[str]) -> dict[str, Any]:
    """Everything, for JSON.

    Args:
        found: the answer.
        about: what was played: environment, policy, seeds.
        notes: sentences that a reader should know.
    """
    first = found.first
    return {
        "schema": SCHEMA,
        **about,
        "episodes": found.episodes,
        "draws": found.draws,
        "nominal": asdict(found.nominal),
        "repaired": asdict(found.repaired),
        "total": asdict(found.total),
        "effects": [
            {
                "name": one.item.name,
                "target": "all" if one.item.target is None else list(one.item.target),
                "magnitude": one.item.magnitude,
                "mended": asdict(one.mended),
                "alone": asdict(one.alone),
            }
            for one in found.effects
        ],
        "mend_first": None if first is None else first.item.label,
        "lead": None if found.lead is None else asdict(found.lead),
        "others": [
            {"effects": one.label, "repaired": asdict(one.repaired), "total": asdict(one.total)} for one in found.others
        ],
        "answer": answer(found),
        "notes": list(notes),
    }


def text(found: PolicyCost, title: str, notes: Sequence[str]) -> str:
    """The whole report for a terminal.

    Args:
        found: the answer.
        title: who was played where.
        notes: sentences that follow it.
    """
    decimals = decimals_of(found)
    drawn = f", {found.draws} draws of the magnitudes" if found.draws > 1 else ""
    levels = [HEADER, _level("nominal simulator", found.nominal, decimals)]
    levels.append(_level("repaired simulator", found.repaired, decimals))
    effects = [EFFECTS_HEADER, *(_effect(one, decimals) for one in found.effects)]
    if len(found.effects) > 1:
        effects.append(("all together", *_difference(found.total, decimals), "", ""))
    instead = [
        f"The recordings cannot tell this from {one.label}, which costs {_span(one.total.episode_return, decimals)}."
        for one in found.others
    ]
    magnitudes = [f"  {one.item.label}: {one.item.magnitude}" for one in found.effects if one.item.magnitude]
    return "\n".join(
        [
            f"{title}: {found.episodes} episodes, the same in every simulator{drawn}",
            *aligned(levels, left=1),
            "",
            *aligned(effects, left=1),
            "costs: what the policy gains where this effect alone is mended; alone: what it loses by this effect alone",
            *magnitudes,
            "",
            answer(found),
            *instead,
            *notes,
        ]
    )


def answer(found: PolicyCost) -> str:
    """Which effect to mend first, in words."""
    decimals, first = decimals_of(found), found.first
    if first is None:
        return _none(found, decimals)
    gain = _span(first.mended.episode_return, decimals)
    said = f"Mend {first.item.label} first: without it the return is higher by {gain}."
    if found.lead is not None and len(found.effects) > 1 and not found.lead.above_zero:
        second = found.effects[1]
        said += f" Whether it costs more than {second.item.label} does is not certain."
    harmless = [one.item.label for one in found.effects if not _differs(one.mended.episode_return)]
    if harmless:
        said += f" No cost that differs from 0: {', '.join(harmless)}."
    return said


def _none(found: PolicyCost, decimals: int) -> str:
    """Where no effect's cost is above 0."""
    if found.total.episode_return.above_zero and len(found.effects) > 1:
        most = max(found.effects, key=lambda one: one.alone.episode_return.mean)
        return (
            f"Together they cost {_span(found.total.episode_return, decimals)}, but mending no single one brings "
            f"return back. The one that costs most where it is alone: {most.item.label}, "
            f"{_span(most.alone.episode_return, decimals)}."
        )
    helps = [one.item.label for one in found.effects if one.mended.episode_return.below_zero]
    said = "No effect's cost differs from 0" if not helps else "No effect costs this policy return"
    said += ": for this policy there is nothing to mend first"
    said += f". The return is higher with {', '.join(helps)}" if helps else ""
    if found.episodes < 2:
        said = "One episode tells no interval, so that nothing is said of what differs from 0: give more episodes"
    return f"{said}."


def _differs(one: Interval) -> bool:
    return one.above_zero or one.below_zero


def decimals_of(found: PolicyCost) -> int:
    """Decimals with which all returns are told: four digits of the larger one's."""
    largest = max(abs(found.nominal.episode_return.mean), abs(found.repaired.episode_return.mean), 1e-3)
    return max(DIGITS - 1 - math.floor(math.log10(largest)), 0)


def _level(name: str, level: Level, decimals: int) -> tuple[str, ...]:
    success = "-" if level.success is None else f"{100 * level.success:.0f} %"
    return (name, fixed(level.episode_return.mean, decimals), _ends(level.episode_return, decimals), success)


def _effect(one: EffectCost, decimals: int) -> tuple[str, ...]:
    alone = one.alone.episode_return
    return (one.item.label, *_difference(one.mended, decimals), fixed(alone.mean, decimals), _ends(alone, decimals))


def _difference(one: Difference, decimals: int) -> tuple[str, str, str]:
    success = "-"
    if one.success is not None:
        success = f"{fixed(100 * one.success.mean, 0)} %"
        if one.success.low is not None and one.success.high is not None:
            success += f" ({fixed(100 * one.success.low, 0)} to {fixed(100 * one.success.high, 0)})"
    return fixed(one.episode_return.mean, decimals), _ends(one.episode_return, decimals), success


def _ends(one: Interval, decimals: int) -> str:
    if one.low is None or one.high is None:
        return "-"
    return f"{fixed(one.low, decimals)} to {fixed(one.high, decimals)}"


def _span(one: Interval, decimals: int) -> str:
    ends = _ends(one, decimals)
    return fixed(one.mean, decimals) + ("" if ends == "-" else f" ({ends})")
