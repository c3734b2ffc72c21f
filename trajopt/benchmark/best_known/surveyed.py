"""Combine the references' results with a problem's record: the better of both.

known = with_record(survey(problem))
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import BETTER_RTOL, Record
from trajopt.benchmark.store.proofs import proved
from trajopt.core.exceptions import TrajoptError
from trajopt.explain.verdicts import Known
from trajopt.judging.verification import certified


def with_record(known: Known, where: Path | None = None) -> Known:
    """Return the results with the record's motion and bound where they are better by over 1e-6.

    The recorded motion is verified now, and the recorded bound is what its proof proves now.

    Args:
        known: what was computed.
        where: folder of records; by default the one that comes with this package.
    """
    record = records.find(known.problem, where)
    if record is None:
        return known
    return _with_bound(_with_motion(known, record), record)


def _with_motion(known: Known, record: Record) -> Known:
    computed = inf if known.best is None else known.best
    if record.duration >= computed * (1 - BETTER_RTOL):
        return known
    trajectory = certified(known.problem, record.trajectory)
    if trajectory is None or trajectory.duration >= computed * (1 - BETTER_RTOL):
        return known
    return replace(
        known, best=trajectory.duration, best_by=f"recorded: {record.motion}", trajectory=trajectory
    )


def _with_bound(known: Known, record: Record) -> Known:
    threshold = known.lower_bound * (1 + BETTER_RTOL)
    if record.lower_bound <= threshold:
        return known
    try:
        bound = proved(record.trial)
    except TrajoptError:
        return known  # it proves nothing, or what checks it is not installed
    if bound <= threshold:
        return known
    return replace(known, lower_bound=bound, bound_by=f"recorded: {record.bound}, checked again")
