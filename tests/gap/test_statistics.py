"""What several parts of the diagnosis compute once: correlation times, robust scatter, the gap's table."""

import numpy as np
import pytest
from scipy import signal

from tiago_mj.gap.analysis import locate
from tiago_mj.gap.analysis.locate import Signal
from tiago_mj.gap.result import PHASES
from tiago_mj.recordings import robust
from tiago_mj.recordings.autocorrelation import integrated_time

FREE, HOLD = PHASES.index("free motion"), PHASES.index("hold")


def remembers(share: float, rows: int, seed: int) -> np.ndarray:
    """Noise of which each sample keeps a share of the one before: its time is (1 + share) / (1 - share)."""
    drawn = np.random.default_rng(seed).standard_normal(rows + 500)
    return signal.lfilter([1.0], [1.0, -share], drawn)[500:]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_the_time_of_noise_that_remembers_is_the_known_one(share: float) -> None:
    truth = (1 + share) / (1 - share)
    found = [integrated_time(remembers(share, 4000, seed)) for seed in range(20)]
    # Single estimates scatter by a fifth at this length; their mean is known to a twentieth, and biased by as much.
    assert np.mean(found) == pytest.approx(truth, rel=0.1)


def test_what_swings_counts_up_to_its_first_turn_and_what_alternates_counts_in_full() -> None:
    rows = np.arange(1000)
    swing = np.sin(2 * np.pi * rows / 100)
    assert 25 < integrated_time(swing) < 40  # 1 + 2 · the sum of a cosine over a quarter of 100 rows, 33
    assert integrated_time((-1.0) ** rows) == 1.0


def test_parts_and_holes_of_one_process_change_its_time_little() -> None:
    whole = remembers(0.8, 6000, 3)
    holes = whole.copy()
    holes[np.arange(6000) % 300 < 60] = np.nan  # a rest now and then
    parts = np.split(whole, [1000, 3500])
    assert integrated_time(holes) == pytest.approx(integrated_time(whole), rel=0.15)
    assert integrated_time(parts) == pytest.approx(integrated_time(whole), rel=0.1)


def test_what_does_not_vary_or_is_hardly_there_is_independent() -> None:
    assert integrated_time(np.zeros(100)) == 1.0
    assert integrated_time(np.array([1.0, np.nan, -1.0])) == 1.0
    assert integrated_time([]) == 1.0


def test_a_few_wrong_readings_do_not_change_the_scatter() -> None:
    values = np.random.default_rng(0).normal(5.0, 2.0, 4000)
    values[::50] = 1e6
    assert robust.deviation(values) == pytest.approx(2.0, rel=0.05)
    assert robust.deviation(values - 5.0, about_zero=True) == pytest.approx(2.0, rel=0.05)
    assert robust.deviations(np.stack([values, 3 * values]), axis=1) == pytest.approx([2.0, 6.0], rel=0.05)


def test_the_gap_is_found_in_its_channel_phase_and_band() -> None:
    random, rate, rows = np.random.default_rng(1), 100.0, 1000
    time = np.arange(rows) / rate
    phase = np.where(np.arange(rows) < 600, FREE, HOLD)

    def parts(more: np.ndarray) -> list[Signal]:
        return [Signal(random.standard_normal(rows) + more, phase, np.full(rows, k)) for k in range(6)]

    shaken, off = 6.0 * np.sin(2 * np.pi * 3.0 * time) * (phase == FREE), 4.0 * (phase == HOLD)
    table = locate.table({"position.a": parts(shaken), "position.b": parts(off)}, 1 / rate, rate / 2, seed=0)
    first, second = table[0], table[1]
    assert (first.channel, first.phase, first.band) == ("position.a", "free motion", "1-5 Hz")
    assert first.gap == pytest.approx(18.0, rel=0.1)  # half of 6²
    assert (second.channel, second.phase, second.band) == ("position.b", "hold", "bias")
    assert second.gap == pytest.approx(16.0, rel=0.1)
    assert first.low <= first.gap <= first.high
    assert sum(place.share for place in table) == pytest.approx(1.0)


def test_of_one_recording_the_intervals_come_from_its_pieces() -> None:
    random = np.random.default_rng(2)
    values = random.standard_normal(2000) + 3.0
    one = [Signal(values, np.full(2000, FREE), np.arange(2000) // 50)]
    (bias, *_) = locate.table({"effort.a": one}, 0.02, 10.0, seed=0)
    assert bias.band == "bias"
    assert bias.gap == pytest.approx(values.mean() ** 2)
    # 2000 independent samples tell a mean of 3 to 0.022, its square to six times that: 3.3 deviations are 90 %.
    assert bias.high - bias.low == pytest.approx(3.3 * 6 * 0.022, rel=0.3)
    assert bias.low < bias.gap < bias.high
    assert {place.band for place in locate.table({"effort.a": one}, 0.02, 4.0, seed=0)} == {
        "bias",
        "below 1 Hz",
        "1-5 Hz",
    }, "above the low-pass there is nothing"
