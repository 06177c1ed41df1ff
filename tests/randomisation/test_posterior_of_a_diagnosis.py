"""The posterior that a diagnosis holds."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "gap"))
from made_diagnoses import CASES, COULOMB, GAIN, LAG, diagnosis, replace

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.report import json as report_json
from tiago_mj.gap.result import Explanation, Joint, Named, OpenNumber, Value
from tiago_mj.io.quantities import NINETY
from tiago_mj.randomisation import diagnosis as reading
from tiago_mj.randomisation.posterior import described

TOGETHER = Joint((False, False), ((0.0232, -0.0002), (-0.0002, 4e-6)), (0.0, 0.0), (12.0, 0.3))
ALONE = Joint((False,), ((0.01,),), (0.0,), (12.0,))


def made(**changes):
    """A diagnosis of two effects that were fitted together, and its file's way there and back."""
    best = Explanation((COULOMB, LAG), 0.9, 50.0, joint=TOGETHER)
    return replace(diagnosis(best=(COULOMB, LAG)), best=best, alternatives=(best,), **changes)


def written(found, folder):
    folder.mkdir(exist_ok=True)
    report_json.write(found, folder / "diagnosis.json")
    return folder


def test_covariance_and_bounds_are_those_of_the_fit(tmp_path):
    found = reading.read(written(made(), tmp_path / "diag"))
    assert found.source == "diag/diagnosis.json"
    assert len(found.sha256) == 64
    (one,) = found.explanations
    assert one.probability == pytest.approx(0.9)
    np.testing.assert_allclose(one.block.covariance, TOGETHER.covariance, rtol=1e-5)
    assert [(n.parameter, n.low, n.high) for n in one.block.numbers] == [("force", 0, 12), ("time_constant", 0, 0.3)]
    rng = np.random.default_rng(0)
    drawn = np.array(
        [
            [e.parameters[n] for e, n in zip(found.sample(rng), ("force", "time_constant"), strict=True)]
            for _ in range(2000)
        ]
    )
    # Correlation of -0.66; its standard error with 2000 draws is (1 - 0.66²) / √2000 = 0.013, here five of them.
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(-0.0002 / math.sqrt(0.0232 * 4e-6), abs=0.065)


def test_a_place_is_drawn_beside_its_mass_within_what_is_possible():
    place = {"mass": Value(0.5, 0.4, 0.6, "kg"), "y": Value(0.1, 0.05, 0.15, "m")}
    held = Named("payload", ("elbow",), place)
    best = Explanation((held,), 0.9, 50.0, joint=Joint((False,), ((0.0036,),), (0.0,), (4.0,)))
    (one,) = reading.posterior(replace(diagnosis(best=(held,)), best=best, alternatives=(best,)), "made").explanations
    assert [number.parameter for number in one.block.numbers] == ["mass", "y"]
    assert (one.block.numbers[1].low, one.block.numbers[1].high) == EFFECTS["payload"].details["y"].bounds
    np.testing.assert_allclose(one.block.covariance, np.diag([0.0036, (0.05 / NINETY) ** 2]))


def test_numbers_as_fitted_and_open_numbers_are_drawn_beside_the_effects(tmp_path):
    numbers = CASES["effect_and_numbers"].numbers
    joint = Joint((True, False), ((1e-6, 1e-7), (1e-7, 4e-8)), (None, 0.0), (None, None))
    left = (
        OpenNumber("force_limit", "all", "limit", 16.0, 14.9, 17.1, "N", 1.0),
        OpenNumber("object_mass", "all", "factor", 1.0, 0.9, 1 / 0.9, "-", 0.3, 0.0),
    )
    found = reading.read(written(made(numbers=numbers, numbers_joint=joint, open_numbers=left), tmp_path / "d"))
    drawn = found.sample(np.random.default_rng(1))
    assert [e.name for e in drawn] == [
        *("coulomb_friction", "force_lag", "servo_stiffness", "command_delay", "force_limit", "object_mass")
    ]
    assert found.numbers.numbers[0].logarithm
    assert math.sqrt(found.open_numbers[0].block.covariance[0][0]) == pytest.approx(1.1 / NINETY)
    assert math.sqrt(found.open_numbers[1].block.covariance[0][0]) == pytest.approx(-math.log(0.9) / NINETY)
    assert sum("no recording speaks of them: force_limit" in line for line in described(found)) == 1


def test_all_of_the_reported_set_is_drawn(tmp_path):
    one, other = (Explanation((e,), p, 9.0, joint=ALONE) for e, p in ((COULOMB, 0.5), (GAIN, 0.3)))
    both = replace(
        diagnosis(best=(COULOMB,)), kind="ambiguous", best=one, alternatives=(one, other), ranking=(one, other)
    )
    found = reading.read(written(both, tmp_path / "d"))
    assert [e.block.effects[0].name for e in found.explanations] == ["coulomb_friction", "force_gain"]
    assert found.shares.tolist() == pytest.approx([0.625, 0.375])
    assert found.remainder == pytest.approx(0.2)


def test_without_a_gap_there_is_no_effect_to_draw():
    found = reading.posterior(CASES["no_gap"], "made")
    assert found.sample(np.random.default_rng(0)) == ()
    assert "no effect" in "\n".join(described(found))


@pytest.mark.parametrize(
    ("case", "said"),
    [
        ("unknown_with_a_shape", "names nothing that explains it"),
        ("stopped", "its search was stopped"),
        ("effect", "holds no joint posterior of what it names"),
    ],
)
def test_what_has_no_posterior_is_refused_in_one_line(case, said, tmp_path):
    found = CASES[case] if case in CASES else replace(diagnosis(), complete=False)
    with pytest.raises(ValueError, match=said) as fault:
        reading.read(written(found, tmp_path / "d"))
    assert "\n" not in str(fault.value)


def test_a_folder_without_a_diagnosis_is_one_line(tmp_path):
    with pytest.raises(ValueError, match=r"holds no diagnosis.json: give the folder that tiago-mj diagnose") as fault:
        reading.read(tmp_path)
    assert "\n" not in str(fault.value)


def test_an_effect_of_another_version_is_one_line(tmp_path):
    file = written(made(), tmp_path / "d") / "diagnosis.json"
    file.write_text(file.read_text().replace('"coulomb_friction"', '"coulomb_rubbing"'))
    with pytest.raises(ValueError, match=r"^effect 'coulomb_rubbing' is unknown") as fault:
        reading.read(tmp_path / "d")
    assert "\n" not in str(fault.value)
