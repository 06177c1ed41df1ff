"""Arguments of an environment on the command line: ``--env-option servo="ideal"``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium


def read_options(given: Sequence[str]) -> dict[str, Any]:
    """Read ``key=value`` words; a value is JSON, or the word itself where it is none.

    Raises:
        ValueError: a word has no key.
    """
    options = {}
    for word in given:
        key, separator, value = word.partition("=")
        if not separator or not key.isidentifier():
            raise ValueError(f"--env-option {word!r} is no key=value: write it as servo=ideal or goal='[0.5, 1.5]'")
        try:
            options[key] = json.loads(value)
        except json.JSONDecodeError:
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
