"""Linear programs small enough to be solved by hand."""

import numpy as np
import pytest

from baselines.linear_programs import Entries, LinearPrograms


def test_a_corner_found_by_hand():
    # min −x − 2y with x + y ≤ 4, x − y ≥ −2 and x, y ≤ 3: y = x + 2 = 4 − x.
    matrix = np.array([[1.0, 1.0], [-1.0, 1.0]])
    cost = np.array([-1.0, -2.0])
    high = np.full(2, 3.0)
    place = LinearPrograms().minimised(cost, matrix, np.array([4.0, 2.0]), high)
    assert place == pytest.approx([1.0, 3.0], rel=1e-12)


def test_the_entries_are_the_matrix_and_zeros_are_none():
    # min x + z with x ≥ 1 − y, z ≥ 2 and y ≤ 0.25; the middle row is empty.
    entries = Entries(
        np.array([0, 0, 0, 1, 2]),
        np.array([2, 1, 0, 1, 2]),
        np.array([0.0, -1.0, -1.0, 0.0, -1.0]),
    )
    cost = np.array([1.0, 0.0, 1.0])
    above = np.array([-1.0, 0.0, -2.0])
    high = np.array([5.0, 0.25, 5.0])
    place = LinearPrograms().minimised_sparse(cost, entries, above, high)
    assert place == pytest.approx([0.75, 0.25, 2.0], rel=1e-12)


def test_no_answer_where_there_is_none_and_another_after_it():
    programs = LinearPrograms()
    one = np.ones(1)
    # x ≤ −1 beside x ≥ 0, and a coefficient that is no number
    assert programs.minimised(one, np.array([[1.0]]), -one, 5 * one) is None
    assert programs.minimised(one, np.array([[np.inf]]), one, one) is None
    assert programs.minimised(-one, np.array([[1.0]]), 2 * one, 5 * one) == pytest.approx([2.0])


def test_many_rows_may_take_many_iterations():
    # min Σ x with x_i + x_(i+1) ≥ 1: every other one, 1000 of 2001; an iteration or more for each.
    rows = np.arange(2000)
    columns = np.stack([rows, rows + 1], axis=1)
    entries = Entries(rows.repeat(2), columns.ravel(), np.full(4000, -1.0))
    cost = np.ones(2001)
    unlimited = np.full(2001, np.inf)
    place = LinearPrograms().minimised_sparse(cost, entries, -np.ones(2000), unlimited)
    assert place is not None
    assert cost @ place == pytest.approx(1000.0, rel=1e-9)
