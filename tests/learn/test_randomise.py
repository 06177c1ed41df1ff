"""Training on simulators that are drawn anew for every episode."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")

sys.path.insert(0, str(Path(__file__).parents[1] / "gap"))
from made_diagnoses import STIFFNESS, diagnosis, replace

from tiago_mj import cli
from tiago_mj.effects import read_effects
from tiago_mj.gap.report import json as report_json
from tiago_mj.gap.result import Explanation, Joint, Named, OpenNumber, Value
from tiago_mj.learn.environments import make_env
from tiago_mj.learn.randomise import draw, read_ranges
from tiago_mj.learn.settings import Settings
from tiago_mj.randomisation.diagnosis import read

RANGES = {"command_delay": {"seconds": [0.0, 0.05]}, "servo_stiffness": {"factor": [0.25, 4.0]}}


def made(ranges, count=3):
    options = {"max_episode_steps": 12, "object_offset": 0.0}
    settings = Settings("tiago_mj/GripperTactile-v0", "td3", 100, options, None, {}, randomise=ranges)
    return make_env(settings, count)


def played(env, seed, steps=30):
    env.seed(seed)
    seen = [env.reset()]
    for _ in range(steps):
        observation, *_ = env.step(np.full((env.num_envs, 2), -1.0, dtype=np.float32))
        seen.append(observation)
    return np.array(seen)


def test_factors_are_drawn_by_ratio_and_times_evenly():
    rng = np.random.default_rng(0)
    drawn = [draw(RANGES, rng) for _ in range(2000)]
    times = np.array([one[0].parameters["seconds"] for one in drawn])
    factors = np.array([one[1].parameters["factor"] for one in drawn])
    assert [one.name for one in drawn[0]] == list(RANGES)
    assert times.min() >= 0
    assert times.max() <= 0.05
    # Standard errors of the means: 0.0145 / √2000 = 0.0003 s, and 0.80 / √2000 = 0.018.
    assert times.mean() == pytest.approx(0.025, abs=0.0015)
    assert np.log(factors).mean() == pytest.approx(0.0, abs=0.08)
    read_effects(drawn[0])


def test_every_episode_has_another_simulator():
    env = made({"velocity_limit": {"velocity": [0.004, 0.02]}})
    way = played(env, 3, steps=36)[:, :, 0]
    ends = way[[11, 23, 35]] - way[[0, 12, 24]]
    assert len(np.unique(np.round(ends, 7))) == 9


def test_the_same_seed_gives_the_same_episodes():
    np.testing.assert_array_equal(played(made(RANGES), 7), played(made(RANGES), 7))
    assert not np.array_equal(played(made(RANGES), 7), played(made(RANGES), 8))


def test_a_training_is_randomised_and_its_card_says_so(tmp_path):
    (tmp_path / "h.yml").write_text("default: {batch_size: 8, train_freq: 10, gradient_steps: 10, n_envs: 2}\n")
    (tmp_path / "ranges.yml").write_text("force_gain: {factor: [0.5, 2.0]}\n")
    words = [
        "train", "--env", "GripperTactile-v0", "--hyperparameters", str(tmp_path / "h.yml"), "--steps", "80",
        "--env-option", "max_episode_steps=20", "--evaluation-episodes", "2", "--checkpoint-every", "40", "--quiet",
        "--randomise", str(tmp_path / "ranges.yml"), "--out", str(tmp_path / "run"),
    ]  # fmt: skip
    assert cli.main(words) == 0
    assert '| randomised | {"force_gain": {"factor": [0.5, 2.0]}} |' in (tmp_path / "run" / "card.md").read_text()
    assert json.loads((tmp_path / "run" / "settings.json").read_text())["randomise"] == {
        "force_gain": {"factor": [0.5, 2.0]}
    }


# From a diagnosis -----------------------------------------------------------------------------------------------------


def diagnosed(folder, effect=STIFFNESS, **changes):
    """A folder with a diagnosis that names one effect, and numbers that are left open."""
    open_numbers = (
        OpenNumber("object_mass", "all", "factor", 1.0, 0.95, 1.05, "-", 1.0),
        OpenNumber("command_delay", "all", "seconds", 0.0, -0.0003, 0.0003, "s", 0.2),  # on either side of nominal
    )
    (value,) = effect.parameters.values()
    joint = Joint((False,), (((value.high - value.low) ** 2 / 12,),), (value.low,), (value.high,))
    best = Explanation((effect,), 0.9, 9.0, joint=joint)
    made = replace(diagnosis(best=(effect,)), best=best, alternatives=(best,), open_numbers=open_numbers, **changes)
    folder.mkdir(exist_ok=True)
    report_json.write(made, folder / "diagnosis.json")
    return folder


def words(folder, source, *more):
    (folder / "h.yml").write_text("default: {batch_size: 8, train_freq: 10, gradient_steps: 10, n_envs: 2}\n")
    return [
        "train", "--env", "GripperTactile-v0", "--hyperparameters", str(folder / "h.yml"), "--steps", "80",
        "--env-option", "max_episode_steps=20", "--evaluation-episodes", "2", "--checkpoint-every", "40",
        "--randomise", str(source), "--out", str(folder / "run"), *more,
    ]  # fmt: skip


def test_a_training_from_a_diagnosis_draws_its_posterior_and_its_card_says_from_where(tmp_path, capsys):
    source = diagnosed(tmp_path / "diag")
    assert cli.main(words(tmp_path, source)) == 0
    said = capsys.readouterr().err
    assert "100 % of the episodes: servo_stiffness" in said
    assert "probability 0.1 is on nothing that was reported" in said
    assert "the prior's, as no recording speaks of them: object_mass factor 0.95 to 1.05" in said
    card = (tmp_path / "run" / "card.md").read_text()
    assert "| randomised | drawn from the posterior of diag/diagnosis.json:;" in card
    settings = json.loads((tmp_path / "run" / "settings.json").read_text())
    assert list(settings["randomise"]) == ["posterior"]
    posterior = settings["randomise"]["posterior"]
    assert (posterior["source"], len(posterior["sha256"])) == ("diag/diagnosis.json", 64)
    # The same command goes on, and from the file itself as from its folder.
    assert cli.main(words(tmp_path, source / "diagnosis.json")) == 0
    diagnosed(tmp_path / "diag", seed=5)
    assert cli.main(words(tmp_path, source)) == 2
    assert "other settings: randomise.posterior.sha256" in capsys.readouterr().err


def test_every_episode_has_what_was_drawn_from_the_diagnosis(tmp_path):
    wide = Named("velocity_limit", "all", {"velocity": Value(0.012, 0.006, 0.018, "m/s")})
    given = {"posterior": read(diagnosed(tmp_path / "diag", wide)).as_data()}
    way = played(made(given), 3, steps=36)[:, :, 0]
    ends = way[[11, 23, 35]] - way[[0, 12, 24]]
    assert len(np.unique(np.round(ends, 7))) == 9


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (Named("servo_stiffness", ("elbow",), {"factor": Value(2.0, 1.5, 2.5, "-")}), "has target 'elbow'"),
        (
            Named("coulomb_friction", "all", {"force": Value(-1.0, -1.5, -0.5, "N")}),
            "but the model has 0 N of dry friction",
        ),
    ],
)
def test_a_diagnosis_of_another_robot_is_refused_in_one_line_before_anything_is_written(effect, said, tmp_path, capsys):
    assert cli.main(words(tmp_path, diagnosed(tmp_path / "diag", effect), "--quiet")) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_folder_without_a_diagnosis_is_one_line(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert cli.main(words(tmp_path, tmp_path / "empty", "--quiet")) == 2
    error = capsys.readouterr().err
    assert "--randomise" in error
    assert "holds no diagnosis.json: give the folder that tiago-mj diagnose --out wrote" in error
    assert error.count("\n") == 1


def test_ranges_that_take_away_more_than_the_robot_has_are_one_line():
    with pytest.raises(ValueError, match=r"^--randomise: effect 'coulomb_friction'.* dry friction") as fault:
        made({"coulomb_friction": {"force": [-3.0, 0.0]}})
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give effects with ranges"),
        ({"no_such": {"factor": [1, 2]}}, "effect 'no_such' is unknown"),
        ({"force_gain": {"facto": [1, 2]}}, "has no parameter 'facto'"),
        ({"force_gain": {"factor": [2, 1]}}, "force_gain.factor is [2, 1]"),
        ({"command_delay": {"seconds": [-1, 0]}}, "at least 0"),
        ({"command_delay": 0.1}, "needs a range of a parameter"),
    ],
)
def test_unusable_ranges_are_one_line(given, said):
    with pytest.raises(ValueError, match=r"^ranges: .*") as fault:
        read_ranges(given, "ranges")
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)
