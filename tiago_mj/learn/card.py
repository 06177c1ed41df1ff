"""Agent cards: training and results of an agent, as JSON and Markdown."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field

from tiago_mj.io.loading import load_json
from tiago_mj.io.schema import Open, checked
from tiago_mj.learn.randomise import in_short
from tiago_mj.learn.settings import Parts, Settings
from tiago_mj.learn.zoo_form import read_hyperparameters

SCHEMA: Final = "tiago_mj.card/1"
#: Hyperparameters that are shown, as they were used, under other names.
ELSEWHERE: Final = ("env_kwargs", "n_timesteps")


class _Result(Open):
    """Result of one seed."""

    seed: int = Field(ge=0)
    steps: int
    best_mean: float | None
    best_steps: int
    mean_return: float
    sd_return: float
    success_rate: float


class _Card(Open):
    """Keys of a training's card that are read; its curve is kept unread."""

    written: Literal["tiago_mj.card/1"] = Field(alias="schema")
    command: str
    settings: Parts
    made_by: dict[str, str]
    seeds: list[_Result] = Field(min_length=1)
    best_seed: int = Field(ge=0)


def read(path: Path) -> dict[str, Any]:
    """The card of a training.

    Raises:
        ValueError: there is none, or it is of another form; one line.
    """
    data: dict[str, Any] = load_json(path, f"{path.name} is not readable JSON")
    checked(_Card, data)
    return data


def card(
    settings: Settings, results: Sequence[Mapping[str, Any]], curve: Mapping[str, Any], made_by: Mapping[str, str]
) -> dict[str, Any]:
    """Card of a finished training.

    Args:
        settings: of the training.
        results: of each seed, as :func:`tiago_mj.learn.loop.train_seed` gives them.
        curve: of all seeds, as :func:`tiago_mj.learn.curves.over_seeds` gives it.
        made_by: versions and commit.
    """
    return {
        "schema": SCHEMA,
        "command": command(settings, len(results)),
        "settings": settings.as_data(),
        "made_by": dict(made_by),
        "seeds": [dict(result) for result in results],
        "best_seed": best(results)["seed"],
        "curve": dict(curve),
    }


def best(results: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Seed with the best mean return over 20 training episodes, or, without 20 episodes, in the last evaluation."""
    return max(results, key=lambda r: r["mean_return"] if r["best_mean"] is None else r["best_mean"])


def command(settings: Settings, seeds: int) -> str:
    """The command that trains this again; FILE stands for hyperparameters or effects of the user's own."""
    given = settings.hyperparameters
    shipped = read_hyperparameters(settings.algo, settings.env)
    words = ["tiago-mj train", f"--env {settings.env.partition('/')[2]}", f"--algo {settings.algo}", f"--seeds {seeds}"]
    words.append(f"--steps {settings.steps}")
    if {**given, "n_envs": 0} != {**shipped, "n_envs": 0}:
        words.append("--hyperparameters FILE")
    elif given["n_envs"] != shipped["n_envs"]:
        words.append(f"--envs {given['n_envs']}")
    if settings.updates_per_step is not None:
        words.append(f"--gradient-steps {settings.updates_per_step:g}")
    for key, value in settings.env_options.items():
        if key not in given["env_kwargs"] or value != given["env_kwargs"][key]:
            words.append(f"--env-option '{key}={value if isinstance(value, str) else json.dumps(value)}'")
    if settings.effects is not None:
        words.append("--effects FILE")
    if settings.randomise is not None:
        words.append("--randomise FILE")
    for name in ("evaluate_every", "evaluation_episodes", "checkpoint_every"):
        # The best of the evaluated policies is chosen, and at a checkpoint all environments begin new episodes.
        if (number := getattr(settings, name)) != getattr(Settings, name):
            words.append(f"--{name.replace('_', '-')} {number}")
    return " ".join([*words, "--out DIR"])


def markdown(data: Mapping[str, Any], name: str | None = None) -> str:
    """A card as a page.

    Args:
        data: of :func:`card`.
        name: of the agent; None: the page is about the training.
    """
    settings = data["settings"]
    env = settings["env"].partition("/")[2]
    title = name or f"{settings['algo']} on {env}"
    lines = [f"# {title}", "", f"    {data['command']}", ""]
    lines += ["| seed | steps | best mean of 20 episodes | at step | evaluation: mean ± SD | success rate |"]
    lines += ["|---|---|---|---|---|---|"]
    for row in data["seeds"]:
        mean = "-" if row["best_mean"] is None else f"{row['best_mean']:.2f}"
        lines.append(
            f"| {row['seed']} | {row['steps']} | {mean} | {row['best_steps']} | {row['mean_return']:.2f} ± "
            f"{row['sd_return']:.2f} | {row['success_rate']:.2f} |"
        )
    lines += [
        "",
        f"{'' if settings['algo'] == 'dagger' else 'Training episodes have exploration noise. '}The "
        f"{settings['evaluation_episodes']} evaluation episodes at the end of training have no exploration noise. "
        f"Best seed: {data['best_seed']}." + _which(data),
        "",
        "| setting | value |",
        "|---|---|",
        f"| environment | {settings['env']} |",
        *(f"| {key} | {_cell(value)} |" for key, value in settings["env_options"].items()),
        f"| effects | {'none' if settings['effects'] is None else _cell(settings['effects'])} |",
        *([f"| randomised | {_cell(in_short(settings['randomise']))} |"] if settings.get("randomise") else []),
        f"| algorithm | {settings['algo']} |",
        f"| updates per step | {_cell(settings['updates_per_step'] or 'as the hyperparameters say')} |",
        f"| steps | {settings['steps']} |",
        *(f"| {key} | {_cell(value)} |" for key, value in settings["hyperparameters"].items() if key not in ELSEWHERE),
        "",
        "Made with " + ", ".join(f"{key} {value}" for key, value in data["made_by"].items()) + ".",
        "",
    ]
    return "\n".join(lines)


def _which(data: Mapping[str, Any]) -> str:
    """Which agent of the training a page describes."""
    if "agent_seed" not in data:
        return ""
    cut = "; its observations are cut at those of its training" if data.get("agent_is_cut") else ""
    which = {"evaluated": "best evaluated"}.get(data.get("agent", "best"), data.get("agent", "best"))
    return f" This agent: the {which} of seed {data['agent_seed']}{cut}."


def _cell(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text.replace("|", "\\|")
