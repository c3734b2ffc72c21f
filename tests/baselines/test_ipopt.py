"""IPOPT through CasADi: against closed forms, and the order of tables in a vector."""

from __future__ import annotations

import signal
from contextlib import suppress

import casadi as ca
import numpy as np
import pytest

from baselines.ipopt import Program, flat, program, unflat


def nearest_point_of_a_circle(**options: float) -> tuple[object, np.ndarray]:
    """The point with |x| = r nearest to c: r c / |c|; IPOPT's word and answer."""
    x = ca.MX.sym("x", 2)
    c = ca.MX.sym("c", 2)
    r = ca.MX.sym("r")
    solver = program(
        "circle",
        variables=[x],
        parameters=[c, r],
        objective=ca.sumsqr(x - c),
        constraints=[ca.sumsqr(x) - r**2],
        options=options,
    )
    everywhere = (np.full(2, -np.inf), np.full(2, np.inf))
    run = solver(np.ones(2), np.array([3.0, 4.0, 2.0]), everywhere, (0.0, 0.0))
    return run.success, run.x


def test_a_program_with_a_closed_form() -> None:
    success, x = nearest_point_of_a_circle(tol=1e-10)
    assert success
    np.testing.assert_allclose(x, [2 * 3 / 5, 2 * 4 / 5], rtol=1e-9)


def test_a_run_without_success_says_so() -> None:
    success, _ = nearest_point_of_a_circle(max_iter=0)
    assert not success


def test_flat_is_the_order_of_casadi_and_unflat_leads_back() -> None:
    tables = [np.arange(6.0).reshape(2, 3), np.array([7.0, 8.0])]
    vector = flat(*tables)
    casadi = ca.vertcat(*(ca.vec(ca.DM(table)) for table in tables))
    np.testing.assert_array_equal(vector, np.asarray(casadi).ravel())
    for table, back in zip(tables, unflat(vector, [(2, 3), (2,)]), strict=True):
        np.testing.assert_array_equal(back, table)


class Interrupted:
    """A solver in which Ctrl-C is pressed; like CasADi's it returns all the same."""

    def __call__(self, **_):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return {"x": [0.0]}

    def stats(self):
        return {"success": False, "return_status": "Invalid_Number_Detected"}


def test_ctrl_c_within_a_run_is_not_lost():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # `&` has it ignored
    none = np.zeros(0)
    try:
        with pytest.raises(KeyboardInterrupt):
            Program(Interrupted())(np.zeros(1), none, (none, none), (none, none))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
