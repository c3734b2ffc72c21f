"""The planner contract as a function: run it on your own planner, in a test or a notebook.

    from trajopt.planners.testing import check_planner

    check_planner(MyPlanner())

It prints what it checked, and raises where the contract is not kept.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from dataclasses import fields

import cloudpickle
import numpy as np

from trajopt.core.exceptions import InvalidInput, InvalidTrajectory, TrajoptError
from trajopt.core.problem import LIMIT_NAMES, Limits, Problem
from trajopt.core.solution import Solution, Status
from trajopt.judging.verification import verify
from trajopt.planners.planner import Planner, Relation, adapted, check_visible, is_solve
from trajopt.planners.registry import options

_SEEDS = (0, 7)
_BEATEN_RTOL = 1e-6  # below the optimum by more than this: no rounding


class ContractError(TrajoptError, AssertionError):
    """What a planner does that the contract forbids; the message says where."""


def check_planner(planner: object, problems: Iterable[Problem] | None = None) -> None:
    """Raise `ContractError` unless the planner keeps the contract on these problems.

    It must be a frozen dataclass that survives pickling, or a function; say how it relates to the
    optimum; answer every supported problem with a `Solution` whose trajectory the verifier can
    certify (unless the problem has limits that the planner does not know), or with status `relaxed`
    where its motion may break limits that it ignores on purpose;
    keep a history, if any, that leads to its answer; give the same answer for the same seed, alone
    or in a batch; and never beat the optimum where
    that is known in closed form. What was checked is printed, a line a problem.

    Args:
        planner: the planner, as it would be compared.
        problems: by default small ones with edges (`examples`), jerk and position limits among
            them.

    Raises:
        ContractError: what is broken, and on which problem.
    """
    own = adapted(planner) if is_solve(planner) else planner
    _check_object(own)
    own = adapted(own)
    name = type(own.implementation).__name__
    print(f"{name}: options {own.options()}, survives pickling")
    for problem in problems or examples():
        found = _check_on(own, problem)
        print(f"  {problem.name}: {found}")
    optimum = 2.0  # rest to rest over 1.5 rad at 1 rad/s and 2 rad/s²: 1.5/1 + 1/2
    _check_never_beats(own, examples()[0], optimum)


def examples() -> list[Problem]:
    """Small problems with edges; the first has the known optimum 2 s."""
    one = Limits(velocity=[1.0], acceleration=[2.0])
    two = Limits(velocity=[1.0, 1.5], acceleration=[2.0, 3.0])
    asymmetric = Limits(
        velocity=[[-1, 2], 1.5],
        acceleration=[[-2, 1], [-4, 3]],
    )
    return [
        Problem(
            [[0.0], [0.4], [1.0], [1.5]],
            one,
            name="one joint",
        ),
        Problem(
            [[0, 0], [1, -0.5], [0.3, -1], [0.5, 0]],
            two,
            name="reversal",
        ),
        Problem(
            [[0, 0.2], [0.4, 0.2], [1, 0.2], [1.2, 0.2]],
            two,
            name="a joint that rests",
        ),
        Problem(
            [[0, 0], [0.5, 0.2], [0.5, 0.2], [0.8, 0.7], [1, 1]],
            two,
            name="a waypoint twice",
        ),
        Problem(
            [[0, 0], [1, 1]],
            two,
            name="two waypoints",
        ),
        Problem(
            [[0, 0], [0.5, -0.1], [1, 0.4], [0.2, 0.8]],
            asymmetric,
            name="asymmetric limits",
        ),
        Problem(
            [[0], [1], [0.3]],
            Limits([1.0], [2.0], jerk=[20.0]),
            name="jerk limits",
        ),
        Problem(
            [[0], [1], [0.4]],
            Limits([1.0], [2.0], position=[[0.0, 1.0]]),
            name="position limits",
        ),
    ]


def _check_object(planner: object) -> None:
    parameters = getattr(type(planner), "__dataclass_params__", None)
    if parameters is None:
        raise ContractError("it is not a dataclass")
    _require(parameters.frozen, "its dataclass is not frozen")
    _require(hasattr(planner, "solve"), "it lacks solve")
    for field in fields(planner):  # type: ignore[arg-type]
        has_value = hasattr(planner, field.name)
        _require(has_value, f"option {field.name} has no value")
    try:
        check_visible(adapted(planner))
    except InvalidInput as error:
        raise ContractError(str(error)) from None
    try:
        copy = pickle.loads(cloudpickle.dumps(planner))
    except Exception as error:
        raise ContractError(f"it does not survive pickling: {error}") from error
    _require(options(copy) == options(planner), "its options do not survive pickling")


def _check_on(planner: Planner, problem: Problem) -> str:
    """What was found, in words."""
    where = f" on {problem.name!r}"
    relation = planner.relation(problem)
    is_relation = isinstance(relation, Relation)
    _require(is_relation, f"relation{where} is not a Relation")
    reason = planner.unsupported(problem)
    says_why = isinstance(reason, str) and bool(reason)
    as_agreed = reason is None or says_why
    _require(as_agreed, f"unsupported{where} is neither None nor a reason")
    if reason is not None:
        return f"unsupported: {reason}"
    solutions = [planner.solve(problem, seed=seed) for seed in _SEEDS]
    answers = list(solutions)
    if planner.stochastic:
        answers.append(planner.solve(problem, seed=_SEEDS[0]))
    for solution in answers:
        is_solution = isinstance(solution, Solution)
        _require(is_solution, f"solve{where} returns no Solution")
    repeated = _same(answers[0], answers[-1])
    if planner.stochastic:
        _require(repeated, f"solve{where} differs for the same seed")
    _require(repeated, f"solve{where} differs between two calls")
    unknown = [kind for kind in LIMIT_NAMES if problem.has(kind) and kind not in planner.knows]
    excused = bool(unknown)
    for solution in solutions:
        is_relaxed = solution.status is Status.RELAXED
        as_said = relation is Relation.RELAXATION or not is_relaxed
        _require(as_said, f"relaxed{where}, which is not what its relation says")
    found = [_check_solution(solution, problem, where, excused) for solution in solutions]
    if planner.batched:
        _check_batch(planner, problem, solutions, where)
    if unknown:
        return f"{found[0]} (it does not know {' and '.join(unknown)} limits)"
    return found[0]


def _check_batch(
    planner: Planner,
    problem: Problem,
    alone: list[Solution],
    where: str,
) -> None:
    together = planner.solve_batch(problem, list(_SEEDS))
    complete = len(together) == len(_SEEDS)
    _require(complete, f"solve_batch{where} returns another number of solutions")
    for one, other in zip(alone, together, strict=True):
        alike = _same(one, other)
        _require(alike, f"solve_batch{where} differs from solve")


def _check_solution(
    solution: Solution,
    problem: Problem,
    where: str,
    excused: bool,
) -> str:
    """What the verifier says; a planner that cannot keep the limits is excused from flaws."""
    status = solution.status
    flaw = solution.history_flaw
    _require(not flaw, f"history{where}: {flaw}")
    if solution.trajectory is None and status in (Status.SOLVED, Status.RELAXED):
        raise ContractError(f"{status}{where} without a trajectory")
    if solution.trajectory is None or status is not Status.SOLVED:
        _require(bool(solution.message), f"{status}{where} without a message")
        return f"{status}: {solution.message}"
    try:
        certificate = verify(problem, solution.trajectory)
    except InvalidTrajectory as error:
        raise ContractError(f"invalid{where}: {error}") from error
    flaws = "; ".join(certificate.flaws)
    _require(certificate.valid or excused, f"invalid{where}: {flaws}")
    if not certificate.valid:
        return f"beyond mending: {flaws}"
    claimed = "as claimed"
    if not certificate.feasible:
        claimed = f"claimed {certificate.duration:.6g} s"
    return f"certified {certificate.certified_duration:.6g} s, {claimed}"


def _check_never_beats(
    planner: Planner,
    problem: Problem,
    optimum: float,
) -> None:
    if planner.unsupported(problem) is not None:
        return
    if planner.relation(problem) is Relation.RELAXATION:
        return
    trajectory = planner.solve(problem).trajectory
    if trajectory is None:
        return
    certified = verify(problem, trajectory).certified_duration
    shortest = optimum * (1 - _BEATEN_RTOL)
    if certified is not None and certified < shortest:
        raise ContractError(
            f"certified {certified} s where the optimum is {optimum} s: a bug in the verifier"
        )


def _same(one: Solution, other: Solution) -> bool:
    """The same bits, whatever the time they took."""
    a = one.trajectory
    b = other.trajectory
    if a is None or b is None:
        return one.status is other.status and a is b
    return (
        np.array_equal(a.breaks, b.breaks)
        and np.array_equal(a.coefficients, b.coefficients)
        and np.array_equal(a.waypoint_times, b.waypoint_times)
    )


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise ContractError(what)
