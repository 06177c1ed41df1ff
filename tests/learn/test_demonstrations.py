"""Demonstrations are replayed like the agent's own episodes, and the actor follows those that the critic prefers."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra 'train'")

from tiago_mj.learn import build, demonstrations  # noqa: E402
from tiago_mj.learn.environments import make_env  # noqa: E402
from tiago_mj.learn.loop import Task, train_seed  # noqa: E402
from tiago_mj.learn.settings import Settings  # noqa: E402
from tiago_mj.learn.updates import Descent  # noqa: E402
from tiago_mj.learn.zoo_form import checked, read_hyperparameters  # noqa: E402

STEPS = 50


def settings(env="TIAGoReach-v0", algo="her-td3", **asked):
    shown = {"policy": "scripted", "episodes": 4, "noise": 0.1, "updates": 20, "weight": 1.0} | asked
    given = read_hyperparameters(algo, env) | {
        "n_envs": 2,
        "policy_kwargs": {"net_arch": [16]},
        "learning_starts": 100,
        "batch_size": 16,
        "train_freq": [5, "step"],
        "gradient_steps": 2,
        "normalize": False,
        "leak": 0.0,
        "demonstrations": shown,
    }
    return Settings(f"tiago_mj/{env}", algo, 300, {"max_episode_steps": STEPS}, None, given, checkpoint_every=150,
                    evaluate_every=300, evaluation_episodes=1)  # fmt: skip


def model_of(chosen, seed=0):
    return build.make_model(chosen, make_env(chosen, 2), seed)


def test_the_replay_buffer_holds_the_controllers_episodes():
    chosen = settings()
    model = model_of(chosen)
    build.demonstrate(model, chosen, 0, stored=False)
    buffer = model.replay_buffer
    assert buffer.pos * buffer.n_envs == 4 * STEPS
    assert (buffer.ep_length[: buffer.pos] == STEPS).all(), "whole episodes, so that hindsight can relabel them"
    last = buffer.rewards[buffer.pos - 1]
    assert (last == 0).all(), "the scripted expert has reached the goal at the end"
    batch = buffer.sample(32)
    assert np.isfinite(batch.rewards.numpy()).all()


def test_examples_are_what_the_controller_meant_not_the_noise():
    chosen = settings(noise=0.5)
    found = demonstrations.played(chosen, 2, seed=0)
    assert np.abs(found.actions - found.intended)[..., :8].std() > 0.1
    assert np.abs(found.intended).max() <= 1.0
    other = demonstrations.played(chosen, 2, seed=1)
    assert not np.array_equal(found.observations["desired_goal"], other.observations["desired_goal"])


@pytest.mark.parametrize(("keep", "pulls"), [(0.0, (8.0, 4.0, 0.0)), (0.25, (8.0, 5.0, 2.0)), (1.0, (8.0, 8.0, 8.0))])
def test_the_pull_falls_to_the_share_that_is_kept(keep, pulls):
    chosen = settings(weight=8.0, updates=0, keep=keep)
    model = model_of(chosen)
    build.demonstrate(model, chosen, 0, stored=False)
    assert [model.examples.weight(left) for left in (1.0, 0.5, 0.0)] == pytest.approx(list(pulls))


def test_observations_of_demonstrations_are_normalised_from_the_start():
    chosen = settings()
    chosen = replace(chosen, hyperparameters=chosen.hyperparameters | {"normalize": {"norm_reward": False}})
    model = model_of(chosen)
    build.demonstrate(model, chosen, 0, stored=False)
    statistics = model.get_vec_normalize_env().obs_rms
    found = demonstrations.played(chosen, 2, seed=0).observations
    for name, one in statistics.items():
        rows = found[name].reshape(-1, found[name].shape[-1])
        np.testing.assert_allclose(one.mean, rows.mean(axis=0), rtol=1e-3, atol=1e-5)
    seen, _ = model.examples.drawn(model.get_vec_normalize_env())
    assert 0.7 < float(seen["desired_goal"].std(dim=0).mean()) < 1.3


def test_the_pull_is_the_gradient_of_the_squared_difference():
    chosen = settings(updates=0)
    model = model_of(chosen)
    build.demonstrate(model, chosen, 0, stored=False)
    torch.manual_seed(5)
    with torch.no_grad():
        ours = Descent(model)._towards(model.examples).clone()
    torch.manual_seed(5)
    seen, wanted = model.examples.drawn()
    loss = ((model.actor(seen) - wanted) ** 2).sum() / len(wanted)
    expected = torch.cat([part.reshape(-1) for part in torch.autograd.grad(loss, list(model.actor.mu.parameters()))])
    torch.testing.assert_close(ours, expected, rtol=1e-4, atol=1e-7)


def test_the_actor_imitates_before_the_first_step():
    chosen = settings(updates=400)
    far, near = (model_of(chosen) for _ in range(2))
    build.demonstrate(near, chosen, 0, stored=False)
    seen, wanted = near.examples.drawn()
    with torch.no_grad():
        before, after = (float(torch.mean((model.actor(seen) - wanted) ** 2)) for model in (far, near))
    assert after < 0.5 * before


def test_a_training_that_goes_on_has_the_same_demonstrations(tmp_path, monkeypatch):
    chosen = settings()
    whole = train_seed(Task(chosen, 0, str(tmp_path / "whole")))
    from tiago_mj.learn import callbacks

    class StoppedError(Exception):
        pass

    saved = callbacks.Checkpoints.save

    def save(self, *, finished):
        saved(self, finished=finished)
        if not finished:
            raise StoppedError

    with monkeypatch.context() as patch:
        patch.setattr(callbacks.Checkpoints, "save", save)
        with pytest.raises(StoppedError):
            train_seed(Task(chosen, 0, str(tmp_path / "two")))
    again = train_seed(Task(chosen, 0, str(tmp_path / "two")))
    same = ("best_mean", "best_steps", "mean_return", "steps")
    assert {key: again[key] for key in same} == {key: whole[key] for key in same}
    first, second = (np.load(tmp_path / name / "last.npz") for name in ("whole", "two"))
    for key in first.files:
        np.testing.assert_array_equal(first[key], second[key])


def test_controllers_of_other_tasks_and_other_algorithms_are_refused():
    chosen = settings(policy="pi")
    with pytest.raises(ValueError, match="policy pi holds a force"):
        build.demonstrate(model_of(chosen), chosen, 0, stored=False)
    given = read_hyperparameters("ppo", "GripperTactile-v0")
    shown = checked("ppo", {**given, "demonstrations": {"policy": "pi"}}, "here")
    with pytest.raises(ValueError, match="demonstrations are of td3 and her-td3"):
        model_of(Settings("tiago_mj/GripperTactile-v0", "ppo", 100, {}, None, shown))
    with pytest.raises(ValueError, match=r"demonstrations.*policy"):
        checked("her-td3", {**read_hyperparameters("her-td3", "TIAGoReach-v0"), "demonstrations": {"noise": 0.1}}, "x")
