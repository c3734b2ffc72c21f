"""The best 3-5-3 spline with shared times: its segment times, and a proof that none is briefer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound.ratio_boxes import RatioProof, Ratios, start_instants
from baselines.spline353_nlp import MovingSpline, Spline353NLP, initial_guesses
from trajopt.core.problem import Problem

Array = NDArray[np.float64]

# The distance is reached by steps of this factor, so that a time limit leaves a bound.
_STEP = 10.0
_WIDEST = 1.0


class Proved(NamedTuple):
    """Segment times (s) of the best spline known, and what proves how much briefer others can be.

    There is no proof where a segment is so short beside the others that rounding decides.
    """

    times: Array
    proof: RatioProof | None


def prove(problem: Problem, within: float, deadline: float) -> Proved:
    """Search until no spline is briefer than the best one known by more than a given share.

    Args:
        problem: With four waypoints that differ from their neighbours, and some spline that keeps
            the position limits.
        within: Relative distance of both bounds at which to stop.
        deadline: Of `time.perf_counter`; the proof of a wider distance stands when it has passed.
    """
    spline = MovingSpline(problem)
    times = _first_times(problem, spline)
    proof = None
    reached = _WIDEST
    while reached > within:
        step = max(within, reached / _STEP)
        ratios = Ratios(spline, times.sum() / (1 + step))
        outcome = ratios.search(start_instants(spline, times), deadline)
        if outcome.times is not None:
            times = outcome.times
        elif outcome.proof is not None:
            proof = outcome.proof
            reached = step
        else:
            break
    return Proved(times, proof)


def _first_times(problem: Problem, spline: MovingSpline) -> Array:
    """Segment times of a good spline, s: a local optimum, or the best of a grid without one."""
    if problem.displacements.any(axis=1).all():
        answer = Spline353NLP().solve(problem).trajectory
        if answer is not None:
            return np.diff(answer.waypoint_times)
    return initial_guesses(spline, 1)[0]
