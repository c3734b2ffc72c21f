"""The best 3-5-3 spline with shared times: its segment times, and a proof that none is briefer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound.ratio_boxes import RatioProof, Ratios, start_instants
from baselines.spline353_nlp import Spline, Spline353NLP
from trajopt.core.problem import Problem
from trajopt.planners import spline353
from trajopt.planners.rest_to_rest import stop_times

Array = NDArray[np.float64]

# The distance is reached by steps of this factor, so that a time limit leaves a bound.
_STEP = 10.0
_WIDEST = 1.0
# Logarithms of ratios of segment times, for a first spline.
_LOG_RATIOS = np.linspace(-10.0, 10.0, 61)
# Time of a segment without displacement, relative to the longest one.
_NO_TIME = 1e-12


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
    spline = Spline(problem)
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


def _first_times(problem: Problem, spline: Spline) -> Array:
    """Segment times of a good spline, s: IPOPT's, or the best of a grid where it has none."""
    moves = np.asarray(problem.displacements.any(axis=1))
    if moves.all():
        answer = Spline353NLP().solve(problem).trajectory
        if answer is not None:
            return np.diff(answer.waypoint_times)
    without = np.log([_NO_TIME])
    outer = [_LOG_RATIOS if moves[k] else without for k in (0, 2)]
    first, last = np.meshgrid(*outer)
    logarithms = np.stack([first, np.zeros_like(first), last], axis=-1)
    times = np.exp(logarithms).reshape(-1, 3)
    own_times = times[:, None, :]
    dilation = spline353.dilation(spline.displacements, own_times, spline.limits)
    times *= dilation[:, None]
    kept = np.equal(spline.excesses(times), 0)
    if spline.room is not None and not kept.any():
        longest = float(stop_times(problem).max())
        displacements = spline.displacements
        return spline353.keeping_times(displacements, spline.limits, spline.room, unit=longest)
    times = times[kept]
    return np.asarray(times[times.sum(axis=1).argmin()])
