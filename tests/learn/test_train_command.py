"""``tiago-mj train``: what it writes, and that a killed training goes on as if nothing had happened."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from small_training import hyperparameters

pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")

from tiago_mj import cli
from tiago_mj.io import extra
from tiago_mj.learn import curves
from tiago_mj.learn.agent_file import load_agent

SMALL = hyperparameters("GripperTactile-v0", n_timesteps=800, env_kwargs="{object_offset: 0.0}")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("yaml") / "small.yml"
    path.write_text(SMALL)
    return path


def words(out, small, *more, episode=40):
    return [
        "train", "--env", "GripperTactile-v0", "--hyperparameters", str(small), "--out", str(out), "--quiet",
        "--env-option", f"max_episode_steps={episode}", "--evaluate-every", "400", "--evaluation-episodes", "3",
        "--checkpoint-every", "400", *more,
    ]  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory, small):
    """Two seeds, trained without interruption, in processes of their own."""
    out = tmp_path_factory.mktemp("trained") / "run"
    assert cli.main(words(out, small, "--seeds", "2", "--jobs", "2")) == 0
    return out


def numbers(out, seed):
    return load_agent(out / f"seed-{seed}" / "last.npz").arrays()


def test_the_folder_holds_agents_curves_and_a_card(trained):
    seed = trained / "seed-1"
    kept = {"best.npz", "evaluated.npz", "last.npz", "model.zip", "checkpoint.zip", "episodes.csv", "evaluations.csv"}
    assert kept <= {path.name for path in seed.iterdir()}
    steps, means = curves.read_episodes(seed)
    np.testing.assert_array_equal(steps, np.arange(40, 801, 40))
    evaluated = (seed / "evaluations.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in evaluated] == ["steps", "400", "800"]
    card = json.loads((trained / "card.json").read_text())
    assert card["settings"]["hyperparameters"]["policy_kwargs"] == {"net_arch": [16, 8]}
    assert [result["seed"] for result in card["seeds"]] == [0, 1]
    assert card["seeds"][1]["best_mean"] == pytest.approx(means[19:].max(), abs=1e-3)
    assert {"tiago_mj", "mujoco", "stable-baselines3", "torch"} <= set(card["made_by"])
    page = (trained / "card.md").read_text()
    assert "| object_offset | 0.0 |" in page
    assert "| steps | 800 |" in page
    assert "--seeds 2 --steps 800 --hyperparameters FILE --env-option 'max_episode_steps=40' " in page
    assert "--evaluate-every 400 --evaluation-episodes 3 --checkpoint-every 400 --out DIR" in page
    assert card["seeds"][0]["processor_seconds"] > 0
    curve = json.loads((trained / "curves.json").read_text())
    for part in (curve["training"], curve["evaluation"]):
        assert len(part["steps"]) == len(part["median"]) == curves.POINTS
        assert all(low <= mid <= high for low, mid, high in zip(part["lowest"], part["median"], part["highest"]))  # noqa: B905
    assert (trained / "curves.png").read_bytes()[1:4] == b"PNG"


def test_the_best_evaluated_agent_is_that_of_the_best_evaluation(trained):
    for seed in (trained / "seed-0", trained / "seed-1"):
        evaluations = [line.split(",") for line in (seed / "evaluations.csv").read_text().splitlines()[1:]]
        best = max(evaluations, key=lambda line: float(line[1]))
        assert load_agent(seed / "evaluated.npz").origin["steps"] == int(best[0])


def test_seeds_differ_and_the_same_seed_does_not(trained, small, tmp_path):
    first, second = numbers(trained, 0), numbers(trained, 1)
    assert not np.allclose(first["weight_0"], second["weight_0"])
    assert cli.main(words(tmp_path / "again", small)) == 0
    again = numbers(tmp_path / "again", 0)
    for name, value in first.items():
        np.testing.assert_array_equal(again[name], value)


@pytest.mark.slow
def test_a_killed_training_goes_on_to_the_same_agent(trained, small, tmp_path):
    out = tmp_path / "killed"
    run = [sys.executable, "-m", "tiago_mj.cli", *words(out, small)]
    process = subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    checkpoint = out / "seed-0" / "checkpoint.zip"
    until = time.monotonic() + 60
    while not checkpoint.exists():
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "it must not have been over"
    assert not (out / "seed-0" / "last.npz").exists()
    assert cli.main(words(out, small)) == 0
    whole = trained / "seed-0"
    assert (out / "seed-0" / "episodes.csv").read_text() == (whole / "episodes.csv").read_text()
    assert (out / "seed-0" / "evaluations.csv").read_text() == (whole / "evaluations.csv").read_text()
    for which in ("best.npz", "evaluated.npz", "last.npz"):
        ours, theirs = (load_agent(folder / which).arrays() for folder in (out / "seed-0", whole))
        for name, value in theirs.items():
            np.testing.assert_array_equal(ours[name], value, err_msg=f"{which}: {name}")


def test_a_finished_training_is_not_trained_again(trained, small, capsys):
    before = (trained / "seed-0" / "checkpoint.zip").stat().st_mtime_ns
    assert cli.main(words(trained, small, "--seeds", "2", "--json")) == 0
    data = json.loads(capsys.readouterr().out)
    assert (trained / "seed-0" / "checkpoint.zip").stat().st_mtime_ns == before
    assert data["seeds"][0]["steps_per_second"] is None
    assert data["seeds"][0]["best_mean"] is not None


def test_what_to_do_next_is_a_command_that_plays_the_agent_as_it_was_trained(trained, small, capsys):
    assert cli.main(words(trained, small, "--seeds", "2", "--jobs", "2")) == 0
    following = capsys.readouterr().out.splitlines()[-1]
    assert "--env-option object_offset=0.0 --env-option max_episode_steps=40" in following
    assert cli.main([*shlex.split(following.removeprefix("next: tiago-mj ")), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [episode["steps"] for episode in data["episodes"]] == [40] * 10


@pytest.mark.parametrize(
    "algo",  # DDPG is TD3 with one critic, and A2C one of PPO's updates: the others run what they run
    [
        "sac",
        pytest.param("ddpg", marks=pytest.mark.slow),
        "ppo",
        pytest.param("a2c", marks=pytest.mark.slow),
        "her-td3",
    ],
)
def test_every_algorithm_trains_stops_and_goes_on(algo, tmp_path, monkeypatch):
    env = "TIAGoReach-v0" if algo == "her-td3" else "GripperTactile-v0"
    if algo in ("ppo", "a2c"):
        entry = "n_envs: 2, n_steps: 20, normalize: true"
    else:
        entry = "n_envs: 2, batch_size: 16, train_freq: 20, gradient_steps: 10, learning_starts: 50"
        entry += ", noise_type: ornstein-uhlenbeck, noise_std: lin_0.3"
    path = tmp_path / "h.yml"
    path.write_text(f"default: {{{entry}, policy_kwargs: {{net_arch: [8]}}}}\n")
    common = [
        "train", "--env", env, "--algo", algo, "--hyperparameters", str(path), "--quiet", "--steps", "320",
        "--env-option", "max_episode_steps=20", "--evaluation-episodes", "2", "--checkpoint-every", "80",
    ]  # fmt: skip
    assert cli.main([*common, "--out", str(tmp_path / "whole")]) == 0

    from tiago_mj.learn.callbacks import Checkpoints

    save, saved = Checkpoints.save, []

    def save_and_stop(self, *, finished):
        save(self, finished=finished)
        saved.append(self.model.num_timesteps)
        if len(saved) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoints, "save", save_and_stop)
    assert cli.main([*common, "--out", str(tmp_path / "stopped")]) == 130
    monkeypatch.undo()
    assert saved == [80, 160]
    assert cli.main([*common, "--out", str(tmp_path / "stopped")]) == 0
    whole, gone_on = numbers(tmp_path / "whole", 0), numbers(tmp_path / "stopped", 0)
    assert ("mean" in whole) == (algo in ("ppo", "a2c")), "normalised observations belong to the agent"
    for name, value in whole.items():
        np.testing.assert_array_equal(gone_on[name], value, err_msg=name)


def test_a_training_that_is_stopped_while_it_writes_its_results_writes_them_again(small, tmp_path, monkeypatch):
    from tiago_mj.learn import loop

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "_save_model", stop)
    assert cli.main(words(tmp_path / "run", small, "--steps", "480")) == 130
    monkeypatch.undo()
    assert not (tmp_path / "run" / "seed-0" / "model.zip").exists()
    assert cli.main(words(tmp_path / "run", small, "--steps", "480")) == 0
    assert (tmp_path / "run" / "seed-0" / "model.zip").stat().st_size > 1000


def test_effects_act_on_what_is_trained(small, tmp_path):
    calibration = tmp_path / "calibration.yaml"
    calibration.write_text(
        "schema: tiago_mj.calibration/1\neffects:\n- name: force_gain\n  parameters: {factor: 0.5}\n"
    )
    out = tmp_path / "weak"
    assert cli.main(words(out, small, "--effects", str(calibration), "--steps", "80")) == 0
    kept = json.loads((out / "settings.json").read_text())["effects"]
    assert kept["effects"][0]["parameters"] == {"factor": 0.5}
    assert load_agent(out / "seed-0" / "best.npz").origin["effects"] == kept


def complaint(capsys, given):
    status = cli.main(given)
    said = capsys.readouterr()
    assert status == 2
    assert said.err.count("\n") == 1, said.err
    return said.err


def test_another_setting_in_the_same_folder_is_refused(trained, small, capsys):
    said = complaint(capsys, words(trained, small, "--steps", "500"))
    assert "steps is 800 there and 500 here" in said
    said = complaint(capsys, words(trained, small, "--gradient-steps", "0.5"))
    assert "updates_per_step is null there and 0.5 here" in said


def test_a_folder_with_other_files_is_left_alone(small, tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    assert "holds no training" in complaint(capsys, words(tmp_path, small))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_truncated_checkpoint_is_told_of_in_one_line(small, tmp_path, capsys):
    out = tmp_path / "run"
    assert cli.main(words(out, small, "--steps", "80")) == 0
    path = out / "seed-0" / "checkpoint.zip"
    whole = path.read_bytes()
    for content in (whole[: len(whole) // 2], whole[:300] + b"\0" * 40 + whole[340:], b""):
        path.write_bytes(content)
        capsys.readouterr()
        said = complaint(capsys, words(out, small, "--steps", "80"))
        assert "checkpoint.zip cannot be read" in said
        assert "delete that file" in said


def entry(text):
    return f"GripperTactile-v0: {{{text}}}\n"


@pytest.mark.parametrize(
    ("more", "yaml", "said"),
    [
        (("--algo", "dqn"), None, "algorithm 'dqn' is unknown: use one of td3, ddpg, sac, ppo, a2c, her-td3, dagger"),
        (("--algo", "her-td3"), None, "her-td3 relabels goals"),
        (("--env-option", "servo"), None, "is no key=value"),
        (("--env-option", "servos=ideal"), None, "did you mean 'servo'"),
        (("--env-option", "servo=perfect"), None, "perfect"),
        (("--effects", "nowhere.yaml"), None, "nowhere.yaml"),
        (("--gradient-steps", "0"), None, "--gradient-steps is 0"),
        (("--gradient-steps", "1", "--algo", "ppo"), None, "replay buffer"),
        (("--seeds", "0"), None, "--seeds is 0"),
        (("--hyperparameters", "nowhere.yml"), None, "nowhere.yml"),
        ((), "][", "no YAML"),
        ((), "- 3", "must map environment ids"),
        ((), "Other-v0: {}", "no entry for 'GripperTactile-v0'"),
        ((), entry("batchsize: 3"), "'batchsize' is unknown to td3"),
        ((), entry("batch_size: many"), "batch_size is 'many'"),
        ((), entry("n_timesteps: -3"), "n_timesteps is -3"),
        ((), entry("train_freq: [1, day]"), "train_freq is [1, 'day']"),
        ((), entry("noise_type: pink"), "noise_type is 'pink'"),
        ((), entry("noise_std: -1"), "noise_std is -1"),
        ((), entry("noise_std: lin_-1"), "noise_std is 'lin_-1'"),
        ((), entry("policy_kwargs: \"__import__('os').system('true')\""), "policy_kwargs is"),
        ((), entry("policy_kwargs: {net: [3]}"), "policy_kwargs has 'net'"),
        ((), entry("normalize: {speed: 3}"), "normalize has 'speed'"),
        ((), entry("env_wrapper: os.system"), "not supported here"),
    ],
    ids=str,
)
def test_bad_input_gets_one_line(more, yaml, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if yaml is not None:
        Path("h.yml").write_text(yaml)
        more = (*more, "--hyperparameters", "h.yml")
    assert said in complaint(capsys, ["train", "--env", "GripperTactile-v0", "--out", "run", "--quiet", *more])
    assert not Path("run").exists(), "nothing is written for what cannot be trained"


@pytest.mark.slow  # three processes load PyTorch; the two tests below and the one of a killed training are its parts
def test_seeds_stop_when_whoever_started_them_is_killed_and_go_on_with_the_same_command(small, tmp_path):
    out = tmp_path / "run"
    long = words(out, small, "--seeds", "2", "--jobs", "2", "--steps", "400000", "--checkpoint-every", "2000")
    process = subprocess.Popen(
        [sys.executable, "-m", "tiago_mj.cli", *long], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 60
    reports = [out / f"seed-{seed}" / "progress.json" for seed in (0, 1)]
    while not all(path.exists() for path in reports):
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.1)
    trainers = [json.loads(path.read_text())["process"] for path in reports]
    assert process.pid not in trainers
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    while any(_is_there(pid) for pid in trainers):
        assert time.monotonic() < until, "a seed goes on without anybody to tell"
        time.sleep(0.1)


def test_a_seed_ends_its_process_when_whoever_started_it_is_gone(tmp_path, monkeypatch):
    from tiago_mj.learn import callbacks

    def end(status):
        raise SystemExit(status)

    monkeypatch.setattr(callbacks.os, "_exit", end)
    told = callbacks.Progress(tmp_path, 100, None, lambda: False)
    with pytest.raises(SystemExit) as caught:
        told._on_step()
    assert caught.value.code == 1
    assert not list(tmp_path.iterdir()), "nobody is there to be told"


def test_whoever_started_a_seed_is_gone_once_it_has_another_parent(monkeypatch):
    from tiago_mj.learn import loop

    there = loop._parent_is_there()
    assert there()
    monkeypatch.setattr(loop.os, "getppid", lambda: 1)
    assert not there()


def _is_there(pid):
    """Whether a process runs; one that is over but not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_two_trainings_in_one_folder_are_refused(small, tmp_path, capsys, monkeypatch):
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr("tiago_mj.io.held.PATIENCE", 0.0)
    out = tmp_path / "run"
    assert cli.main(words(out, small, "--steps", "80")) == 0
    with (out / "seed-0" / "lock").open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        capsys.readouterr()
        assert "another process is training" in complaint(capsys, words(out, small, "--steps", "80"))


def test_progress_tells_every_seed_and_counts_what_an_earlier_run_did_as_done(tmp_path, capsys):
    from tiago_mj.learn import progress

    folders = [tmp_path / "seed-0", tmp_path / "seed-1"]
    progress.report(folders[0], {"steps": 250, "mean_return": -198.01, "success_rate": 0.5})
    with progress.shown(folders, 1000, quiet=False, every=0.05):
        time.sleep(0.2)
    line = capsys.readouterr().err.splitlines()[0]
    assert line.startswith("train: steps 250 of 2000, 12 %, ")
    assert line.endswith(" so far, seed-0 25 % return -198.0, success 0.50, seed-1 0 %")


def test_events_for_tensorboard_are_written_where_it_is_installed(small, tmp_path):
    pytest.importorskip("tensorboard")
    assert cli.main(words(tmp_path / "run", small, "--steps", "480", "--tensorboard")) == 0
    (events,) = (tmp_path / "run" / "seed-0" / "tensorboard").iterdir()
    assert b"train/critic_loss" in events.read_bytes()


def test_without_tensorboard_it_says_what_to_install(small, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    said = complaint(capsys, words(tmp_path / "run", small, "--tensorboard"))
    assert extra.install("tensorboard") in said
    assert not (tmp_path / "run").exists()


def test_the_number_of_steps_may_be_given_in_the_file_or_beside_it(tmp_path):
    from dataclasses import replace

    from tiago_mj.learn.settings import Settings, claim

    beside = Settings("tiago_mj/GripperTactile-v0", "td3", 500, {}, None, {"n_timesteps": 9, "gamma": 0.9})
    in_the_file = replace(beside, hyperparameters={"n_timesteps": 500, "gamma": 0.9})
    assert not claim(tmp_path / "run", beside)
    assert claim(tmp_path / "run", in_the_file)
    with pytest.raises(ValueError, match="steps is 500 there and 501 here"):
        claim(tmp_path / "run", replace(in_the_file, steps=501))


def test_a_training_that_takes_long_says_so_beforehand(small, tmp_path, capsys, monkeypatch):
    from tiago_mj.learn import duration

    monkeypatch.setattr(duration, "SHORT", 80)
    monkeypatch.setattr(duration, "MEASURED", 0.1)
    told = [word for word in words(tmp_path / "run", small, "--steps", "80") if word != "--quiet"]
    assert cli.main(told) == 0
    line = capsys.readouterr().err.splitlines()[0]
    rate = float(re.fullmatch(r"train: 80 steps: about \d+ s \((\d+) steps/s a seed, .*\)", line)[1])
    assert 5 < rate < 50_000


def test_the_speed_here_is_not_told_as_that_of_a_cluster(small, tmp_path, capsys, monkeypatch):
    from tiago_mj.learn import duration

    pytest.importorskip("ray", reason="needs the extra 'scale'")
    monkeypatch.setattr(duration, "SHORT", 80)
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    told = [word for word in words(tmp_path / "run", small, "--steps", "80", "--backend", "ray") if word != "--quiet"]
    assert cli.main(told) == 2
    said = capsys.readouterr().err
    assert "no Ray cluster answers" in said
    assert "steps/s" not in said


def test_the_estimate_counts_processes_and_what_is_done_already(monkeypatch):
    from tiago_mj.learn import duration

    monkeypatch.setattr(duration.os, "cpu_count", lambda: 4)
    said = duration.said(100.0, steps=400_000, seeds=5, jobs=5, left=1_440_000)
    assert said.startswith("train: 5 seeds of 400000 steps, 4 at a time: about 60 min (100 steps/s a seed")
