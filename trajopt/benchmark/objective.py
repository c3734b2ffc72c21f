"""`trajopt.objective`: the fitness of a spline's segment times, for any optimiser."""

from __future__ import annotations

from pathlib import Path

from trajopt.benchmark.suites import catalogue
from trajopt.core.problem import Problem
from trajopt.planners.objective import CLOSED_FORM, Fitness, Objective


def objective(
    problem: Problem | str | Path, shape: str = CLOSED_FORM, fitness: Fitness = "penalty"
) -> Objective:
    """Return the timing of a spline through a problem's waypoints as a function to minimise.

    It is what `pso`, `ssa` and `issa` minimise, in the same box. One candidate of the 3-5-3 takes
    about 10 µs, one of many about 4 (six joints); up to 80 µs where it may leave position limits.
    Other shapes take 0.6 ms and 16 µs.

    Args:
        problem: A problem, its built-in name, or its file.
        shape: The degrees of the spline's pieces: `3-5-3`, for four waypoints; one degree for all
            pieces (`5`); one for each (`4-3-4`), or three of which the middle one is repeated. If
            such a spline is not determined by its times, the smoothest one is taken.
        fitness: `penalty`: the duration within the limits, s. If a limit is broken it is more than
            any duration in the box and grows with the summed relative violation (Deb's rule).
            `scaled`: the duration after dilation to the limits, s.

    Returns:
        A function of times in s: `(variables,)` to a number, `(n, variables)` to `(n,)`. It has
        `low` and `high` `(variables,)`, `variables`, and counts `evaluations`. Its method
        `trajectory` returns a candidate's motion, which `trajopt.judge` judges.

    Raises:
        InvalidInput: The shape does not fit this problem, or no such fitness exists.
        UnknownName: There is no such problem.
    """
    return Objective(catalogue.given(problem), shape, fitness)
