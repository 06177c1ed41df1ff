"""The black-box baselines fit the right simulation, and their answers have the diagnosis's form."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import cases, fitters, recordings, robots


@pytest.fixture(scope="module")
def soft(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pendulum whose servo has 0.7 of its stiffness."""
    folder = tmp_path_factory.mktemp("soft")
    (folder / robots.PLAIN_FILE).write_text(robots.PLAIN)
    choice = cases.EffectChoice("servo_stiffness", "all", {"factor": 0.7})
    case = cases.Case(seed=4, setting="plain", effects=(choice,), spread=0.0, seconds=4.0)
    recordings.write(cases.simulate(case, folder), folder)
    return folder


def test_the_true_parameters_leave_the_noise_and_the_nominal_ones_do_not(soft: Path) -> None:
    problem = fitters.Problem(soft, "plain")
    point = np.zeros((2, len(problem.names)))
    point[1, problem.names.index("servo_stiffness")] = np.log(0.7) / fitters.SIZES["plain"]["servo_stiffness"]
    nominal, true = problem.loss(point, fitters.FITTED)
    assert true == pytest.approx(1.0, abs=0.15)  # 400 readings of two channels
    assert nominal > 20


def test_a_fitter_names_what_it_cannot_do_without(soft: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = fitters.Problem(soft, "plain")
    z = np.zeros(len(problem.names))
    z[problem.names.index("servo_stiffness")] = np.log(0.7) / fitters.SIZES["plain"]["servo_stiffness"]
    z[problem.names.index("viscous_friction")] = 0.05
    monkeypatch.setattr(fitters, "METHODS", {"given": lambda _: z, "idle": lambda _: 0 * z})
    said = fitters.answer(problem, "given")
    assert [effect["name"] for effect in said["verdict"]["effects"]] == ["servo_stiffness"]
    assert said["verdict"]["effects"][0]["parameters"]["factor"]["value"] == pytest.approx(0.7)
    assert said["shrink"]["closed"] > 0.95
    assert fitters.answer(problem, "idle")["verdict"]["kind"] == "no_gap"
