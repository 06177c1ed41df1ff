"""Agents as files of numbers: the model's own actions without the model's library, and no file that is run."""

from __future__ import annotations

import json
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj import cli
from tiago_mj.learn import shipped
from tiago_mj.learn.agent_file import load_agent
from tiago_mj.rollout.policies import make_policy

sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")

from tiago_mj.learn.build import make_model  # noqa: E402
from tiago_mj.learn.environments import make_env  # noqa: E402
from tiago_mj.learn.export import agent_of  # noqa: E402
from tiago_mj.learn.settings import Settings  # noqa: E402
from tiago_mj.learn.zoo_form import checked  # noqa: E402

GRIPPER, GOAL = "tiago_mj/GripperTactile-v0", "tiago_mj/GripperTactileGoal-v0"


def model_of(algo, env_id, **entry):
    off_policy = {} if algo in ("ppo", "a2c") else {"train_freq": 1, "buffer_size": 50}
    given = checked(algo, {"policy_kwargs": {"net_arch": [12, 8]}, **off_policy, **entry}, "test")
    chosen = Settings(env_id, algo, 100, {}, None, given)
    env = make_env(chosen, 2)
    return make_model(chosen, env, 0), env


@pytest.mark.parametrize(
    ("algo", "env_id", "entry"),
    [
        ("td3", GRIPPER, {}),
        ("ddpg", GRIPPER, {"policy_kwargs": {"net_arch": [7], "activation_fn": "nn.ELU"}}),
        ("sac", GOAL, {}),
        ("td3", GRIPPER, {"normalize": True}),
        ("ppo", GRIPPER, {"normalize": True}),
        ("a2c", GOAL, {"normalize": True}),
        ("her-td3", GOAL, {"policy_kwargs": "dict(net_arch=[9, 9], activation_fn=nn.Tanh)"}),
    ],
)
def test_an_exported_agent_acts_as_the_model_does(algo, env_id, entry, tmp_path):
    model, env = model_of(algo, env_id, **entry)
    if model.get_vec_normalize_env() is not None:
        model.env.reset()
        for _ in range(20):
            model.env.step(np.full((2, 2), -0.5, dtype=np.float32))
        model.env.training = False
    agent_of(model, {"env": env_id}).save(tmp_path / "agent.npz")
    agent = load_agent(tmp_path / "agent.npz")
    env.seed(5)
    seen = env.reset()
    moved = 0.0
    for _ in range(10):
        normalise = getattr(model.env, "normalize_obs", lambda x: x)
        expected = model.predict(normalise(seen), deterministic=True)[0]
        action = agent(seen)
        np.testing.assert_allclose(action, expected, atol=2e-6)  # float32 sums in another order
        assert action.dtype == np.float32
        one = {k: v[0] for k, v in seen.items()} if isinstance(seen, dict) else seen[0]
        np.testing.assert_allclose(agent(one, {}), expected[0], atol=2e-6)
        moved = max(moved, float(np.abs(action).max()))
        seen, *_ = env.step(action)
    assert moved > 0


@pytest.fixture
def agent(tmp_path):
    """The file of an agent for the gripper."""
    model, _ = model_of("td3", GRIPPER)
    path = tmp_path / "agent.npz"
    agent_of(model, {"env": GRIPPER}).save(path)
    return path


def complaint(capsys, *words):
    status = cli.main(words)
    said = capsys.readouterr()
    assert status == 2
    assert said.err.count("\n") == 1, said.err
    return said.err


def test_it_is_used_without_trust_and_without_torch(agent):
    code = (
        "import sys; sys.modules['torch'] = sys.modules['stable_baselines3'] = None\n"
        "from tiago_mj import cli\n"
        f"sys.exit(cli.main(['rollout', '--env', 'GripperTactile-v0', '--policy', {str(agent)!r}, '--json']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["episodes"][0]["steps"] == 300


def test_a_policy_of_another_observation_space_is_refused(agent, capsys):
    said = complaint(capsys, "rollout", "--env", "TIAGoTactile-v0", "--policy", str(agent))
    assert "observes 6 numbers" in said
    assert "gives 22 numbers" in said
    said = complaint(capsys, "rollout", "--env", "GripperTactileGoal-v0", "--policy", str(agent))
    assert "a dictionary of achieved_goal (2), desired_goal (2), observation (6)" in said


def test_a_damaged_agent_is_refused(agent, capsys):
    whole = agent.read_bytes()
    for content in (whole[:-200], whole[: len(whole) // 2] + b"\0" * 9 + whole[len(whole) // 2 + 9 :], b"", b"PK"):
        agent.write_bytes(content)
        assert "damaged" in complaint(capsys, "rollout", "--env", "GripperTactile-v0", "--policy", str(agent))


def test_a_file_with_pickled_objects_is_not_run(tmp_path, capsys):
    path, mark = tmp_path / "evil.npz", tmp_path / "mark"

    class Touch:
        def __reduce__(self):
            return type(mark).touch, (mark,)

    np.savez(path, header=np.array([Touch()], dtype=object))
    assert "damaged" in complaint(capsys, "rollout", "--env", "GripperTactile-v0", "--policy", str(path))
    assert not mark.exists()
    with np.load(path, allow_pickle=True) as file:
        file["header"]
    assert mark.exists(), "the file must be one that does harm when it is trusted"


@pytest.mark.parametrize(
    "change",
    [
        {"weight_0": np.zeros((3, 5), np.float32)},
        {"low": np.zeros(5, np.float32)},
        {"bias_0": np.full(12, np.nan, np.float32)},
        {"header": np.array("{}")},
        {"header": np.array("[")},
    ],
    ids=["shape", "actions", "nan", "schema", "json"],
)
def test_an_agent_whose_parts_do_not_fit_is_refused(agent, change):
    with np.load(agent) as file:
        parts = dict(file) | change
    np.savez(agent, **parts)
    with pytest.raises(ValueError, match="no agent that can be read"):
        load_agent(agent)


def test_a_shipped_agent_is_used_by_name(agent, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(shipped, "folder", lambda: tmp_path)
    env = gymnasium.make(GRIPPER)
    policy = make_policy("agent", env, seed=0, trust=False)
    seen, info = env.reset(seed=1)
    np.testing.assert_array_equal(policy(seen, info), load_agent(agent)(seen))
    env.close()
    assert cli.main(["agents"]) == 0
    assert capsys.readouterr().out.startswith(f"agent: None on {GRIPPER}")
    assert "random, agent" in complaint(capsys, "rollout", "--env", "GripperTactile-v0", "--policy", "nobody")


def test_every_shipped_agent_has_a_card_and_is_small():
    for name, path in shipped.shipped_agents().items():
        origin = load_agent(path).origin
        card = json.loads(path.with_suffix(".json").read_text())
        assert card["name"] == name
        assert card["settings"]["env"] == origin["env"]
        assert path.with_suffix(".md").read_text().startswith(f"# {name}")
        assert path.stat().st_size < 1_000_000


def test_the_best_agent_of_a_training_is_exported_with_its_card(tmp_path, capsys):
    path = tmp_path / "h.yml"
    path.write_text("default: {batch_size: 8, policy_kwargs: {net_arch: [8]}, train_freq: [1, episode]}\n")
    out = tmp_path / "run"
    trained = ["train", "--env", "GripperTactile-v0", "--hyperparameters", str(path), "--steps", "90", "--quiet"]
    options = ["--env-option", "max_episode_steps=30", "--env-option", "servo=ideal", "--out", str(out)]
    assert "no finished training" in complaint(capsys, "agents", "--export", str(out), "--name", "mine")
    assert cli.main([*trained, *options]) == 0
    assert "--name is missing: give the exported agent one" in complaint(capsys, "agents", "--export", str(out))
    to = tmp_path / "agents"
    assert cli.main(["agents", "--export", str(out), "--name", "my-agent", "--to", str(to)]) == 0
    assert sorted(entry.name for entry in to.iterdir()) == ["my-agent.json", "my-agent.md", "my-agent.npz"]
    page = (to / "my-agent.md").read_text()
    assert page.startswith("# my-agent\n")
    assert "--env-option 'servo=ideal'" in page
    assert "--hyperparameters FILE" in page
    assert load_agent(to / "my-agent.npz").origin["env_options"]["servo"] == "ideal"
    assert "This agent: the best of seed 0." in page
    again = ["agents", "--export", str(out), "--name", "another", "--to", str(to), "--seed"]
    assert cli.main([*again, "0"]) == 0
    assert (to / "another.npz").read_bytes() == (to / "my-agent.npz").read_bytes()
    assert cli.main([*again, "0", "--evaluated"]) == 0
    assert "This agent: the best evaluated of seed 0." in (to / "another.md").read_text()
    assert "--seed is 7: the training has 0" in complaint(capsys, *again, "7")
