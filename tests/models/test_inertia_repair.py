"""Invalid inertias are clamped, not averaged."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tiago_mj.models.convert import inertia

FINGER = np.array([[2.32e-4, -5e-6, -3.2e-5], [-5e-6, 2.24e-4, 3.6e-5], [-3.2e-5, 3.6e-5, 2.9e-5]])
ARM_1 = np.array([[2.471e-3, -1.809e-3, -1.202e-3], [-1.809e-3, 6.132e-3, 4.94e-4], [-1.202e-3, 4.94e-4, 6.704e-3]])


@pytest.mark.parametrize(("tensor", "change"), [(FINGER, 0.015), (ARM_1, 0.032)])
def test_the_published_inertias_change_by_a_few_percent_in_their_largest_moment_only(tensor, change):
    repaired, report = inertia.repair("link", 0.1, tensor)
    before, after = np.linalg.eigvalsh(tensor), np.linalg.eigvalsh(repaired)
    assert not inertia.is_valid(tensor)
    assert inertia.is_valid(repaired)
    np.testing.assert_allclose(after[:2], before[:2], rtol=1e-9)
    assert after[2] == pytest.approx(before[0] + before[1], rel=1e-6)
    assert 1 - after[2] / before[2] == pytest.approx(change, abs=0.002)
    np.testing.assert_allclose([report.before, report.after], [before, after], rtol=1e-9)


def test_the_finger_stays_easy_to_turn_about_its_long_axis():
    repaired, _ = inertia.repair("finger", 0.11, FINGER)
    isotropic = np.trace(FINGER) / 3  # what balanceinertia would set
    assert isotropic / np.linalg.eigvalsh(repaired)[0] > 5


def test_random_invalid_inertias_become_valid_with_the_same_axes():
    rng = np.random.default_rng(0)
    repaired_count = 0
    for _ in range(500):
        axes = Rotation.random(random_state=rng).as_matrix()
        moments = rng.uniform(-0.2, 1.0, 3) * 10 ** rng.uniform(-6, 0)
        tensor = axes @ np.diag(moments) @ axes.T
        tensor = (tensor + tensor.T) / 2
        valid = inertia.is_valid(tensor)
        repaired, report = inertia.repair("link", 1.0, tensor)
        assert inertia.is_valid(repaired)
        np.testing.assert_allclose(repaired, repaired.T, rtol=0, atol=0)
        turned = axes.T @ repaired @ axes
        np.testing.assert_allclose(turned, np.diag(np.diag(turned)), atol=1e-12)
        assert (report is None) == valid
        if valid:
            assert repaired is tensor
        repaired_count += not valid
    assert 100 < repaired_count < 500


def test_moments_of_zero_or_less_get_the_stated_floor():
    repaired, report = inertia.repair("link", 0.1, np.zeros((3, 3)))
    np.testing.assert_allclose(np.diag(repaired), 0.1 * inertia.SMALLEST_RADIUS_OF_GYRATION**2)
    assert report.before == (0, 0, 0)


def test_a_repair_is_told_in_one_line():
    _, report = inertia.repair("arm_1_link", 1.56, ARM_1)
    assert str(report) == (
        "link arm_1_link: principal moments 0.001557 0.005976 0.007774 -> 0.001557 0.005976 0.007533 kg m2"
    )
