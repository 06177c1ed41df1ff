"""Stable-baselines3's own PPO with the lines that the page of learning prints, and the agent trained by them."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from tiago_mj.learn.build import make_model
from tiago_mj.learn.environments import make_env
from tiago_mj.learn.settings import Settings
from tiago_mj.learn.shipped import shipped_agents
from tiago_mj.learn.zoo_form import read_hyperparameters

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
STEADY = "tiago_mj/GripperTactileSteady-v0"


@pytest.fixture(scope="module")
def stock():
    sys.path.insert(0, str(BENCHMARKS))
    yield importlib.import_module("stock_ppo")
    sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def differences():
    sys.path.insert(0, str(BENCHMARKS))
    yield importlib.import_module("differences")
    sys.path.remove(str(BENCHMARKS))


def test_the_page_trains_what_the_command_trains(stock, capsys):
    names = {}
    exec(stock.recipe(3).replace("model.learn(800_000)", "model.learn(4_096)"), names)
    printed, envs = names["model"], names["envs"]
    assert "success: 0%" in capsys.readouterr().out, "nothing is learned in one round"
    given = read_hyperparameters("ppo", STEADY.removeprefix("tiago_mj/"))
    settings = Settings(STEADY, "ppo", 800_000, given["env_kwargs"], None, given)
    trained = make_model(settings, make_env(settings, given["n_envs"]), 3)
    assert f"model.learn({given['n_timesteps']:_})" in stock.recipe(0)
    for name in ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm"):
        assert getattr(printed, name) == getattr(trained, name), name
    for share in (1.0, 0.5, 0.0):
        assert printed.lr_schedule(share) == pytest.approx(trained.lr_schedule(share))
        assert printed.clip_range(share) == trained.clip_range(share)
    assert envs.num_envs == trained.env.num_envs
    assert envs.envs.core.exponent == trained.env.venv.envs.core.exponent == 0.5
    assert (envs.gamma, envs.clip_obs, envs.norm_reward) == (0.9, trained.env.clip_obs, trained.env.norm_reward)
    assert str(printed.policy) == str(trained.policy)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_stock_ppo_holds_the_force_within_five_minutes_of_two_processors(stock, seed):
    _, cost = stock.trained(seed)
    assert cost["success_as_printed"] >= 0.95
    assert cost["processor_s"] <= 2 * 300.0


def test_the_shipped_agent_of_the_steady_task_is_at_least_as_good_as_the_tuned_controller(stock):
    assert stock.SHIPPED in shipped_agents()
    found = stock.compared({"pi-tuned": "pi-tuned", stock.SHIPPED: stock.SHIPPED}, range(920_000, 920_016))
    ours, theirs = found[stock.SHIPPED], found["pi-tuned"]
    assert ours["success"] >= theirs["success"] == 1.0
    assert ours["beside_pi_tuned"]["reward"]["low"] > 0
    assert ours["reward"] - theirs["reward"] == pytest.approx(ours["beside_pi_tuned"]["reward"]["mean"])


def test_paired_differences_have_students_interval(differences):
    found = differences.difference([1.0, 2.0, 6.0], [0.0, 0.0, 3.0])  # 1, 2, 3: standard error 1 / sqrt(3), t 4.303
    assert found["mean"] == pytest.approx(2.0)
    assert (found["low"], found["high"]) == pytest.approx((2 - 4.3027 / np.sqrt(3), 2 + 4.3027 / np.sqrt(3)), abs=1e-4)
    with pytest.raises(ValueError, match="1 and 2 episodes"):
        differences.difference([1.0], [1.0, 2.0])
