"""Report of an evaluation: as a table on the terminal, and as data."""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from tiago_mj.evaluate.bound import LeastCost
from tiago_mj.evaluate.metrics import SHOWN, Spread, summarise
from tiago_mj.evaluate.play import Played
from tiago_mj.io.aligned import aligned


@dataclass(frozen=True)
class Evaluation:
    """Controllers on the same seeds of one environment.

    Attributes:
        env: id.
        options: what it was made with.
        played: one a controller.
        bounds: the least cost of each episode, by seed in the order of ``seeds``; empty where it was not asked for.
    """

    env: str
    options: Mapping[str, Any]
    played: Sequence[Played]
    bounds: Sequence[LeastCost] = ()


def distance_from_bound(played: Played, bounds: Sequence[LeastCost]) -> float:
    """Distance of the mean return (the paper's reward) from its upper bound, relative to the bound."""
    rewards = [episode.paper_reward for episode in played.metrics]
    bound = sum(one.expected for one in bounds) / len(bounds)
    return (-sum(reward for reward in rewards if reward is not None) / len(rewards) - bound) / bound


def as_data(evaluation: Evaluation) -> dict[str, Any]:
    """Everything but the traces, for JSON."""
    controllers = []
    for played in evaluation.played:
        row: dict[str, Any] = {
            "name": played.name,
            "policy": played.policy,
            "summary": {name: asdict(spread) for name, spread in summarise(played.metrics).items()},
            "episodes": [
                {"seed": seed, **asdict(metrics)} for seed, metrics in zip(played.seeds, played.metrics, strict=True)
            ],
        }
        if evaluation.bounds:
            row["distance_from_bound"] = distance_from_bound(played, evaluation.bounds)
        controllers.append(row)
    data: dict[str, Any] = {
        "env": evaluation.env,
        "env_options": dict(evaluation.options),
        "seeds": list(evaluation.played[0].seeds),
        "controllers": controllers,
    }
    if evaluation.bounds:
        data["bounds"] = [asdict(one) for one in evaluation.bounds]
    return data


def rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """The table: metric with its unit, then mean ± SD of each controller; metrics that nobody has are left out."""
    summaries = [summarise(played.metrics) for played in evaluation.played]
    table = []
    for name, (title, unit, factor, digits) in SHOWN.items():
        spreads = [summary[name] for summary in summaries]
        if all(spread.count == 0 for spread in spreads):
            continue
        if name == "paper_reward" and all(_is_papers(played) for played in evaluation.played):
            continue  # the environment's reward is the paper's
        cells = (_cell(spread, factor, digits) for spread in spreads)
        table.append((f"{title} [{unit}]" if unit else title, *cells))
    if evaluation.bounds:
        bound = sum(one.expected for one in evaluation.bounds) / len(evaluation.bounds)
        table.append(("bound on the paper's reward", *[f"{-bound:.2f}"] * len(summaries)))
        away = [f"{100 * distance_from_bound(played, evaluation.bounds):.1f}" for played in evaluation.played]
        table.append(("below the bound by [%]", *away))
    return table


def show(evaluation: Evaluation) -> None:
    """Print the table; with rich where it is installed, else as plain columns."""
    header = ("mean ± SD", *(played.name for played in evaluation.played))
    body = rows(evaluation)
    try:
        console, table_module = importlib.import_module("rich.console"), importlib.import_module("rich.table")
        text = importlib.import_module("rich.text").Text  # of a plain word rich would take "[s]" for a style
    except ModuleNotFoundError:
        print("\n".join(aligned([header, *body], left=1)))
        return
    seeds = evaluation.played[0].seeds
    title = f"{evaluation.env}, {len(seeds)} episodes"
    table = table_module.Table(title=title, title_justify="left")
    for number, name in enumerate(header):
        table.add_column(text(name), justify="right" if number else "left", no_wrap=True)
    for row in body:
        table.add_row(*[text(cell) for cell in row])
    out = console.Console(highlight=False)
    if not out.is_terminal:  # a pipe has no width to fit into
        out = console.Console(highlight=False, width=max(80, 32 + 22 * len(header)))
    out.print(table)


def _is_papers(played: Played) -> bool:
    return all(math.isclose(one.reward, one.paper_reward or 0.0, rel_tol=1e-9) for one in played.metrics)


def _cell(spread: Spread, factor: float, digits: int) -> str:
    if spread.mean is None:
        return "-"
    mean = f"{factor * spread.mean:.{digits}f}"
    return mean if spread.sd is None else f"{mean} ± {factor * spread.sd:.{digits}f}"
