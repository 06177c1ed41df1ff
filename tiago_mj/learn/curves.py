"""Learning curves: of a seed as CSV, of all seeds as median and range."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io import atomic
from tiago_mj.io.rows import read_numbers

Array = NDArray[np.float64]

EPISODES, EVALUATIONS = "episodes.csv", "evaluations.csv"
#: Of the curve over all seeds.
POINTS: Final = 100
#: Episodes of the moving mean, as in the paper.
WINDOW: Final = 20


def write_seed(
    folder: Path, episodes: Sequence[tuple[int, float, bool]], evaluations: Sequence[Mapping[str, float]]
) -> None:
    """Write a seed's training episodes and evaluations, whole.

    Args:
        folder: of the seed.
        episodes: environment steps at their end, return, success.
        evaluations: ``steps``, ``mean_return``, ``sd_return``, ``success_rate``.
    """
    means = moving_mean(np.array([total for _, total, _ in episodes]))
    rows = [(s, f"{r:.4f}", int(ok), f"{m:.4f}") for (s, r, ok), m in zip(episodes, means, strict=True)]
    atomic.write_text(folder / EPISODES, _csv(("steps", "return", "success", "mean_return_of_20"), rows))
    names = ("steps", "mean_return", "sd_return", "success_rate")
    told = [(int(e["steps"]), *(f"{e[name]:.4f}" for name in names[1:])) for e in evaluations]
    atomic.write_text(folder / EVALUATIONS, _csv(names, told))


def read_episodes(folder: Path) -> tuple[Array, Array]:
    """Steps and moving means of a seed's episodes, each (n,).

    Raises:
        ValueError: the file is not there, or not whole; one line.
    """
    return _read(folder / EPISODES, "mean_return_of_20")


def read_evaluations(folder: Path) -> tuple[Array, Array]:
    """Steps and mean returns of a seed's evaluations, each (n,); faults as of :func:`read_episodes`."""
    return _read(folder / EVALUATIONS, "mean_return")


def _read(path: Path, name: str) -> tuple[Array, Array]:
    lead = f"{path} is no learning curve that can be read"
    found = read_numbers(path, ("steps", name), lead, mend="delete the folder of that seed to begin it anew")
    if (np.diff(found["steps"]) < 0).any():
        raise ValueError(f"{lead} (steps go back): delete the folder of that seed to begin it anew")
    return found["steps"], found[name]


def moving_mean(values: Array) -> Array:
    """Mean over each value and up to 19 before it, (n,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    end = np.arange(1, len(values) + 1)
    begin = np.maximum(end - WINDOW, 0)
    return np.asarray((total[end] - total[begin]) / (end - begin))


def over_seeds(curves: Sequence[tuple[Array, Array]], total: int) -> dict[str, list[float]]:
    """Median and range over seeds.

    Args:
        curves: steps and returns of each seed.
        total: environment steps of a seed.

    Returns:
        ``steps``, ``median``, ``lowest``, ``highest``: (100,) each, from the step at which all seeds have an episode.
    """
    held = [(steps, means) for steps, means in curves if len(steps)]
    if not held:
        return {"steps": [], "median": [], "lowest": [], "highest": []}
    first = max(float(steps[0]) for steps, _ in held)
    grid = np.linspace(first, max(first, total), POINTS)
    values = np.array([means[np.searchsorted(steps, grid, side="right") - 1] for steps, means in held])
    rows = {"steps": grid, "median": np.median(values, 0), "lowest": values.min(0), "highest": values.max(0)}
    return {name: [round(float(v), 3) for v in row] for name, row in rows.items()}


def write_all(folder: Path, data: Mapping[str, Any]) -> None:
    """Write ``curves.json``."""
    atomic.write_text(folder / "curves.json", json.dumps(dict(data)) + "\n")


def _csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
