"""Environments of a training, from its settings."""

from __future__ import annotations

from typing import Any

from tiago_mj.learn import randomise
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
    given = settings.randomise
    if given is not None:
        options["draw_effects"] = randomise.drawing(given)
    try:
        env = make_sb3(settings.env, count, seed=0, threads=1, **options)
    except TypeError as fault:
        reason = " ".join(str(fault).split()).partition("() ")[2] or str(fault)
        raise ValueError(f"{settings.env} with --env-option: {reason}") from fault
    if given is not None:
        try:
            randomise.check_fits(given, env.envs.core)
        except ValueError as fault:
            env.close()
            raise ValueError(f"--randomise: {fault}") from fault
    return env


def make_one_env(settings: Settings) -> Any:
    """One scalar environment of a training, for a controller to look at or to play in."""
    options = {"visual": False, **settings.env_options}
    if settings.effects is not None:
        options["effects"] = settings.effects
    return make_scalar(settings.env, options)
