"""The fetched recordings: converted as the diagnosis reads them, and the regressions' figures."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real import logs, run
from benchmarks.real.cases import CASES, REGRESSIONS, files
from benchmarks.real.declare import COMMANDS, EFFORTS
from benchmarks.real.robots import emps, kuka_kr300, xl330
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings

ROOT = Path(__file__).resolve().parents[2]
KEPT = json.loads((ROOT / "benchmarks" / "results" / "real_regression.json").read_text())["results"]


@pytest.mark.parametrize("name", CASES)
def test_a_case_is_written_as_the_diagnosis_reads_it(name, fetched, tmp_path):
    case = CASES[name]
    data = fetched(case.source, {file.place for file in files(case)})
    folder = run.convert(case, data, tmp_path)
    found = read_recordings([folder])
    findings = [*found.findings, *lint.inspect(found.trials)]
    lint.refuse(found.trials, findings)  # raises where a recording cannot be used
    assert (tmp_path / logs.ROBOT).exists() == (case.model is not None)
    assert (tmp_path / logs.KNOWN).exists() == bool(case.known)
    for trial in found.trials:
        assert trial.time[0] == 0.0
        assert (np.diff(trial.time) > 0).all()
        if case.recording == COMMANDS:
            assert trial.commands
            assert not trial.efforts
            assert set(trial.commands) == set(case.joints)
        if case.recording == EFFORTS:
            assert trial.efforts
            assert not trial.commands
    moving = {joint for trial in found.trials for joint in (*trial.commands, *trial.efforts)}
    assert {cause.target for cause in case.causes if cause.target} <= moving


@pytest.mark.parametrize("source", [name for name in REGRESSIONS if name not in ("ur10e", "tiago_arm", "sts3250")])
def test_a_regression_gives_what_is_kept(source, fetched):
    made = REGRESSIONS[source](fetched(source))
    assert set(made) == set(KEPT[source])
    for key, value in made.items():
        assert value == pytest.approx(KEPT[source][key], rel=2e-3, abs=1e-6), key


def test_emps_has_the_published_mass_and_friction(fetched):
    found = emps.regress(fetched("emps"))
    assert found["mass"] == pytest.approx(emps.MASS, rel=0.005)
    assert found["viscous"] == pytest.approx(emps.VISCOUS, rel=0.03)
    assert found["coulomb"] == pytest.approx(emps.COULOMB, rel=0.03)
    assert found["offset"] == pytest.approx(emps.OFFSET, rel=0.02)
    assert found["law: unexplained"] < 1e-6
    assert found["law: late"] == pytest.approx(1.05e-3, rel=0.01)


def test_the_motor_of_the_pendulum_is_one_at_all_gains(fetched):
    found = xl330.regress(fetched("xl330"))
    for gain in xl330.AT_GAIN:
        assert 0.28 < found[f"gain {gain}: by load"] < 0.40
        assert found[f"gain {gain}: armature"] == pytest.approx(0.0020, rel=0.15)
        assert found[f"gain {gain}: viscous"] == pytest.approx(0.0067, rel=0.15)
        assert found[f"gain {gain}: explained"] > 0.95


def test_the_encoders_of_the_kr300_are_three_milliseconds_apart(fetched):
    found = kuka_kr300.regress(fetched("kuka_kr300"))
    for recording in "abc":
        for axis in kuka_kr300.AXES:
            assert found[f"{recording}: {axis}.delay"] == pytest.approx(3.0e-3, rel=0.05)
            assert found[f"{recording}: {axis}.explained by delay"] > 0.93
            assert found[f"{recording}: {axis}.explained by torque"] < 0.70


def test_the_double_pendulums_friction_is_pi_half_of_its_coefficients(fetched):
    found = REGRESSIONS["double_pendulum"](fetched("double_pendulum"))
    for day in ("as is", "compensated"):
        for joint in ("shoulder", "elbow"):
            assert 0.12 < found[f"{day}: {joint}.coulomb"] < 0.18  # 0.093 and 0.078 as they stand are less
    assert found["other day: elbow.coulomb"] == pytest.approx(0.128, rel=0.02)


@pytest.mark.parametrize("source", ["emps", "double_pendulum", "xl330", "simple_pendulum", "kuka_kr300"])
def test_a_truth_lies_where_its_regression_says(source):
    """Of the kept figures: a declared value and its regression are no further apart than the truth's uncertainty."""
    kept = KEPT[source]
    checks = {
        "emps": (("coulomb", "emps-efforts-friction", 0), ("viscous", "emps-efforts-friction", 1)),
        "double_pendulum": (
            ("other day: shoulder.coulomb", "double-pendulum-friction", 0),
            ("other day: elbow.coulomb", "double-pendulum-friction", 1),
            ("as is: elbow.coulomb", "double-pendulum-other-day", 0),
        ),
        "xl330": (
            ("gains 400 and 800: by load", "xl330-efforts-low-gains", 0),
            ("gains 400 and 800: armature", "xl330-efforts-low-gains", 1),
            ("gains 400 and 800: viscous", "xl330-efforts-low-gains", 2),
            ("gains 100 and 200: by load", "xl330-efforts-gain-400", 0),
        ),
        "simple_pendulum": (
            ("collocation: coulomb", "simple-pendulum-ddp", 0),
            ("ddp: coulomb", "simple-pendulum-collocation", 0),
        ),
        "kuka_kr300": tuple((f"b: axis_{k}.delay", "kuka-encoders", k - 1) for k in (1, 2, 3)),
    }
    for key, case, k in checks[source]:
        low, high = CASES[case].causes[k].accepted
        assert low <= kept[key] <= high, key
