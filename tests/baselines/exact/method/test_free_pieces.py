"""The second method: closed forms, and iterates that IPOPT does not call converged."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baselines.exact.acceleration.planner import Passing
from baselines.exact.jerk.motion import Reachable
from baselines.exact.method import free_pieces
from baselines.exact.method.free_pieces import minimised
from baselines.ipopt import Program, Run
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.judging.verification import keeps

WAYPOINTS = [[0.0], [1.0], [2.0]]


def duration(problem: Problem, *factors: float) -> float:
    """Return the duration that the second method finds, s; guesses are factors of stopping."""
    scaled = Reachable(problem) if problem.has("jerk") else Passing(problem)
    found = [minimised(scaled, factor * scaled.stop) for factor in factors or (1.0,)]
    return scaled.unit * min(own.times.sum() for own in found if own is not None)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (Limits([10], [0.5]), 4.0),  # 2 √(h/A): it speeds up and brakes
        (Limits([0.5], [1.0]), 4.5),  # h/V + V/A: and cruises
        (Limits([10], [10], [1.0]), 4.0),  # ∛(32 h/J)
    ],
)
def test_along_a_line_waypoints_cost_no_time(limits: Limits, expected: float) -> None:
    assert duration(Problem(WAYPOINTS, limits)) == pytest.approx(expected, rel=1e-8)


def test_states_in_motion_are_kept() -> None:
    """(2 V − u − w) / A and the cruise: it begins and ends at half its speed."""
    problem = Problem(WAYPOINTS, Limits([1.0], [1.0]), start_velocity=[0.5], end_velocity=[0.5])
    assert duration(problem) == pytest.approx(1.0 + (2.0 - 2 * 0.375), rel=1e-8)


def test_a_tolerance_shortens_the_way() -> None:
    """Out and back, turning 0.1 rad earlier: from 2 √(2 h/A) twice, at rest in the turn."""
    turn = Problem([[0.0], [1.0], [0.0]], Limits([10.0], [1.0]), tolerance=[0.1])
    # it speeds up over a quarter of the way and turns with full acceleration: 4 √(h/A)
    assert duration(turn, 1.0, 0.7) == pytest.approx(4 * np.sqrt(0.9), rel=1e-7)


class Unconverged(Program):
    """A program whose runs IPOPT does not call converged."""

    def __call__(self, *data: Any) -> Run:
        return replace(super().__call__(*data), success=False)


def test_an_iterate_that_has_not_converged_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its duration is known long before IPOPT's tolerances are met; the judge decides about it."""
    build = free_pieces._solver
    monkeypatch.setattr(free_pieces, "_solver", lambda *size: Unconverged(build(*size)._solver))
    assert duration(Problem(WAYPOINTS, Limits([10], [0.5]))) == pytest.approx(4.0, rel=1e-8)


class SecondDiverges(Program):
    """A program whose second run ends unconverged, at a motion that takes half as long again."""

    runs = 0

    def __call__(self, *data: Any) -> Run:
        run = super().__call__(*data)
        self.runs += 1
        if self.runs == 1:
            return run
        orders = np.repeat(
            [0, 0, 1, 2, 3], [2, 6, 6, 6, 6]
        )  # times, lengths, v, a, j of 2 × 3 pieces
        x = run.x.copy()
        x[: len(orders)] *= 1.5 ** np.where(np.arange(len(orders)) < 8, 1, -orders)
        return replace(run, x=x, success=False)


class Counted(Program):
    """A program that counts its runs; those from `idle` on do not converge."""

    runs, idle = 0, 99

    def __call__(self, *data: Any) -> Run:
        self.runs += 1
        run = super().__call__(*data)
        return replace(run, success=run.success and self.runs < self.idle)


@pytest.mark.parametrize(
    ("below", "idle", "runs"),
    [
        (np.inf, 99, 5),  # in four widths, the first one twice
        (3.9, 99, 1),  # a motion of 4 s is no use
        (np.inf, 2, 2),  # nor are tighter limits where the widest lead nowhere
    ],
)
def test_it_ends_where_more_runs_bring_nothing(
    below: float, idle: int, runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scaled = Passing(Problem(WAYPOINTS, Limits([10], [0.5])))
    program = Counted(free_pieces._solver(2, 1, free_pieces.PIECES[0])._solver)
    program.idle = idle
    monkeypatch.setattr(free_pieces, "_solver", lambda *_: program)
    minimised(scaled, scaled.stop, widened=True, below=below / scaled.unit)
    assert program.runs == runs


def test_a_converged_point_is_not_replaced_by_one_that_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A part of a motion that took 2.668 s took 3.109 s: the other point broke a limit."""
    build = free_pieces._solver
    monkeypatch.setattr(free_pieces, "_solver", lambda *size: SecondDiverges(build(*size)._solver))
    assert duration(Problem(WAYPOINTS, Limits([10], [0.5]))) == pytest.approx(4.0, rel=1e-6)


def test_where_only_one_motion_is_left_the_answer_keeps_its_limits_to_rounding() -> None:
    """A part of an optimal motion, cut at its controller's cycle: it took 0.831 s there.

    0.6 ms before the end the limits change, and the joint's states leave it no choice. IPOPT's own
    point breaks a limit by 1e-9.
    """
    limits = Limits(
        [[[-1.954533109443162, 1.954533109443162]], [[-1.6877714442051084, 1.6877714442051084]]],
        [[[-1.936421196519623, 1.936421196519623]], [[-2.4420567147211054, 2.4420567147211054]]],
        [[[-50.43908014830924, 50.43908014830924]], [[-29.811266412973943, 29.811266412973943]]],
    )
    problem = Problem(
        [[0.6930888978368754], [0.35136798219887455], [0.35081601519261424]],
        limits,
        end_velocity=[-0.059480125860686704],
        end_acceleration=[2.1784229307828],
    )
    scaled = Reachable(problem)
    _, (even, _), *_ = free_pieces.guesses(scaled)
    found = minimised(scaled, even)
    assert found is not None
    motion = free_pieces.motion(scaled, found)
    assert motion is not None
    assert keeps(problem, motion)
    assert motion.duration == pytest.approx(0.831, rel=1e-9)
