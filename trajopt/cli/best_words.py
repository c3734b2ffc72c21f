"""Describe the answer of the best planner in words."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, log10

import numpy as np

from trajopt.benchmark.best_known.records import BETTER_RTOL
from trajopt.best_planner import OPTIMUM_RTOL, QUICK, Best
from trajopt.core.limits import KINDS
from trajopt.explain.references import BEST_KNOWN, OPTIMUM_WITH_POSITION, THROUGH_WAYPOINTS

MIN_SAVING_PERCENT = 0.05  # percent of the duration; smaller savings are not mentioned
ROUNDING_PERCENT = 1e-7  # percent of the duration; a smaller distance is rounding
PROVED_DIGITS = 4  # digits of a bound that is further than OPTIMUM_RTOL below the answer

ADD_JERK_LIMITS = (
    "without them acceleration jumps. Add jerk limits (rad/s³) to the problem file, or max_jerk "
    "to joint_limits.yaml."
)


def sentences(found: Best) -> Iterator[str]:
    """Describe the planner, the quality of its answer, its saving, and missing jerk limits."""
    problem = found.trial.problem
    duration = found.trial.certified_duration
    if duration is None:
        return
    said = [_planner(found), _quality(found, duration), _saving(found, duration)]
    yield " ".join(filter(None, said))
    if not problem.has("jerk"):
        yield f"A real controller wants jerk limits too: {ADD_JERK_LIMITS}"


def _planner(found: Best) -> str:
    """Describe the planner."""
    trial = found.trial
    name = trial.planner
    others = [key for key in found.left_out if key in trial.problem.limits.others]
    if others:
        ignored = " and ".join(KINDS[key].name() for key in others)
        mended = "which keeps them" if trial.feasible else f"{trial.dilation:.6g} times slower"
        return f"{name} does not know {ignored} limits: this is its answer, {mended}."
    if name == BEST_KNOWN and found.record is not None:
        return (
            f"This is the best known motion, {found.record.motion}, verified anew "
            f"(`--planner {OPTIMUM_WITH_POSITION}` plans one)."
        )
    if found.stopped is not None and name == QUICK:
        return (
            f"{OPTIMUM_WITH_POSITION} was stopped after {found.stopped:g} s (`--timeout`): this is "
            f"the motion of {QUICK}, the fastest on a spline."
        )
    if name == THROUGH_WAYPOINTS:
        return f"{name} answers where no reference planner does."
    kinds = [KINDS[key].name() for key in trial.problem.limits.kinds]
    limits = f"{', '.join(kinds[:-1])} and {kinds[-1]}"
    return f"{name} is the best planner under {limits} limits."


def _saving(found: Best, duration: float) -> str:
    """Compare the answer with stopping at every waypoint, where that keeps every limit."""
    if found.stopping is None:
        return ""
    saved = 100 * (1 - duration / found.stopping)
    if saved < MIN_SAVING_PERCENT:
        return "Stopping at every waypoint takes as long."
    return f"Stopping at every waypoint takes {found.stopping:.4f} s: this saves {saved:.1f} %."


def _quality(found: Best, duration: float) -> str:
    """Describe the answer's distance from the optimum by a proved bound alone.

    Whether starts agree tells nothing: on some problems all of a dozen end at the same wrong time.
    """
    proved_within = duration / found.proved - 1 if found.proved else np.inf
    if proved_within < OPTIMUM_RTOL:
        percent = 100 * proved_within
        within = f" within {percent:.1g} %" if percent > ROUNDING_PERCENT else ""
        return f"Its answer is the optimum, proved{within}."
    less = 100 * (1 - found.proved / duration)
    known = "It is certified; no proof that it is fastest"
    if found.relaxed is not None:
        above = duration / found.relaxed - 1
        if above >= OPTIMUM_RTOL:
            best = f"{found.relaxed:.4f} s, the best known under fewer limits"
            known = f"It is {100 * above:.2f} % above {best}"
    record = found.record
    if record is not None and duration > record.duration * (1 + BETTER_RTOL):
        above = 100 * (duration / record.duration - 1)
        best = f"the best known, {record.motion}, {record.duration:.4f} s"
        known = f"It is {above:.2g} % above {best}"
    return (
        f"{known}. Proved: every motion takes at least {_least(found.proved)} s, {less:.3g} % less "
        "(`trajopt prove` proves more)."
    )


def _least(seconds: float) -> str:
    """Round a lower bound down to `PROVED_DIGITS` digits: the rounded one is proved too."""
    if not seconds:
        return "0"
    unit = 10.0 ** (floor(log10(seconds)) + 1 - PROVED_DIGITS)
    return f"{floor(seconds / unit) * unit:.{PROVED_DIGITS}g}"
