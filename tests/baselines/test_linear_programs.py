"""Linear programs against answers by hand."""

from __future__ import annotations

import os
from types import SimpleNamespace

import highspy
import numpy as np
import pytest
import scipy

from baselines import linear_programs
from baselines.linear_programs import LinearProgram
from trajopt.core.exceptions import TrajoptError


def program(matrix: object, above: object, high: object) -> LinearProgram:
    """`matrix x ≤ above` and `0 ≤ x ≤ high`."""
    loaded = LinearProgram()
    loaded.load(
        low=np.zeros(len(high)),
        high=np.array(high),
        matrix=scipy.sparse.csr_matrix(matrix),
        above=np.array(above),
    )
    return loaded


def test_the_minimum_and_the_multipliers_that_prove_it() -> None:
    # x + y ≥ 1, y ≤ 0.25, z ≥ 2
    matrix = [[-1.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
    answer = program(matrix, [-1.0, -2.0], [5.0, 0.25, 5.0]).minimised(np.array([1.0, 0.0, 1.0]))
    assert answer.x == pytest.approx([0.75, 0.25, 2.0], rel=1e-12)
    assert answer.value == pytest.approx(2.75)
    assert answer.multipliers == pytest.approx([1.0, 1.0])


def test_a_row_is_added_and_another_program_begins_at_the_same_basis() -> None:
    small = program([[-1.0]], [-1.0], [5.0])
    cost = np.ones(1)
    column = np.zeros(1, dtype=np.intp)
    assert small.add_row(column, np.array([-1.0]), -2.0)
    assert small.minimised(cost).value == pytest.approx(2.0)
    other = program([[-1.0], [-1.0]], [-1.0, -3.0], [5.0])
    other.begin_at(small.basis())
    assert other.minimised(cost).value == pytest.approx(3.0)


def test_a_ray_proves_that_no_point_satisfies_the_rows() -> None:
    # x ≤ −1 beside x ≥ 0
    answer = program([[1.0]], [-1.0], [5.0]).minimised(np.ones(1))
    assert answer.x is None
    assert answer.multipliers[0] > 0


def test_numbers_that_highs_refuses_are_an_error() -> None:
    with pytest.raises(TrajoptError, match="HiGHS"):
        program([[np.inf]], [1.0], [1.0]).minimised(np.ones(1))


def test_many_rows_may_take_many_iterations() -> None:
    # min Σ x with x_i + x_(i+1) ≥ 1 is 1000: every other one of 2001
    pairs = -(np.eye(2000, 2001) + np.eye(2000, 2001, 1))
    answer = program(pairs, -np.ones(2000), np.full(2001, np.inf)).minimised(np.ones(2001))
    assert answer.value == pytest.approx(1000.0, rel=1e-9)


def test_what_highs_prints_as_it_starts_is_no_output(capfd, monkeypatch):
    """HiGHS 1.16 says its version on standard output, where a command's JSON stands."""

    class Loud(highspy.Highs):
        def __init__(self):
            os.write(1, b"Running HiGHS\n")
            super().__init__()

    monkeypatch.setattr(linear_programs, "backend", lambda name: SimpleNamespace(Highs=Loud))
    LinearProgram()
    print("an answer")
    assert capfd.readouterr().out == "an answer\n"
