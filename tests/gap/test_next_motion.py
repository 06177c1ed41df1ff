"""The motion that is proposed tells apart what the recordings could not, and it is safe to play."""

import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.cli import main
from tiago_mj.gap.decision.verdict import classes_of
from tiago_mj.gap.design import rehearse
from tiago_mj.gap.design.next_motion import next_motion
from tiago_mj.gap.design.rehearse import PRESS
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.report import json as written
from tiago_mj.gap.search import ranking
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.replay import Run
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.models import names
from tiago_mj.recordings import motions
from tiago_mj.recordings.motions.menu import OPEN, items
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.record import Plan, read_motion, record
from tiago_mj.recordings.recording import channel, channels

#: What plain squeezes hardly tell apart: each holds back some of the force, or of the motion that makes it.
ALIKE = {
    "coulomb_friction": {"force": 0.3},
    "force_dead_zone": {"width": 0.02},
    "backlash": {"width": 0.0003},
}


def squeezes(motion="squeeze_medium_25hz", effects=None, episodes=1, **arguments):
    played = read_motion(Path(motion))
    plan = Plan("tiago_mj/GripperTactile-v0", arguments, effects, played, played.name)
    return list(record(plan, lambda env: None, episodes=episodes, seed=0))


def explanation(plant, name, value):
    """As if it had been fitted to a twentieth of its magnitude."""
    part = next(c for c in hypotheses.candidates(plant, [name]) if c.target is None)
    return Fitted((part,), np.array([value]), np.array([0.05 * value]), np.zeros(0), 0.0, 1.0)


def proposed(trials, rivals=ALIKE, threads=2, **options):
    plant = plant_of(trials)
    data = noise_model.collect(plant, trials)
    fits = [explanation(plant, name, *parameters.values()) for name, parameters in rivals.items()]
    share = [1 / len(fits)] * len(fits)
    weight = np.full(len(data.channels), 1 / np.sqrt(ranking.SAMPLES_PER_INDEPENDENT))
    return next_motion(plant, trials[0], data, weight, list(zip(fits, share, strict=True)), Run(threads, **options))


def distance(one, other):
    """Between two recordings, in units of what the diagnosis trusts the sensors to."""
    data = noise_model.collect(plant_of([one]), [one])
    noise = dict(zip(data.channels, data.noise, strict=True))
    return sum(
        float((((channel(one, name) - channel(other, name)) / noise[name]) ** 2).sum())
        for name in channels(one)
        if name in noise
    )


FEW = ("squeeze_fast", "free_reversals_slow", "small_reversals")


def among(*few):
    """A menu of these motions alone, by velocity and by position."""
    listed = [item for item in items() if item.name.removeprefix("position_") in few]
    return lambda: listed


@pytest.fixture(scope="module")
def told():
    """What is proposed after a plain squeeze, out of a few of the menu."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rehearse, "items", among(*FEW, "staircase_grip", "multisine_grip"))
        return proposed(squeezes())


@pytest.fixture
def short_menu(monkeypatch):
    """A menu of a few motions, where it does not matter how many there are."""
    monkeypatch.setattr(rehearse, "items", among(*FEW))


@pytest.mark.slow
def test_a_dead_zone_and_hysteresis_that_closing_leaves_open_are_told_apart_by_the_proposed_motion(tmp_path):
    """The whole way: grasps that only load the cells, for which both are one; then the proposed motion."""
    squeeze, rows = read_motion(Path("squeeze_slow_25hz")), 61  # until the fingers stop
    closing = {"interface": "velocity", "rate_hz": 25, "time": squeeze.time[:rows].tolist()}
    closing |= {f"command.{name}": values[:rows].tolist() for name, values in squeeze.commands.items()}
    (tmp_path / "closing.yaml").write_text(json.dumps(closing))
    out, truth = tmp_path / "recordings", json.dumps({"force_dead_zone": {"width": 0.1}})
    call = ["record", "--env", "GripperTactile-v0", "--episodes", "2", "--effects", truth, "--out", str(out)]
    pair = ("force_dead_zone", "force_hysteresis")
    assert main([*call, "--motion", str(tmp_path / "closing.yaml")]) == 0
    before = diagnose(read_recordings([out]).trials, names=pair, threads=2)
    assert before.kind == "ambiguous"
    told = json.loads(written.text(before))["next_motion"]
    assert sorted(told["resolves"][0]) == sorted(pair)
    assert 0.5 < told["expected_probability"] <= 1
    assert main([*call, "--motion", told["file"]]) == 0  # as it stands in diagnosis.json
    after = diagnose(read_recordings([out]).trials, names=pair, threads=2)
    assert after.kind == "effect"
    (named,) = after.best.effects
    assert named.name == "force_dead_zone"
    assert named.parameters["width"].value == pytest.approx(0.1, abs=0.01)


def test_what_is_proposed_keeps_explanations_farther_apart_than_another_squeeze(told):
    assert motions.find(told.file) is not None
    assert told.expected_probability > 0.5
    assert told.resolves
    old, new = (
        {name: squeezes(motion, {name: given})[0] for name, given in ALIKE.items()}
        for motion in ("squeeze_medium_25hz", told.file)
    )
    nearest = [min(distance(one[a], one[b]) for a, b in combinations(ALIKE, 2)) for one in (old, new)]
    assert nearest[1] > 2 * nearest[0]  # repeating the squeeze once would double it


def test_the_proposal_fits_the_robots_interface_and_rate(told, short_menu):
    by_position = proposed(squeezes("position_squeeze_medium_25hz"))
    for motion, control in ((told, "velocity"), (by_position, "position")):
        played = read_motion(Path(motion.file))
        assert (played.interface, played.rate_hz) == (control, 25)
        (trial,) = squeezes(motion.file)
        assert (trial.sidecar.interface, round(trial.sidecar.rate_hz)) == (control, 25)


def test_what_is_proposed_does_not_press_too_hard_on_the_object_at_hand(told, short_menu):
    """Into an object of 60 mm the grasps of the menu would press with all the servos have."""
    wide = proposed(squeezes("free_reversals_slow_25hz", object_width=0.06))
    for motion, width in ((told, 0.04), (wide, 0.06)):
        (trial,) = squeezes(motion.file, object_width=width)
        for joint, effort in trial.efforts.items():
            assert np.abs(effort).max() <= PRESS * trial.sidecar.servo["effort_limit"][joint]


@pytest.mark.slow
def test_the_answer_does_not_depend_on_the_order_of_explanations_or_on_threads(short_menu):
    trials = squeezes()
    two = {name: ALIKE[name] for name in ("coulomb_friction", "backlash")}
    first, turned = proposed(trials, two, threads=1), proposed(trials, dict(reversed(two.items())), threads=2)
    assert turned.file == first.file
    assert turned.expected_probability == pytest.approx(first.expected_probability, rel=1e-6)


def test_a_robot_that_does_not_start_open_is_opened_first(short_menu):
    (trial,) = squeezes()
    initial = {kind: dict.fromkeys(names.FINGERS, 0.03) for kind in ("position", "set_point")}
    positions = {name: values - 0.015 for name, values in trial.positions.items()}
    near = replace(trial, positions=positions, sidecar=replace(trial.sidecar, initial=initial))
    plant = plant_of([near])
    assert plant.starts[near.name].set_point[0] == 0.03
    rehearsed = rehearse.rehearse(plant, near, noise_model.collect(plant, [near]), [], Run(threads=2))
    begins = rehearsed.nominal[:, 0, : len(names.FINGERS)]
    np.testing.assert_allclose(begins, OPEN, atol=1e-9)


def test_nothing_is_proposed_where_nothing_would_help(short_menu):
    trials = squeezes()
    plant = plant_of(trials)
    same = {"force_lag": {"time_constant": 0.01}, "force_delay": {"seconds": 0.01}}
    assert len({classes_of(explanation(plant, name, *given.values())) for name, given in same.items()}) == 1
    assert proposed(trials, same) is None  # one class: no motion is asked to tell them apart
    tiny = {"coulomb_friction": {"force": 1e-4}, "force_dead_zone": {"width": 1e-6}}
    assert proposed(trials, tiny) is None  # neither shows in any motion
    with pytest.raises(OutOfTimeError):
        proposed(trials, deadline=Deadline(0.0))
