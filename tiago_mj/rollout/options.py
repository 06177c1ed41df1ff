"""Options of the commands that play episodes: in which environment, with which of its arguments, of which seeds."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium

from tiago_mj.io.loading import parse_json
from tiago_mj.io.quoting import quoted
from tiago_mj.registration import ENVIRONMENTS, NAMESPACE


def check_least(arguments: argparse.Namespace, least: int, *options: str) -> None:
    """Refuse a number below a minimum; None, for an option not given, passes.

    Raises:
        ValueError: says which.
    """
    for option in options:
        value = getattr(arguments, option)
        if value is not None and value < least:
            raise ValueError(f"--{option.replace('_', '-')} is {value}: give {least} or more")


def seeds_of(arguments: argparse.Namespace) -> tuple[int, ...]:
    """The episodes' seeds.

    Raises:
        ValueError: there are no episodes, or a seed is negative.
    """
    check_least(arguments, 1, "episodes")
    check_least(arguments, 0, "seed")
    return tuple(range(arguments.seed, arguments.seed + arguments.episodes))


def environment_id(name: str) -> str:
    """The registered id, given with or without its namespace.

    Raises:
        ValueError: no such environment; lists those there are.
    """
    short = name.removeprefix(f"{NAMESPACE}/")
    if short not in ENVIRONMENTS:
        raise ValueError(f"environment {quoted(name)} is unknown: use one of {', '.join(ENVIRONMENTS)}")
    return f"{NAMESPACE}/{short}"


def read_options(given: Sequence[str]) -> dict[str, Any]:
    """Read ``key=value`` words; a value is JSON, or the word itself where it is none.

    Raises:
        ValueError: a word has no key.
    """
    options = {}
    for word in given:
        key, separator, value = word.partition("=")
        if not separator or not key.isidentifier():
            raise ValueError(
                f"--env-option {quoted(word)} is no key=value: write it as servo=ideal or goal='[0.5, 1.5]'"
            )
        try:
            options[key] = parse_json(value, "")
        except ValueError:
            options[key] = value
    return options


def make_env(identifier: str, options: Mapping[str, Any], **more: Any) -> gymnasium.Env[Any, Any]:
    """The environment with these arguments.

    Raises:
        ValueError: an argument is unusable, or is none of the environment's.
    """
    try:
        return gymnasium.make(identifier, **options, **more)
    except TypeError as fault:
        raise ValueError(f"--env-option: {identifier} does not take this: {' '.join(str(fault).split())}") from fault
