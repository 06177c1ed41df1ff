"""Vectors taken apart and put together: one formula for one simulation and for many, to the same bits."""

import numpy as np
import pytest

from tiago_mj.sensing.columns import columns, joined


@pytest.mark.parametrize("leading", [(), (1,), (5,), (2, 3)])
def test_vectors_taken_apart_are_put_together_again(leading):
    vectors = np.random.default_rng(0).standard_normal((*leading, 3))
    entries = columns(vectors)
    assert [np.shape(entry) for entry in entries] == [leading] * 3
    again = joined(entries)
    assert again.flags.c_contiguous
    np.testing.assert_array_equal(again, vectors, strict=True)


def test_a_formula_has_the_same_bits_of_one_as_of_many():
    vectors = np.random.default_rng(1).standard_normal((1000, 2)) * 1e3

    def formula(vector):
        first, second = columns(vector)
        return joined((abs(first / 606.1 - second) * 0.3, -(first * second + 0.1)))

    many = formula(vectors)
    assert many.tobytes() == b"".join(formula(vector).tobytes() for vector in vectors)


def test_a_vector_of_another_kind_keeps_it():
    first, second = columns(np.array([0.1, 0.2], dtype=np.float32))
    assert (first + second).dtype == np.float32
