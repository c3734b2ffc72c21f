"""The planner contract as a function that checks your own planner, in a test or a notebook.

    from trajopt.planners.testing import check_planner

    check_planner(MyPlanner())

It prints what it checked, and raises where the contract is not kept.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from dataclasses import fields
from typing import Any

import cloudpickle
import numpy as np

from trajopt.core.exceptions import InvalidInput, InvalidTrajectory, TrajoptError
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.judging.verification import verify
from trajopt.planners.planner import Planner, Relation, adapted, check_visible, raised

_SEEDS = (0, 7)
_ROUNDING_RTOL = 1e-12  # of a duration, where sums are rounded in another order
_BEATEN_RTOL = 1e-6  # relative to the optimum: more than rounding


class ContractError(TrajoptError, AssertionError):
    """A planner breaks the contract; the message says where."""


def check_planner(planner: object, problems: Iterable[Problem] | None = None) -> None:
    """Raise `ContractError` unless the planner keeps the contract on these problems.

    - It is a frozen dataclass that survives pickling, or a function.
    - It says how its answers relate to the optimum.
    - It answers every supported problem with a `Solution` whose trajectory the verifier can
      certify, unless the problem has limits that the planner does not know. The status is
      `relaxed` where its motion may break limits that it ignores on purpose.
    - Its history, if it has one, leads to its answer.
    - It gives the same answer for the same seed, alone or in a batch.
    - It never beats the optimum where that is known in closed form.

    What was checked is printed, a line a problem.

    Args:
        planner: The planner, as it would be compared.
        problems: By default small ones with edges (`examples`), with jerk and position limits too.

    Raises:
        ContractError: What is broken, and on which problem.
    """
    own = _checked_object(planner)
    print(f"{type(own).__name__}: options {own.options()}, survives pickling")
    for problem in problems or examples():
        try:
            found = _check_on(own, problem)
        except Exception as error:
            breach = str(error) if isinstance(error, ContractError) else raised(error)
            raise ContractError(f"on {problem.name!r}: {breach}") from error
        print(f"  {problem.name}: {found}")
    _check_never_beats(own)


def examples() -> list[Problem]:
    """Return small problems with edges; the first has the known optimum 2 s."""
    one = Limits([1.0], [2.0])
    two = Limits([1.0, 1.5], [2.0, 3.0])
    asymmetric = Limits([[-1, 2], 1.5], [[-2, 1], [-4, 3]])
    jerk = Limits([1.0], [2.0], jerk=[20.0])
    position = Limits([1.0], [2.0], position=[[0.0, 1.0]])
    twice = [[0, 0], [0.5, 0.2], [0.5, 0.2], [0.8, 0.7], [1, 1]]
    table: list[tuple[str, Any, Limits]] = [
        ("one joint", [[0.0], [0.4], [1.0], [1.5]], one),
        ("reversal", [[0, 0], [1, -0.5], [0.3, -1], [0.5, 0]], two),
        ("a joint that rests", [[0, 0.2], [0.4, 0.2], [1, 0.2], [1.2, 0.2]], two),
        ("a waypoint twice", twice, two),
        ("two waypoints", [[0, 0], [1, 1]], two),
        ("asymmetric limits", [[0, 0], [0.5, -0.1], [1, 0.4], [0.2, 0.8]], asymmetric),
        ("jerk limits", [[0], [1], [0.3]], jerk),
        ("position limits", [[0], [1], [0.4]], position),
    ]
    return [Problem(waypoints, limits, name) for name, waypoints, limits in table]


def _checked_object(planner: object) -> Planner:
    try:
        own = adapted(planner)
        check_visible(own)
        for field in fields(own):  # type: ignore[arg-type]
            has_value = hasattr(own, field.name)
            _require(has_value, f"option {field.name} has no value")
    except InvalidInput as error:
        raise ContractError(str(error)) from None
    try:
        copy = pickle.loads(cloudpickle.dumps(planner))
    except Exception as error:
        raise ContractError(f"it does not survive pickling: {error}") from error
    same = adapted(copy).options() == own.options()
    _require(same, "its options do not survive pickling")
    return own


def _check_on(planner: Planner, problem: Problem) -> str:
    """Check one problem, and return in words what came out."""
    relation = planner.relation(problem)
    _require(isinstance(relation, Relation), "relation is not a Relation")
    reason = planner.unsupported(problem)
    is_reason = isinstance(reason, str) and reason != ""
    _require(reason is None or is_reason, "unsupported is neither None nor a reason")
    if reason is not None:
        return f"unsupported: {reason}"
    solutions = [planner.solve(problem, seed=seed) for seed in _SEEDS]
    again = solutions[-1]
    if planner.stochastic:
        again = planner.solve(problem, seed=_SEEDS[0])
    for solution in (*solutions, again):
        _require(isinstance(solution, Solution), "solve returns no Solution")
    between = "between two calls: set `stochastic = True` if the seed matters"
    if planner.stochastic:
        between = "for the same seed"
    _require(_equal(solutions[0], again), f"solve differs {between}")
    unknown = planner.unknown(problem)
    verdict = ""
    for solution in reversed(solutions):
        keeps_word = solution.status is not Status.RELAXED or relation is Relation.RELAXATION
        _require(keeps_word, "relaxed, which is not what its relation says")
        verdict = _check_solution(solution, problem, excused=bool(unknown))
    if planner.batched:
        together = planner.solve_batch(problem, list(_SEEDS))
        complete = len(together) == len(solutions)
        _require(complete, "solve_batch returns another number of solutions")
        _require(all(map(_equal, solutions, together)), "solve_batch differs from solve")
    if planner.takes_many:
        many = planner.solve_many([problem] * len(_SEEDS), list(_SEEDS))
        complete = len(many) == len(solutions)
        _require(complete, "solve_many returns another number of solutions")
        _require(all(map(_same_answer, solutions, many)), "solve_many differs from solve")
    if unknown:
        return f"{verdict} (it does not know {' and '.join(unknown)} limits)"
    return verdict


def _check_solution(solution: Solution, problem: Problem, excused: bool) -> str:
    """Return the verdict; a planner that does not know a limit is `excused` from flaws."""
    status = solution.status
    flaw = solution.history_flaw
    _require(not flaw, f"history: {flaw}")
    if solution.trajectory is None and status in (Status.SOLVED, Status.RELAXED):
        raise ContractError(f"{status} without a trajectory")
    if solution.trajectory is None or status is not Status.SOLVED:
        _require(bool(solution.message), f"{status} without a message")
        return f"{status}: {solution.message}"
    try:
        certificate = verify(problem, solution.trajectory)
    except InvalidTrajectory as error:
        raise ContractError(f"invalid: {error}") from error
    flaws = "; ".join(certificate.flaws)
    _require(certificate.valid or excused, f"invalid: {flaws}")
    if not certificate.valid:
        return f"beyond mending: {flaws}"
    claimed = "as claimed"
    if not certificate.feasible:
        claimed = f"claimed {certificate.duration:.6g} s"
    return f"certified {certificate.certified_duration:.6g} s, {claimed}"


def _check_never_beats(planner: Planner) -> None:
    problem = examples()[0]
    optimum = 2.0  # rest to rest over 1.5 rad at 1 rad/s and 2 rad/s²: 1.5/1 + 1/2
    if planner.relation(problem) is Relation.RELAXATION:
        return
    trajectory = planner.solve(problem).trajectory
    if trajectory is None:
        return
    certified = verify(problem, trajectory).certified_duration
    if certified is not None and certified < optimum * (1 - _BEATEN_RTOL):
        raise ContractError(
            f"certified {certified} s where the optimum is {optimum} s: a bug in the verifier"
        )


def _equal(one: Solution, other: Solution) -> bool:
    """Return whether both trajectories have the same bits."""
    a = one.trajectory
    b = other.trajectory
    if a is None or b is None:
        return one.status is other.status and a is b
    parts = [part.name for part in fields(a)]
    return all(np.array_equal(getattr(a, part), getattr(b, part)) for part in parts)


def _same_answer(one: Solution, other: Solution) -> bool:
    """Return whether status and duration are the same, the duration up to rounding."""
    a = one.trajectory
    b = other.trajectory
    if one.status is not other.status or a is None or b is None:
        return one.status is other.status and a is b
    return abs(a.duration - b.duration) <= _ROUNDING_RTOL * a.duration


def _require(condition: bool, breach: str) -> None:
    if not condition:
        raise ContractError(breach)
