"""``tiago-mj agents``: the agents that come with the package, and how a training's best becomes one."""

from __future__ import annotations

import argparse
import json
import re
import shlex
from collections.abc import Mapping
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

from tiago_mj.io import atomic, outputs
from tiago_mj.io.quoting import quoted
from tiago_mj.learn.agent_file import SUFFIX, load_agent

#: A name that no other kind of policy can have.
NAME: Final = re.compile(r"[a-z][a-z0-9-]{2,40}")


def folder() -> Path:
    """Where the package's agents are."""
    with as_file(files("tiago_mj.learn") / "agents") as path:
        return path


def shipped_agents() -> dict[str, Path]:
    """Name and file of every agent that comes with the package."""
    return {path.stem: path for path in sorted(folder().glob(f"*{SUFFIX}"))}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--export", type=Path, metavar="DIR", help="of tiago-mj train: export its best agent")
    parser.add_argument("--name", metavar="NAME", help="of the exported agent")
    parser.add_argument("--seed", type=int, metavar="N", help="of the training whose agent it is (the best one's)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--last", action="store_true", help="the training's last agent, not its best")
    which.add_argument("--evaluated", action="store_true", help="the one with the best evaluation without exploration")
    parser.add_argument(
        "--cut", action="store_true", help="take observations beyond those of the training for the nearest of them"
    )
    parser.add_argument("--to", type=outputs.folder, default=Path(), metavar="FOLDER", help="where it goes (here)")
    parser.add_argument("--json", action="store_true", help="print the same as data")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: the folder holds no finished training, or the name is unusable.
    """
    if arguments.export is not None:
        which = "last" if arguments.last else "evaluated" if arguments.evaluated else "best"
        path = export(
            arguments.export, arguments.name, arguments.to, seed=arguments.seed, which=which, cut=arguments.cut
        )
        card = path.with_suffix(".md")
        print(json.dumps({"agent": str(path), "card": str(card)}) if arguments.json else f"agent {path}, card {card}")
        return 0
    listed: list[dict[str, Any]] = []
    for name, path in shipped_agents().items():
        origin = load_agent(path, name).origin
        listed.append({"name": name, **{key: origin.get(key) for key in ("env", "algo", "steps", "env_options")}})
    if arguments.json:
        print(json.dumps(listed, indent=2))
        return 0
    for agent in listed:
        options = ", ".join(f"{key}={json.dumps(value)}" for key, value in (agent["env_options"] or {}).items())
        print(f"{agent['name']}: {agent['algo']} on {agent['env']}" + (f" with {options}" if options else ""))
    print(f"{len(listed)} agent{'' if len(listed) == 1 else 's'}; use the first with: {_use(listed[0])}")
    return 0


def _use(agent: Mapping[str, Any]) -> str:
    """Command that plays an agent in its training environment."""
    words = [f"{key}={json.dumps(value)}" for key, value in (agent["env_options"] or {}).items()]
    options = "".join(f" --env-option {shlex.quote(word)}" for word in words)
    return f"tiago-mj rollout --env {agent['env'].partition('/')[2]}{options} --policy {agent['name']}"


def export(
    training: Path, name: str | None, to: Path, *, seed: int | None = None, which: str = "best", cut: bool = False
) -> Path:
    """Copy an agent of a training and its card under a name.

    Args:
        training: folder that ``tiago-mj train`` has written.
        name: of the agent: small letters, digits and hyphens.
        to: folder of ``NAME.npz``, ``NAME.json`` and ``NAME.md``.
        seed: whose agent; None: the best seed's.
        which: ``best`` by 20 training episodes, best ``evaluated`` without exploration, or ``last``.
        cut: whether its observations are cut at those of its training (:mod:`tiago_mj.learn.cut`).

    Returns:
        The npz.

    Raises:
        ValueError: no finished training, no such seed in it, or an unusable name; one line.
    """
    from tiago_mj.learn.card import markdown, read

    if name is None:
        raise ValueError("--name is missing: give the exported agent one of 3 to 41 small letters, digits and hyphens")
    if not NAME.fullmatch(name):
        raise ValueError(f"--name is {quoted(name)}: give 3 to 41 small letters, digits and hyphens")
    if name in ("random",):
        raise ValueError(f"--name {name} is that of another policy: choose another")
    try:
        card = read(training / "card.json")
        trained = [result["seed"] for result in card["seeds"]]
        card["agent_seed"] = card["best_seed"] if seed is None else seed
    except ValueError as fault:
        raise ValueError(f"--export {training} holds no finished training: card.json: {fault}") from fault
    if card["agent_seed"] not in trained:
        raise ValueError(f"--seed is {seed}: the training has {', '.join(str(one) for one in trained)}")
    card |= {"agent": which, "agent_is_cut": cut}
    folder = training / f"seed-{card['agent_seed']}"
    agent = load_agent(folder / f"{which}{SUFFIX}")
    if cut:
        # They take torch, which no agent needs once it is trained.
        from tiago_mj.learn import cut as cutting
        from tiago_mj.learn.checkpoint import FILE

        agent = cutting.cut(agent, *cutting.met(folder / FILE, agent))
    path = to / f"{name}{SUFFIX}"
    with atomic.replacing_set(to) as new:
        copy = new / path.name
        agent.save(copy)
        atomic.write_text(copy.with_suffix(".json"), json.dumps({"name": name, **card}, indent=1) + "\n")
        atomic.write_text(copy.with_suffix(".md"), markdown(card, name))
    return path
