"""The trials with most motion are looked at first, as many as are worth the time."""

from tiago_mj.gap.detectors.liveliest import liveliest


def test_those_that_moved_most_are_taken_as_long_as_their_rows_are_few() -> None:
    assert liveliest([1.0, 5.0, 3.0, 4.0], [400, 400, 400, 400], 900) == [1, 3]
    assert liveliest([1.0, 5.0, 3.0, 4.0], [400, 400, 400, 400]) == [0, 1, 2, 3]


def test_one_is_taken_however_long_it_is() -> None:
    assert liveliest([1.0, 5.0], [10_000, 20_000], 900) == [1]
