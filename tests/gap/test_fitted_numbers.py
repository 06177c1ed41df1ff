"""Numbers of the nominal model as fitted: which are confirmed, where they are written, and what the repair does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from made_diagnoses import CASES, FITTED, diagnosis, squeezed
from test_repaired import played, replayed, robot

from tiago_mj.cli import main
from tiago_mj.effects import read_effects
from tiago_mj.effects.spec import Entry
from tiago_mj.export import found as exported
from tiago_mj.gap import apply, report
from tiago_mj.gap.analysis import fitted_numbers
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import Candidate, Term, terms
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.report import advice, html, terminal
from tiago_mj.gap.report.repaired import entry, repaired
from tiago_mj.gap.result import FittedNumber
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.gap.simulation.session import Session, session_of
from tiago_mj.io.quantities import NINETY
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import Trial

#: What is off in every trial, and what is off in the training trials alone.
GAIN = Entry("servo_stiffness", ("shoulder",), {"factor": 1.03})
BIAS = Entry("encoder_bias", ("elbow",), {"offset": 8e-4})
NOISE = 2e-5


# Which numbers are confirmed ------------------------------------------------------------------------------------------


def quadratic(residual, responses):
    """Loss of leaving numbers out, of a residual and of what each of them takes from it."""
    residual, responses = np.array(residual, dtype=float), np.array(responses, dtype=float)

    def worth(out):
        left = residual + responses[list(out)].sum(axis=0)
        return 0.5 * float(left @ left), float(left @ left)

    return worth


def test_a_number_is_kept_where_trials_that_did_not_fit_it_need_it():
    needed, useless, harmful = [6.0, 0, 0], [0, 0.3, 0], [0, 0, -2.0]
    worth = quadratic([0, 0.1, 2.5], [needed, useless, harmful])
    assert fitted_numbers.eliminated(worth, 3, least=2.0) == [0]


def test_two_numbers_that_make_up_for_each_other_go_together():
    one, other, needed = [9.0, 0, 0], [-9.0, 0.1, 0], [0, 0, 5.0]
    worth = quadratic([0, 0, 0], [one, other, needed])
    assert fitted_numbers.eliminated(worth, 3, least=2.0) == [2]


def test_two_numbers_that_are_only_right_together_stay():
    one, other = [9.0, 3.0], [-9.0, 3.0]
    assert fitted_numbers.eliminated(quadratic([0, 0], [one, other]), 2, least=2.0) == [0, 1]


@pytest.fixture(scope="module")
def twin(tmp_path_factory) -> tuple[Session, Plant]:
    """Four trials of an arm whose shoulder is 3 % stiffer than its model; the elbow's encoder is off in the two that
    train."""
    plant, trial, commands = robot(tmp_path_factory.mktemp("twin"))
    names = plant.actuators
    trials = [
        replace(
            trial,
            name=f"log-{k}",
            commands={name: (0.6 + 0.1 * k) * commands[:, (j + k) % 2] for j, name in enumerate(names)},
            sidecar=replace(trial.sidecar, trial=f"log-{k}"),
        )
        for k in range(4)
    ]
    plant = plant_of(trials)
    off = [(GAIN, BIAS), (GAIN, BIAS), (GAIN,), (GAIN,)]
    true = replay.simulate(plant, replay.grid(plant, trials), list(enumerate(off)), replay.Run(threads=1))
    rng = np.random.default_rng(5)
    measured = [_measured(trial, true.position[k], rng) for k, trial in enumerate(trials)]
    return session_of(plant_of(measured), measured), plant


def _measured(trial: Trial, position: np.ndarray, rng: np.random.Generator) -> Trial:
    noisy = position + NOISE * rng.standard_normal(position.shape)
    start = {name: float(value) for name, value in zip(("shoulder", "elbow"), position[0], strict=True)}
    sidecar = replace(trial.sidecar, initial={"position": start, "set_point": start})
    return replace(
        trial, positions={name: noisy[:, k] for k, name in enumerate(("shoulder", "elbow"))}, sidecar=sidecar
    )


def searched(session: Session, sizes: dict[tuple[str, str], float]) -> tuple[Ranked, Fitted]:
    """A search that found no effect, with nuisances of these sizes."""
    predict, _ = predictor(session.plant, session.trials, threads=1)
    shared = [term for term in terms(session.plant) if not term.per_trial]
    nuisance = np.array([sizes.get((t.effect, t.target[0] if t.target else "all"), 0.0) for t in shared])
    fit = Fitted((), np.zeros(0), np.zeros(0), nuisance, 0.0, 1.0)
    return Ranked((fit,), (), 0, 1, True, np.full(len(predict.data.channels), 0.7), predict), fit


BOTH = {("servo_stiffness", "shoulder"): 0.4, ("encoder_bias", "elbow"): 0.8}


def test_what_only_the_training_trials_have_is_not_confirmed(twin):
    session, _ = twin
    assert session.splits["validation"] == ("log-2",)
    ranked, fit = searched(session, BOTH)
    (number,), joint = fitted_numbers.confirmed(session, ranked, ranked.predict.data, fit)
    assert (number.name, number.target, number.parameter) == ("servo_stiffness", "shoulder", "factor")
    assert number.low < 1.03 < number.high
    assert number.value == pytest.approx(1.03, abs=0.005)
    assert number.nominal == 1.0
    # Of one number the joint posterior is its interval, of the logarithm.
    assert joint.logarithms == (True,)
    wide = np.log(number.high / number.low) / (2 * NINETY)
    assert np.sqrt(joint.covariance[0][0]) == pytest.approx(wide, rel=1e-3)


def test_without_a_validation_trial_each_training_trial_confirms_what_the_other_says(twin):
    session, _ = twin
    ranked, fit = searched(session, BOTH)
    both = {**session.splits, "validation": ()}
    numbers, _ = fitted_numbers.confirmed(replace(session, splits=both), ranked, ranked.predict.data, fit)
    assert {(one.name, one.target) for one in numbers} == set(BOTH), "both trials that train have both"
    unlike = {**both, "train": ("log-1", "log-2")}
    (number,), _ = fitted_numbers.confirmed(replace(session, splits=unlike), ranked, ranked.predict.data, fit)
    assert number.name == "servo_stiffness", "the encoder is off in one of these alone"
    alone = {**both, "train": ("log-0",)}
    assert fitted_numbers.confirmed(replace(session, splits=alone), ranked, ranked.predict.data, fit) == ((), None)


def test_confirmed_numbers_close_the_gap_on_the_trial_kept_aside(twin):
    session, _ = twin
    ranked, fit = searched(session, BOTH)
    numbers, _ = fitted_numbers.confirmed(session, ranked, ranked.predict.data, fit)
    entries = tuple(entry(one.effect) for one in numbers)
    test, data = session.subset("test"), ranked.predict.data
    before, after = ranked.predict.as_simulated().all_trials([(), entries], test)
    left = [float(np.nanmean(((data.value[test] - one) / data.noise) ** 2)) for one in (before, after)]
    assert left[0] > 10
    assert left[1] < 3  # noise alone leaves 1; numbers that validation does not need are not moved


# Where they are written, and what they do -----------------------------------------------------------------------------

NUMBERS = (
    FittedNumber("servo_stiffness", "shoulder", "factor", 1.03, 1.02, 1.04, "-", 1.0),
    FittedNumber("servo_damping", "elbow", "damping", -0.05, -0.06, -0.04, "N·m·s/rad", 0.0),
    FittedNumber("encoder_bias", "elbow", "offset", 0.001, 0.0005, 0.0015, "rad", 0.0),
)


def test_the_repaired_model_and_the_calibration_do_what_the_fit_predicts(tmp_path):
    plant, trial, commands = robot(tmp_path)
    found = diagnosis("no_gap", (), channels=("position.shoulder",), robot=plant.name, numbers=NUMBERS)
    found = replace(found, repaired=repaired(found, plant))
    assert found.repaired is not None
    assert found.repaired.numbers == 2  # no model file holds what an encoder reads
    entries = tuple(entry(one.effect) for one in NUMBERS)
    moved = replayed(replace(plant, given=entries[:2]), trial)
    assert np.abs(moved - replayed(plant, trial)).max() > 1e-3
    written = report.write(replace(found, overlays=()), tmp_path / "diagnosis")
    np.testing.assert_allclose(played(written["repaired.xml"], plant, commands), moved, rtol=0, atol=1e-9)
    assert "encoder_bias on elbow: offset 0.001: NOT HELD" in written["repaired.xml"].read_text()
    whole = replayed(replace(plant, given=entries), trial)
    stepper = apply(mujoco.MjModel.from_xml_path(str(plant.file)), written["calibration.yaml"])
    assert _driven(stepper, commands) == pytest.approx(whole, abs=1e-9)
    plain = apply(mujoco.MjModel.from_xml_path(str(plant.file)), written["calibration.yaml"], numbers=False)
    assert _driven(plain, commands) == pytest.approx(replayed(plant, trial), abs=1e-9)


def _driven(stepper, commands: np.ndarray) -> np.ndarray:
    stepper.reset({"shoulder": 0.1, "elbow": -0.2})
    rows = [stepper.position.copy()]
    for sent in commands[:-1]:
        stepper.step(sent)
        rows.append(stepper.position.copy())
    return np.array(rows)


@pytest.fixture
def calibration(tmp_path) -> Path:
    return report.write(replace(CASES["effect_and_numbers"], overlays=()), tmp_path / "diagnosis")["calibration.yaml"]


def test_a_calibration_holds_numbers_with_interval_unit_and_nominal(calibration):
    said = yaml.safe_load(calibration.read_text())["numbers"]
    assert [one["name"] for one in said] == [one.name for one in FITTED]
    factor = {"value": 1.0198, "low": 1.0174, "high": 1.0222, "unit": "-", "nominal": 1.0}
    assert said[0]["parameters"] == {"factor": factor}
    assert said[1]["target"] == "all"


def test_numbers_are_switched_off_by_every_command_that_applies_a_diagnosis(calibration, tmp_path):
    out = tmp_path / "out"
    assert [one.name for one in exported.read(calibration).entries][1:] == [one.name for one in FITTED]
    assert len(exported.read(calibration, numbers=False).entries) == 1
    recording = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--effects", str(calibration)]
    for choice in ("yes", "no"):
        assert main([*recording, "--numbers", choice, "--out", str(out / choice)]) == 0
    moved, plain = (read_recordings([out / one]).trials[0].positions for one in ("yes", "no"))
    assert not all(np.array_equal(moved[name], plain[name]) for name in moved)
    assert main(["export", str(calibration), "--to", "gymnasium", "--numbers", "no", "--out", str(out / "e")]) == 0
    assert read_effects(out / "e" / "calibration.yaml") == read_effects(calibration, numbers=False)


@pytest.mark.parametrize("wrong", ["numbers: 3", "numbers: [{target: all}]", "numbers: [{name: nothing}]"])
def test_numbers_of_another_form_are_refused_in_one_line(wrong, tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text(f"schema: tiago_mj.calibration/1\neffects: []\n{wrong}\n")
    with pytest.raises(ValueError, match=r"numbers|name|nothing") as said:
        read_effects(path)
    assert "\n" not in str(said.value)


# What is said ---------------------------------------------------------------------------------------------------------


def terminal_text(name: str) -> str:
    return "\n".join(line for _, line in terminal.lines(CASES[name], {}))


def test_the_report_says_the_gap_before_with_the_effect_and_with_both():
    said = "the gap is 58.3 times the noise, with the effect 5.02 and with the effect and the numbers 1.31."
    assert said in terminal_text("effect_and_numbers")
    page = html.render(replace(CASES["effect_and_numbers"], overlays=()))
    for word in ("58.3", "5.02", "1.31", "Servo stiffness on the gripper's right finger"):
        assert word in squeezed(page).replace("&#39;", "'"), word
    assert "with the numbers as fitted 99 %" in terminal_text("effect_and_numbers")


def test_no_gap_beside_a_gap_says_which_numbers_close_it():
    text = terminal_text("numbers_alone")
    assert text.startswith("No effect: the simulator's own numbers, moved within their tolerance, close 99 % (98")
    assert "Command delay" in text
    assert "0.8 ms (0.4–1.1)" in text
    steps = advice.advice(CASES["numbers_alone"])
    assert any("repaired" in step.title for step in steps)


def test_a_number_is_left_open_as_far_as_the_recordings_say_nothing_of_it(twin):
    _, plant = twin
    shared = [term for term in terms(plant) if not term.per_trial]
    deviations = np.ones(len(shared))
    spoken = next(k for k, term in enumerate(shared) if (term.effect, term.target) == ("servo_stiffness", ("elbow",)))
    deviations[spoken] = 0.01
    none = np.zeros(0)
    silent = Fitted((), none, none, np.zeros(len(shared)), 0.0, 1.0)
    known = replace(silent, nuisance_deviations=deviations)
    left = {(one.name, one.target): one for one in fitted_numbers.open_numbers(plant, known, ())}
    assert len(left) == len(shared)
    one, prior = left["servo_stiffness", "elbow"], fitted_numbers.open_numbers(plant, silent, ())[spoken]
    assert prior.left == left["servo_stiffness", "shoulder"].left == 1
    assert np.log(one.high / one.low) == pytest.approx(one.left * np.log(prior.high / prior.low), rel=1e-3)
    part = Candidate("servo_stiffness", None, "factor", (), 1.0, 0.2, 4.0, (), "-")
    changed = Fitted((part,), np.array([2.0]), np.array([0.1]), np.zeros(len(shared)), 0.0, 1.0)
    rest = {(one.name, one.target) for one in fitted_numbers.open_numbers(plant, changed, NUMBERS)}
    assert rest == {key for key in left if key[0] != "servo_stiffness"} - {(one.name, one.target) for one in NUMBERS}


@pytest.mark.parametrize(
    ("effect", "parameter", "size", "possible"),
    [
        ("command_delay", "seconds", 0.5, True),
        ("command_delay", "seconds", -0.5, False),
        ("clock_offset", "seconds", -0.5, False),
        ("viscous_friction", "damping", -0.5, True),
        ("viscous_friction", "damping", 0.0, False),
    ],
)
def test_a_number_is_no_part_of_a_repair_that_its_effect_cannot_have(effect, parameter, size, possible):
    """A delay of -1e-9 s of a grasp ended its diagnosis where the repaired simulator was made."""
    term = Term(effect, None, parameter, 0.0, 0.001, False)
    assert fitted_numbers.Sized(term, size).possible is possible
