"""Imitation with corrections: who acts, what is stored, what is learned, and which controllers can be imitated."""

import gymnasium
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra 'train'")

from tiago_mj.control.scripted import Scripted  # noqa: E402
from tiago_mj.learn import build  # noqa: E402
from tiago_mj.learn.dagger import expert_of  # noqa: E402
from tiago_mj.learn.environments import make_env  # noqa: E402
from tiago_mj.learn.loop import Task, train_seed  # noqa: E402
from tiago_mj.learn.settings import Settings  # noqa: E402
from tiago_mj.learn.zoo_form import checked, read_hyperparameters  # noqa: E402

STEPS, ENVS = 30, 4


def settings(env="TIAGoPush-v0", *, steps=480, options=None, **given):
    small = {"n_envs": ENVS, "policy_kwargs": {"net_arch": [32]}, "learning_starts": ENVS * STEPS, "batch_size": 64}
    small |= {"train_freq": [STEPS, "step"], "gradient_steps": 100, "learning_rate": 0.003}
    entry = read_hyperparameters("dagger", env) | small | given
    options = {"max_episode_steps": STEPS, **(options or {})}
    return Settings(f"tiago_mj/{env}", "dagger", steps, options, None, entry, checkpoint_every=ENVS * STEPS,
                    evaluate_every=240, evaluation_episodes=2)  # fmt: skip


def trained(chosen, steps=0):
    model = build.make_model(chosen, make_env(chosen, ENVS), 0)
    if steps:
        model.learn(steps)
    return model


@pytest.mark.parametrize("env", ["TIAGoPush-v0", "TIAGoPickAndPlaceTactile-v0"])
def test_what_is_stored_is_what_the_expert_would_do_whoever_acts(env):
    model = trained(settings(env), 360)  # the actor acts in the last third
    buffer, expert = model.replay_buffer, Scripted.for_env(gymnasium.make(f"tiago_mj/{env}", visual=False))
    for t in (0, 20, 45, 75, 89):
        for k in range(ENVS):
            seen = {name: part[t, k].astype(np.float64) for name, part in buffer.observations.items()}
            np.testing.assert_allclose(buffer.actions[t, k], expert(seen, {}), atol=1e-3, err_msg=f"{t}, {k}")


def test_the_expert_acts_until_the_actor_has_learned_something():
    chosen = settings(noise_type=None)
    model = trained(chosen)
    executed, step = [], model.env.step

    def watched(actions):
        executed.append(np.array(actions))
        return step(actions)

    model.env.step = watched
    model.learn(360)
    stored = model.replay_buffer.actions[: len(executed)]
    # Learning starts after more than ENVS · STEPS steps, so with the second rollout.
    difference = np.abs(np.array(executed) - stored).max(axis=(1, 2))
    np.testing.assert_allclose(difference[: 2 * STEPS], 0.0, atol=1e-6)
    assert (difference[2 * STEPS :] > 1e-3).all()
    assert model.acts


def test_noise_is_executed_and_not_stored():
    clean, noisy = (trained(settings(noise_type="normal", noise_std=level), 120) for level in (0.0, 0.5))
    first = [model.replay_buffer.actions[0] for model in (clean, noisy)]
    np.testing.assert_array_equal(*first)
    places = [model.replay_buffer.observations["observation"][20, :, :10] for model in (clean, noisy)]
    assert np.abs(places[0] - places[1]).max() > 0.01, "the noise moved something"


def test_flat_observations_are_imitated_too():
    shown = ("GripperTactile-v0", "td3-2021-ideal")
    entry = read_hyperparameters("dagger", shown[0]) | {"n_envs": ENVS, "learning_starts": 100, "expert": shown[1]}
    entry |= {"policy_kwargs": {"net_arch": [8]}, "normalize": False, "train_freq": [1, "episode"], "batch_size": 16}
    options = {"servo": "ideal", "object_offset": 0.0, "max_episode_steps": STEPS}
    chosen = Settings(f"tiago_mj/{shown[0]}", "dagger", 300, options, None, entry | {"gradient_steps": -1})
    model = trained(chosen, 300)
    assert model.acts
    agent = expert_of(shown[1], gymnasium.make(f"tiago_mj/{shown[0]}", servo="ideal", object_offset=0.0))
    buffer = model.replay_buffer
    np.testing.assert_allclose(buffer.actions[70], agent(buffer.observations[70]), atol=1e-4)


def test_the_actor_comes_near_the_expert():
    far, near = trained(settings()), trained(settings(steps=480), 480)
    batch = near.replay_buffer.sample(200, env=near.get_vec_normalize_env())
    with torch.no_grad():
        before, after = (float(torch.mean((m.actor(batch.observations) - batch.actions) ** 2)) for m in (far, near))
    assert after < 0.5 * before


def test_episodes_that_the_expert_plays_are_none_of_the_agents_and_a_stopped_training_goes_on(tmp_path, monkeypatch):
    chosen = settings(steps=480)
    train_seed(Task(chosen, 0, str(tmp_path / "whole")))
    logged = (tmp_path / "whole" / "episodes.csv").read_text().splitlines()[1:]
    assert len(logged) == 480 // STEPS - 2 * ENVS, "all but those of the two first rollouts"
    from tiago_mj.learn import callbacks

    saved, kept = callbacks.Checkpoints.save, []

    def save(self, *, finished):
        saved(self, finished=finished)
        kept.append(self.model.num_timesteps)
        if len(kept) in (1, 4):
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(callbacks.Checkpoints, "save", save)
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                train_seed(Task(chosen, 0, str(tmp_path / "two")))
    assert kept[0] == ENVS * STEPS, "stopped while the expert acted"
    train_seed(Task(chosen, 0, str(tmp_path / "two")))
    first, second = (np.load(tmp_path / name / "last.npz") for name in ("whole", "two"))
    for key in first.files:
        np.testing.assert_array_equal(first[key], second[key])
    assert (tmp_path / "two" / "episodes.csv").read_text() == (tmp_path / "whole" / "episodes.csv").read_text()


def test_controllers_that_cannot_be_imitated_are_refused():
    with pytest.raises(ValueError, match="expert pi cannot be imitated"):
        expert_of("pi", gymnasium.make("tiago_mj/GripperTactile-v0"))
    drawn = gymnasium.make("tiago_mj/TIAGoPush-v0", object_width=(0.04, 0.06))
    with pytest.raises(ValueError, match="looks at the object once, and here it is drawn"):
        expert_of("scripted", drawn)
    assert expert_of("her-td3-reach", gymnasium.make("tiago_mj/TIAGoReach-v0")).origin["algo"] == "her-td3"
    with pytest.raises(ValueError, match="expert random cannot be imitated"):
        expert_of("random", gymnasium.make("tiago_mj/TIAGoPush-v0"))
    with pytest.raises(ValueError, match="control='velocity'"):
        expert_of("scripted", gymnasium.make("tiago_mj/TIAGoPush-v0", control="position"))
    given = read_hyperparameters("her-td3", "TIAGoReach-v0") | {"expert": "scripted"}
    chosen = Settings("tiago_mj/TIAGoReach-v0", "her-td3", 100, {}, None, given)
    with pytest.raises(ValueError, match="expert is of dagger"):
        build.make_model(chosen, make_env(chosen, 8), 0)


@pytest.mark.parametrize(
    ("env", "given", "said"),
    [
        ("TIAGoPush-v0", {"steps": ENVS * STEPS}, "nothing would be learned"),
        ("GripperTactile-v0", {"policy": "MultiInputPolicy"}, "is for observations with goals"),
        ("GripperTactile-v0", {}, "there are experts for"),
        ("TIAGoPush-v0", {"leak": 0.1}, "leak is of td3 and her-td3"),
        ("TIAGoPush-v0", {"demonstrations": {"policy": "scripted", "episodes": 4}}, "demonstrations are of"),
    ],
)
def test_what_cannot_be_trained_is_said_in_one_line(env, given, said):
    chosen = settings(env, **given)
    with pytest.raises(ValueError, match=said):
        trained(chosen)


def test_keys_of_critics_and_of_rounds_of_demonstrations_are_unknown():
    for algo, entry in (("dagger", {"gamma": 0.9}), ("her-td3", {"demonstrations": {"policy": "pi", "rounds": 3}})):
        with pytest.raises(ValueError, match=r"gamma|rounds"):
            checked(algo, entry, "here")


@pytest.mark.parametrize(("count", "updates"), [(100, 750), (100, 1), (8, 1), (5, 40), (100, -1), (25, 100)])
def test_the_trial_of_a_training_keeps_the_ratio_of_updates(count, updates):
    from tiago_mj.learn import duration

    model = trained(settings(train_freq=[count, "step"], gradient_steps=updates))
    duration._shorten(model)
    few = model.train_freq.frequency
    assert few <= count
    if updates < 0:
        assert (model.gradient_steps, few) == (-1, duration.ROUND)
    else:
        assert model.gradient_steps / few == pytest.approx(updates / count)
