"""Models of a training, from its settings; importing it takes torch and stable-baselines3."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import gymnasium
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from tiago_mj.learn import demonstrations
from tiago_mj.learn.dagger import Dagger, expert_of
from tiago_mj.learn.environments import make_one_env
from tiago_mj.learn.noise import noise_of
from tiago_mj.learn.replay import HindsightBuffer
from tiago_mj.learn.settings import Settings
from tiago_mj.learn.updates import FastTD3, plain
from tiago_mj.learn.zoo_form import FAST_KEYS, OWN_KEYS, sb3_class

#: Adam in one pass over all parameters. PPO's has the epsilon that stable-baselines3 gives it unless it is told else;
#: A2C's is RMSprop.
OPTIMISERS: Final[Mapping[str, Mapping[str, Any]]] = {
    "td3": {"fused": True},
    "her-td3": {"fused": True},
    "dagger": {"fused": True},
    "ddpg": {"fused": True},
    "sac": {"fused": True},
    "ppo": {"fused": True, "eps": 1e-5},
}


def make_model(settings: Settings, env: Any, seed: int, *, fast: bool = True, fused: bool = True) -> Any:
    """Untrained stable-baselines3 model on the CPU.

    Args:
        settings: of the training.
        env: of :func:`tiago_mj.learn.environments.make_env`; its observations are normalised where the
            hyperparameters ask for it.
        seed: of everything that the model draws.
        fast: whether TD3 has :mod:`tiago_mj.learn.updates` in place of stable-baselines3's own updates.
        fused: whether Adam is fused.

    Raises:
        ValueError: the algorithm does not fit the environment, or an argument is unusable; one line.
    """
    algo, given = settings.algo, settings.hyperparameters
    goal_form = isinstance(env.observation_space, gymnasium.spaces.Dict)
    if algo == "her-td3" and not goal_form:
        raise ValueError(
            f"her-td3 relabels goals, and {settings.env} has none in its observation: use an id with Goal, or a task "
            "of reaching, pushing or picking"
        )
    kind = sb3_class(algo)
    if fast and algo in ("td3", "her-td3"):
        kind = FastTD3
    elif algo == "dagger":
        kind = Dagger
    arguments = {k: _value(k, v) for k, v in given.items() if k not in OWN_KEYS}
    arguments["policy_kwargs"] = _policy_arguments(algo, given["policy_kwargs"], fused)
    if "train_freq" in arguments:
        arguments.update(_rollout(settings, env.num_envs))
        arguments["action_noise"] = noise_of(given, env.action_space.shape)
    if algo == "her-td3":
        arguments["replay_buffer_class"] = HindsightBuffer
        first = env.num_envs * settings.episode_steps  # nothing can be relabelled before an episode is over
        arguments["learning_starts"] = max(int(arguments.get("learning_starts", 0)), first)
    policy = "MultiInputPolicy" if goal_form else given["policy"]
    if policy == "MultiInputPolicy" and not goal_form:
        raise ValueError(f"policy MultiInputPolicy is for observations with goals, {settings.env} has none: MlpPolicy")
    try:
        model = kind(policy, _wrapped(env, given), seed=seed, device="cpu", **arguments)
    except (TypeError, AssertionError, KeyError) as fault:
        reason = " ".join(str(fault).split())
        raise ValueError(f"{algo} cannot be made of these hyperparameters: {reason}") from fault
    _give_expert(model, settings)
    for key in FAST_KEYS:
        if key in given:
            if not hasattr(model, key):
                raise ValueError(f"{key} is of td3 and her-td3: leave it out of the hyperparameters for {algo}")
            setattr(model, key, given[key])
    shown = given.get("demonstrations")
    if shown and not hasattr(model, "examples"):
        raise ValueError(f"demonstrations are of td3 and her-td3: leave them out of the hyperparameters for {algo}")
    used = [key for key in ("leak", "action_cost", "value_range") if getattr(model, key, None)]
    for key in (*used, *(("demonstrations",) if shown else ())):
        if not plain(model):
            raise ValueError(f"{key} is of networks with ReLU that learn with Adam: leave it out, or the activation_fn")
    return model


def _give_expert(model: Any, settings: Settings) -> None:
    """Give DAgger's model the expert that it asks.

    Raises:
        ValueError: nothing would be learned of it, or the algorithm asks none; one line.
    """
    if settings.algo == "dagger":
        if settings.steps <= model.learning_starts:
            raise ValueError(
                f"steps is {settings.steps} and learning_starts {model.learning_starts}: nothing would be learned; "
                "give more steps, or a smaller learning_starts"
            )
        one = make_one_env(settings)
        try:
            model.expert = expert_of(settings.hyperparameters.get("expert", "scripted"), one)
        finally:
            one.close()
    elif "expert" in settings.hyperparameters:
        raise ValueError(f"expert is of dagger: leave it out of the hyperparameters for {settings.algo}")


def demonstrate(model: Any, settings: Settings, seed: int, *, stored: bool) -> None:
    """Add the demonstrations of the hyperparameters to a model, if there are any.

    Args:
        model: of :func:`make_model`.
        settings: of the training.
        seed: of the training.
        stored: whether the replay buffer has them already, as that of a checkpoint does.

    Raises:
        ValueError: there is no such controller for this environment; one line.
    """
    asked = settings.hyperparameters.get("demonstrations")
    if not asked:
        return
    found = demonstrations.played(settings, model.env.num_envs, seed)
    model.examples = demonstrations.Examples(found, asked["weight"], asked.get("keep", 0.0))
    if stored:
        return
    demonstrations.store(found, model.replay_buffer)
    if (normalised := model.get_vec_normalize_env()) is not None:
        demonstrations.show(found, normalised)
    model.imitate(asked["updates"])


def _wrapped(env: Any, given: Mapping[str, Any]) -> Any:
    normalize = given["normalize"]
    if not normalize:
        return env
    return VecNormalize(env, **({} if normalize is True else normalize))


def _value(key: str, value: Any) -> Any:
    if isinstance(value, str) and value.startswith("lin_"):
        return LinearSchedule(float(value.removeprefix("lin_")), 0.0, 1.0)
    if isinstance(value, float) and value.is_integer() and key in ("buffer_size", "batch_size", "learning_starts"):
        return int(value)
    return value


def _policy_arguments(algo: str, given: Any, fused: bool) -> dict[str, Any]:
    arguments = dict(given)
    if "activation_fn" in arguments:
        arguments["activation_fn"] = getattr(nn, arguments["activation_fn"])
    if fused and algo in OPTIMISERS:
        arguments["optimizer_kwargs"] = {**OPTIMISERS[algo]}
    return arguments


def _rollout(settings: Settings, envs: int) -> dict[str, Any]:
    """Steps between updates, number of updates, and size of the replay buffer."""
    given = settings.hyperparameters
    count, unit = given["train_freq"]
    if unit == "episode" and envs > 1:  # stable-baselines3 counts episodes of one environment only
        count, unit = max(1, round(count * settings.episode_steps / envs)), "step"
    collected = count * (settings.episode_steps if unit == "episode" else envs)
    updates = given.get("gradient_steps", 1)
    if settings.updates_per_step is not None:
        updates = max(1, round(settings.updates_per_step * collected))
    most = envs * (math.ceil((settings.steps + collected) / envs) + 1)  # what can ever be stored
    if shown := given.get("demonstrations"):
        most += envs * demonstrations.episodes_each(shown, envs) * settings.episode_steps
    return {
        "train_freq": (count, unit),
        "gradient_steps": int(updates),
        "buffer_size": min(int(given.get("buffer_size", 1_000_000)), most),
    }
