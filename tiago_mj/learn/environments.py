"""Environments of a training, from its settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tiago_mj.effects import read_effects
from tiago_mj.learn.randomise import Randomised
from tiago_mj.learn.settings import Settings
from tiago_mj.rollout.options import make_env as make_scalar
from tiago_mj.vector.sb3 import make_sb3


def make_env(settings: Settings, count: int) -> Any:
    """A vector environment for stable-baselines3, on one thread and without what is only seen.

    Raises:
        ValueError: an option of the environment is unknown or unusable; one line.
    """
    options = {"visual": False, **settings.env_options}
    if settings.effects is not None:
        options["effects"] = settings.effects
    try:
        if settings.randomise is not None:
            return _randomised(settings, settings.randomise, count, options)
        return make_sb3(settings.env, count, seed=0, threads=1, **options)
    except TypeError as fault:
        reason = " ".join(str(fault).split()).partition("() ")[2] or str(fault)
        raise ValueError(f"{settings.env} with --env-option: {reason}") from fault


def make_one_env(settings: Settings) -> Any:
    """One scalar environment of a training, for a controller to look at or to play in."""
    options = {"visual": False, **settings.env_options}
    if settings.effects is not None:
        options["effects"] = settings.effects
    return make_scalar(settings.env, options)


def _randomised(settings: Settings, ranges: Mapping[str, Any], count: int, options: dict[str, Any]) -> Any:
    always = read_effects(settings.effects)

    def make(drawn: Sequence[Any]) -> Any:
        return make_sb3(settings.env, 1, threads=1, **{**options, "effects": [*always, *drawn]})

    return Randomised(make, count, ranges)
