"""The faster updates are stable-baselines3's."""

import copy

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra 'train'")
from stable_baselines3 import TD3, HerReplayBuffer  # noqa: E402
from stable_baselines3.common.logger import Logger  # noqa: E402
from stable_baselines3.common.type_aliases import ReplayBufferSamples  # noqa: E402

from tiago_mj.learn.build import make_model  # noqa: E402
from tiago_mj.learn.environments import make_env  # noqa: E402
from tiago_mj.learn.perceptron import stacked  # noqa: E402
from tiago_mj.learn.replay import HindsightBuffer  # noqa: E402
from tiago_mj.learn.settings import Settings  # noqa: E402
from tiago_mj.learn.updates import Descent, FastTD3  # noqa: E402
from tiago_mj.learn.zoo_form import read_hyperparameters  # noqa: E402

#: Float32 rounding (6e-8) grows through some hundred Adam steps, whose size is 1e-3 whatever the gradient's.
TOLERANCE = 2e-4


def settings(algo, env, **changes):
    given = read_hyperparameters(algo, env) | changes
    return Settings(f"tiago_mj/{env}", algo, 600, {**given["env_kwargs"], "max_episode_steps": 50}, None, given)


def learned(chosen, *, fast, fused, envs=1):
    env = make_env(chosen, envs)
    model = make_model(chosen, env, 3, fast=fast, fused=fused)
    model.learn(300, log_interval=None)
    return model


@pytest.mark.parametrize("fused", [False, True])
def test_fast_updates_end_with_stable_baselines3s_parameters(fused):
    chosen = settings("td3", "GripperTactile-v0", policy_kwargs={"net_arch": [32, 24]}, batch_size=20)
    ours = learned(chosen, fast=True, fused=fused)
    theirs = learned(chosen, fast=False, fused=False)
    assert type(ours) is FastTD3
    assert type(theirs) is TD3
    assert ours._n_updates == theirs._n_updates == 200, "two episodes are over before learning starts"
    start = make_model(chosen, make_env(chosen, 1), 3).policy.state_dict()
    for name, parameter in theirs.policy.state_dict().items():
        assert torch.allclose(ours.policy.state_dict()[name], parameter, atol=TOLERANCE), name
        assert not torch.allclose(start[name], parameter, atol=TOLERANCE), f"{name} must have been learned"


def test_gradients_computed_layer_by_layer_are_those_of_automatic_differentiation():
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Linear(5, 7), torch.nn.ReLU(), torch.nn.Linear(7, 4), torch.nn.ReLU(),
                                  torch.nn.Linear(4, 2)).double()  # fmt: skip
    x, weights = torch.randn(9, 5).double().requires_grad_(), torch.randn(9, 2).double()
    expected = torch.autograd.grad((network(x) * weights).sum(), [x, *network.parameters()])
    parameters = [list(network.parameters())]
    with torch.no_grad():
        (_, (ours,)), (flat, (gradient,)) = stacked(parameters), stacked(parameters)
        values = ours.forward(x)
        first = ours.backward(values, weights, gradient)
    np.testing.assert_allclose(values[-1], network(x).detach(), rtol=1e-12)
    np.testing.assert_allclose(first @ ours.weights[0], expected[0], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(flat, torch.cat([g.reshape(-1) for g in expected[1:]]), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "fast"),
    [
        ({}, True),
        ({"policy_kwargs": {"net_arch": [8], "n_critics": 3}}, True),
        ({"policy_kwargs": {"net_arch": [8], "activation_fn": "Tanh"}}, False),
        ({"gradient_steps": 3}, False),
    ],
)
def test_other_networks_and_short_runs_are_left_to_stable_baselines3(changes, fast, monkeypatch):
    called = []
    monkeypatch.setattr(TD3, "train", lambda self, *_: called.append(True))
    learned(
        settings("td3", "GripperTactile-v0", **{"policy_kwargs": {"net_arch": [8]}} | changes), fast=True, fused=True
    )
    assert bool(called) != fast


def test_ten_fast_updates_are_stable_baselines3s_to_rounding():
    chosen = settings("td3", "GripperTactile-v0", learning_starts=1000)  # the full networks, as they begin
    model = learned(chosen, fast=True, fused=False)
    other = learned(chosen, fast=True, fused=False)
    for update, one in ((FastTD3.train, model), (TD3.train, other)):
        one._n_updates = 0
        np.random.seed(1)  # noqa: NPY002
        torch.manual_seed(1)
        update(one, gradient_steps=10, batch_size=100)
    for name, parameter in other.policy.state_dict().items():
        assert torch.allclose(model.policy.state_dict()[name], parameter, atol=1e-6), name


def test_hindsight_replay_draws_what_stable_baselines3s_draws():
    chosen = settings("her-td3", "TIAGoReach-v0", policy_kwargs={"net_arch": [8]}, learning_starts=1000)
    model = learned(chosen, fast=True, fused=True, envs=2)
    ours = model.replay_buffer
    assert isinstance(ours, HindsightBuffer)
    theirs = copy.copy(ours)
    theirs.__class__ = HerReplayBuffer
    theirs.set_env(ours.env)
    for _ in range(3):
        state = np.random.get_state()  # noqa: NPY002
        drawn = ours.sample(40)
        np.random.set_state(state)  # noqa: NPY002
        expected = theirs.sample(40)
        for a, b in zip(drawn[:-1], expected[:-1], strict=True):  # the last are discounts, which neither has
            for key in a if isinstance(a, dict) else [None]:
                torch.testing.assert_close(a if key is None else a[key], b if key is None else b[key], rtol=0, atol=0)
    ours.add(*_transition(ours))
    assert ours._replayable is None, "what can be replayed is looked up again after an addition"


def _transition(buffer):
    row = buffer.pos - 1
    seen = {key: value[row].copy() for key, value in buffer.observations.items()}
    done = np.zeros(buffer.n_envs)
    return seen, seen, buffer.actions[row], buffer.rewards[row], done, [{}] * buffer.n_envs


def _taught(reward, bias, **changes):
    """The action of a small TD3 whose actor began at a bias, after 600 updates on 200 random actions' rewards."""
    chosen = settings("td3", "GripperTactile-v0", policy_kwargs={"net_arch": [16]}, gamma=0.0, **changes)
    model = make_model(chosen, make_env(chosen, 1), 0)
    seen, generator = model.observation_space.shape, np.random.default_rng(0)
    for _ in range(200):
        action = generator.uniform(-1, 1, (1, 2)).astype(np.float32)
        model.replay_buffer.add(np.zeros((1, *seen)), np.zeros((1, *seen)), action, reward(action), np.ones(1), [{}])
    with torch.no_grad():
        model.actor.mu[-2].bias.fill_(bias)
    model.set_logger(Logger(folder=None, output_formats=[]))
    model.train(600, 32)
    return model.predict(np.zeros(seen, dtype=np.float32), deterministic=True)[0]


@pytest.mark.parametrize(("leak", "comes_back"), [(0.1, True), (0.0, False)])
def test_an_actor_at_the_end_of_its_range_comes_back_if_its_tanh_leaks(leak, comes_back):
    action = _taught(lambda action: -action.sum(1), 20.0, learning_rate=0.05, leak=leak)  # the less, the better
    assert (action < 0).all() if comes_back else (action == 1).all()


@pytest.mark.parametrize(("action_cost", "rests"), [(1.0, True), (0.0, False)])
def test_an_actor_that_pays_for_its_actions_rests_where_they_earn_nothing(action_cost, rests):
    action = _taught(lambda action: np.zeros(1), 1.0, learning_rate=0.01, action_cost=action_cost)
    assert (np.abs(action).max() < 0.05) == rests


def test_what_an_action_costs_is_in_the_actors_gradient():
    chosen = settings("td3", "GripperTactile-v0", policy_kwargs={"net_arch": [8]}, action_cost=0.7)
    model = make_model(chosen, make_env(chosen, 1), 0)
    seen = torch.randn(5, *model.observation_space.shape)
    descent = Descent(model)
    with torch.no_grad():
        descent._update_actor(seen)
    action = model.actor(seen)
    judged = model.critic.q1_forward(seen, action)
    loss = 0.7 * (action**2).mean() - judged.mean()
    expected = torch.autograd.grad(loss, list(model.actor.mu.parameters()))
    ours = descent._actor_gradient.flat
    torch.testing.assert_close(ours, torch.cat([part.reshape(-1) for part in expected]), rtol=1e-4, atol=1e-7)
    assert descent.actor_loss == pytest.approx(loss.item(), rel=1e-5)


@pytest.mark.parametrize(("value_range", "taught"), [(None, (-1.6, -0.2)), ([-1.5, -0.4], (-1.5, -0.4))])
def test_critics_are_taught_no_value_beyond_the_range(value_range, taught):
    chosen = settings("td3", "GripperTactile-v0", gamma=0.0, value_range=value_range)
    model = make_model(chosen, make_env(chosen, 1), 0)
    rewards = torch.tensor([[-1.6], [-1.0], [-0.2]])
    seen = torch.zeros(3, *model.observation_space.shape)
    batch = ReplayBufferSamples(seen, torch.zeros(3, 2), seen, torch.zeros(3, 1), rewards)
    with torch.no_grad():
        wanted = Descent(model)._wanted(batch, seen).flatten().tolist()
    assert wanted == pytest.approx([taught[0], -1.0, taught[1]])


@pytest.mark.parametrize(("key", "value"), [("leak", 0.1), ("action_cost", 0.1), ("value_range", [-20, 0])])
def test_what_only_our_updates_know_is_for_their_networks(key, value):
    changes = {key: value, "policy_kwargs": {"net_arch": [8], "activation_fn": "Tanh"}}
    other = settings("td3", "GripperTactile-v0", **changes)
    with pytest.raises(ValueError, match=f"{key} is of networks with ReLU"):
        make_model(other, make_env(other, 1), 0)
