"""Many motions judged at once, against one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk.planner import ExactJerk
from trajopt import InvalidTrajectory, Limits, Problem, Trajectory, verify
from trajopt.judging import together
from trajopt.judging.certificate import Certificate
from trajopt.judging.together import verify_many

JOINTS = 3


def _problems(count: int, waypoints: int = 4, **limits: object) -> list[Problem]:
    rng = np.random.default_rng(5)
    sizes = Limits(rng.uniform(1, 2, JOINTS), rng.uniform(2, 4, JOINTS), **limits)
    return [Problem(rng.normal(size=(waypoints, JOINTS)), sizes) for _ in range(count)]


def _motions(problems: Sequence[Problem]) -> list[Trajectory]:
    found = []
    for solution in Exact().solve_many(problems):
        assert solution.trajectory is not None
        found.append(solution.trajectory)
    return found


def _bits(own: Certificate) -> object:
    judged = own.judged
    assert judged is not None
    arrays = (judged.breaks, judged.coefficients, judged.waypoint_times, judged.lengths)
    return repr(own.as_dict()), own.flaws, own.duration, [array.tobytes() for array in arrays]


def _same(problems: Sequence[Problem], motions: Sequence[Trajectory]) -> bool:
    alone = [verify(*pair) for pair in zip(problems, motions, strict=True)]
    return list(map(_bits, verify_many(problems, motions))) == list(map(_bits, alone))


def _in_tables(problems: Sequence[Problem], motions: Sequence[Trajectory]) -> int:
    """How many motions are judged as rows of a table."""
    pairs = list(zip(problems, motions, strict=True))
    parts = together._parts(pairs)
    tolerance = together.Tolerance()
    tables = (together._Table([pairs[own] for own in part], tolerance) for part in parts)
    return sum(len(table.certificates()) for table in tables)


def test_verdicts_are_those_of_one_by_one_to_the_bit() -> None:
    problems = _problems(30)
    motions = _motions(problems)
    assert _in_tables(problems, motions) > 20
    assert _same(problems, motions)


def test_with_jerk_limits_too() -> None:
    problems = _problems(6, 3, jerk=[20.0] * JOINTS)
    motions = [own.trajectory for own in ExactJerk().solve_many(problems)]
    assert None not in motions
    assert _same(problems, motions)  # type: ignore[arg-type]


def test_dilated_shaken_and_broken_motions_among_them() -> None:
    problems = _problems(12, 3)
    motions = _motions(problems)
    rng = np.random.default_rng(1)
    changed = [
        motions[0].dilated(0.9),
        motions[1].dilated(1.7),
        *(
            replace(
                own, coefficients=own.coefficients + size * rng.normal(size=own.coefficients.shape)
            )
            for own, size in zip(motions[2:6], (1e-17, 1e-12, 1e-8, 1e-3), strict=True)
        ),
        replace(motions[6], waypoint_times=motions[6].waypoint_times * [1.0, 0.999, 1.0]),
        replace(motions[7], waypoint_times=motions[7].waypoint_times[[0, 2, 2]]),
        *motions[8:],
    ]
    assert _same(problems, changed)
    found = verify_many(problems, changed)
    assert found[0].dilation > 1.1
    assert not found[5].valid


def test_what_is_unusual_is_judged_alone() -> None:
    plain = _problems(5)
    motions = _motions(plain)
    first = plain[0]
    still = replace(first, waypoints=first.waypoints[[0, 1, 1, 2, 3]])
    times = motions[0].waypoint_times
    problems = [
        *plain,
        first.without(),
        replace(first, limits=Limits([2.0] * JOINTS, [4.0] * JOINTS, None, [[-9.0, 9.0]] * JOINTS)),
        replace(first, demands={"least_duration": 1e3}),
        still,
    ]
    motions += [motions[0]] * 3 + [replace(motions[0], waypoint_times=times[[0, 1, 1, 2, 3]])]
    assert _same(problems, motions)
    assert _in_tables(problems, motions) == 6


def test_sizes_are_checked_as_alone() -> None:
    problems = _problems(5)
    motions = _motions(problems)
    motions[3] = replace(motions[3], waypoint_times=motions[3].waypoint_times[[0, 3]])
    with pytest.raises(InvalidTrajectory, match="2 waypoint times; the problem has 4 waypoints"):
        verify_many(problems, motions)
    assert verify_many([], []) == []
