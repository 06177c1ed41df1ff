"""Lost commands are told from where the servos went, one by one, and none are where none was lost."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_hinge import recorded

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import FAST_RATE, Case, EffectChoice
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.search import lost_commands, rounds
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.read import read_recordings

HINGE = Case(seed=5252, setting="plain", interface="position", spread=0.04, rate=FAST_RATE, seconds=1.6, trials=4)
#: Of what moves the joint by less than its noise nobody can say whether it was lost.
SHARE = 0.25


@pytest.fixture(scope="module")
def hinge(tmp_path_factory: pytest.TempPathFactory) -> tuple[Predictor, ServoMotion, Path]:
    """Recordings of a hinge without effects, by the independent reality with the nominal model's own numbers."""
    folder = tmp_path_factory.mktemp("hinge")
    predict, nominal = recorded(folder)
    seen = set_points.servo_motion(predict.plant, predict.on, predict.data, nominal)
    assert seen is not None
    return predict, seen, folder


def with_losses(predict: Predictor, share: float) -> tuple[Predictor, np.ndarray]:
    """Recordings of the simulator itself with lost commands and noise, and which were lost (0)."""
    rng = np.random.default_rng(0)
    delivered = (rng.random(predict.on.commands.shape) > share).astype(float)
    trials = range(len(predict.on.trials))
    losing = Entry(lost_commands.EFFECT, None, {"probability": 0.5})
    value = predict.with_delivered(delivered).all_trials([(losing,)], trials)[0]
    value = value + predict.data.noise * rng.standard_normal(value.shape)
    return replace(predict, data=replace(predict.data, value=value)), delivered


def test_commands_that_were_lost_are_told_and_so_is_their_share(hinge: tuple[Predictor, ServoMotion, Path]) -> None:
    predict, seen, _ = hinge
    losing, delivered = with_losses(predict, SHARE)
    trials = range(len(predict.on.trials))
    found = lost_commands.decode(losing, seen, [()] * len(trials), trials)
    step = np.abs(np.diff(predict.on.commands, axis=1, prepend=seen.start[:, None]))
    told = step > np.quantile(step, 0.7)  # those that change most
    assert np.mean(found.delivered[told] == delivered[told]) > 0.9
    pool = hypotheses.candidates(predict.plant, (lost_commands.EFFECT,))
    (candidate,) = lost_commands.losing_candidates(pool, found, predict.plant.wiring.targets.command, trials) or [None]
    assert candidate is not None
    assert candidate.spread is not None
    # Three deviations of it, and what the few hundred draws themselves are off.
    drawn = np.sqrt(SHARE * (1 - SHARE) / delivered.size)
    assert candidate.grid[0] == pytest.approx(SHARE, abs=3 * np.hypot(candidate.spread, drawn))


def test_where_no_command_was_lost_none_is_told(hinge: tuple[Predictor, ServoMotion, Path]) -> None:
    predict, seen, _ = hinge
    trials = range(len(predict.on.trials))
    pool = hypotheses.candidates(predict.plant, (lost_commands.EFFECT,))
    for measured in (predict, with_losses(predict, 0.0)[0]):
        found = lost_commands.decode(measured, seen, [()] * len(trials), trials)
        assert lost_commands.losing_candidates(pool, found, predict.plant.wiring.targets.command, trials) is None


def test_a_trial_counts_only_where_it_is_fitted(hinge: tuple[Predictor, ServoMotion, Path]) -> None:
    predict, seen, _ = hinge
    losing, _ = with_losses(predict, SHARE)
    without = replace(losing, data=noise_model.select_trials(losing.data, range(4)))
    without.data.value[1:] = np.nan
    found = lost_commands.decode(without, seen, [()] * 4, (0,))
    assert (found.delivered[1:] == 1).all()
    assert found.cost[:, 1:].max() == pytest.approx(0.0)


def test_some_trials_alone_are_decoded_as_beside_the_others(hinge: tuple[Predictor, ServoMotion, Path]) -> None:
    predict, seen, _ = hinge
    losing, _ = with_losses(predict, SHARE)
    whole = lost_commands.decode(losing, seen, [()] * 4, (1, 3))
    part = lost_commands.decode(losing, seen, [()] * 4, (1, 3), of=(1, 3))
    np.testing.assert_array_equal(part.delivered[[1, 3]], whole.delivered[[1, 3]])
    assert part.cost_with_losses((1, 3)) == pytest.approx(whole.cost_with_losses((1, 3)))
    assert part.cost_without_losses((1, 3)) == pytest.approx(whole.cost_without_losses((1, 3)))
    assert (part.delivered[[0, 2]] == 1).all()


def test_losses_that_the_liveliest_trials_show_are_decoded_in_all(
    hinge: tuple[Predictor, ServoMotion, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many rows: one trial is looked at first; where it shows no losses, the others are not decoded."""
    predict, seen, _ = hinge
    monkeypatch.setattr(set_points, "liveliest", lambda moved, rows: [int(np.argmax(moved))])
    for share, decoded in ((SHARE, True), (0.0, False)):
        losing, _ = with_losses(predict, share)
        flat = np.zeros((0, *losing.data.value.shape))
        trials = Subset.of(range(4))
        fitter = Fitter(losing, trials, losing.data, np.ones(len(losing.data.channels)), (), flat)
        pool = hypotheses.candidates(losing.plant, (lost_commands.EFFECT,))
        found = lost_commands.decoded_beside(fitter, Point((), np.zeros(0), np.zeros(0)), seen, pool)
        assert (found is not None) is decoded
        if found is not None:
            assert (found.found.delivered == 0).any(axis=(1, 2)).all()


def test_a_servo_whose_joint_is_not_measured_tells_nothing(hinge: tuple[Predictor, ServoMotion, Path]) -> None:
    predict, seen, _ = hinge
    blind = replace(predict.data, channels=tuple(f"position.{name}" for name in ("other", "else")))
    found = lost_commands.decode(replace(predict, data=blind), seen, [()] * 4, range(4))
    assert (found.delivered == 1).all()
    assert found.cost_with_losses(range(4)) == 0


def test_losses_of_two_servos_that_become_one_effect_cost_what_both_cost() -> None:
    names = ("right", "left")

    def losing(target: str, paid: tuple[float, ...]) -> hypotheses.Candidate:
        return hypotheses.Candidate(
            lost_commands.EFFECT, (target,), "probability", (), 0.0, 0.0, 0.6, (0.2,), "-", selection_penalty=paid
        )

    parts = (losing("right", (30.0, 1.0)), losing("left", (20.0, 3.0)))
    both = Fitted(parts, np.array([0.2, 0.3]), np.zeros(2), np.zeros(0), 0.0, 1.0)
    targets = SimpleNamespace(names=lambda kind: names)
    fitter = SimpleNamespace(predict=SimpleNamespace(plant=SimpleNamespace(wiring=SimpleNamespace(targets=targets))))
    ((together,),) = (start.parts for start in rounds.on_all_targets(both, fitter))  # type: ignore[arg-type]
    assert (together.target, together.selection_penalty) == (None, (50.0, 4.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "seconds", "effects"),
    [
        (FAST_RATE, 1.6, {"dropped_commands": {"probability": 0.15}}),
        (25.0, 3.0, {"dropped_commands": {"probability": 0.1}, "servo_stiffness": {"factor": 0.45}}),
    ],
    ids=["at 240 Hz, each hardly visible", "beside a softer servo"],
)
def test_lost_commands_are_named_in_another_reality(
    tmp_path: Path, rate: float, seconds: float, effects: dict[str, dict[str, float]]
) -> None:
    choices = tuple(EffectChoice(name, "all", parameters) for name, parameters in effects.items())
    case = replace(HINGE, seed=5254, rate=rate, seconds=seconds, effects=choices, trials=4)
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, tmp_path), tmp_path)
    trials, model = read_recordings([tmp_path]).trials, tmp_path / robots.PLAIN_FILE
    names = ("dropped_commands", "command_delay", "servo_stiffness")
    found = diagnose(trials, model=model, names=names, threads=2)
    assert found.kind == "effect"
    assert {effect.name for effect in found.best.effects} == set(effects)
    (dropped,) = (effect for effect in found.best.effects if effect.name == "dropped_commands")
    # Where one of them is hardly visible others pass for it, and where there are thirty chance makes a third of them.
    true = effects["dropped_commands"]["probability"]
    assert dropped.parameters["probability"].value == pytest.approx(true, rel=0.45)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters"),
    [("coulomb_friction", {"force": 0.1}), ("command_quantization", {"step": 0.01})],
)
def test_what_the_library_does_not_have_does_not_pass_for_lost_commands(
    tmp_path: Path, name: str, parameters: dict[str, float]
) -> None:
    """A joint that sticks for an instant looks like one whose command was lost."""
    case = replace(HINGE, seed=77, seconds=1.2, effects=(EffectChoice(name, "all", parameters),), trials=3)
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, tmp_path), tmp_path)
    trials, model = read_recordings([tmp_path]).trials, tmp_path / robots.PLAIN_FILE
    names = ("dropped_commands", "command_delay", "servo_stiffness", "backlash")
    found = diagnose(trials, model=model, names=names, threads=2)
    named = () if found.kind in ("no_gap", "unknown") else found.best.effects
    assert "dropped_commands" not in {effect.name for effect in named}
