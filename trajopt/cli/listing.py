"""`trajopt list`: planners with what they know, built-in problems, and robots."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Literal

from trajopt.benchmark.suites import catalogue, robots
from trajopt.cli import console
from trajopt.cli.parameters import Json
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import LIMIT_NAMES, LimitName, Limits, Problem
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.registry import Entry, entries

_OPTIONAL_LIMITS: tuple[LimitName, ...] = ("jerk", "position")


def list_(*, json: Json = False) -> int:
    """List planners, with their options and defaults, built-in problems and robots."""
    planners = [described(entry) for entry in entries().values()]
    problems = [_problem(name) for name in catalogue.problem_files()]
    arms = [_arm(name) for name in robots.arm_files()]
    if json:
        console.print_json({"planners": planners, "problems": problems, "robots": arms})
        return 0
    console.OUT.print(_planner_table(planners))
    console.paragraph()
    console.OUT.print(_problem_table(problems))
    console.paragraph()
    console.OUT.print(_arm_table(arms))
    return 0


def described(entry: Entry) -> dict[str, Any]:
    """A planner's name, one line, options, limits, and what is missing.

    Limits that it `knows` it plans for. Those that it `ignores` it ignores on purpose: its answer
    is relaxed then. Problems with those that it `refuses` it does not solve. Any other it may
    break, which the verifier then says.
    """
    missing = entry.missing()
    row: dict[str, Any] = {
        "name": entry.name,
        "description": "",
        "options": {},
        "knows": [],
        "ignores": [],
        "refuses": [],
    }
    try:
        planner = entry.load()
        row["description"] = planner.description
        row["options"] = planner.options()
        row["knows"] = list(planner.knows)
        for limit in _OPTIONAL_LIMITS:
            fate = _fate(planner, limit)
            if fate is not None:
                row[fate].append(limit)
    except TrajoptError:
        pass  # `missing` says why
    row["available"] = missing is None
    row["missing"] = missing
    return row


def _fate(planner: Planner, limit: LimitName) -> Literal["ignores", "refuses"] | None:
    """What a planner does with a kind of limit that it cannot keep; None for others."""
    problem = _limited_by(limit)
    try:
        if planner.unsupported(problem) is not None:
            return "refuses"
        if planner.relation(problem) is Relation.RELAXATION:
            return "ignores"
    except Exception:  # a stranger's planner: its trials will say so
        return None
    return None


@cache
def _limited_by(name: LimitName) -> Problem:
    """One joint through four waypoints, as many as a 3-5-3 spline takes."""
    limits = Limits([1.0], [1.0], jerk=[1.0], position=[10.0])
    problem = Problem([[0.0], [1.0], [2.0], [3.0]], limits)
    other: LimitName = "position" if name == "jerk" else "jerk"
    return problem.without(other)


def _problem(name: str) -> dict[str, Any]:
    """A built-in problem's file, size, limits, and where it comes from."""
    problem = catalogue.load(name)
    return {
        "name": name,
        "file": str(catalogue.find(name)),
        "joints": problem.joints,
        "waypoints": len(problem.waypoints),
        "limits": [limit for limit in LIMIT_NAMES if problem.has(limit)],
        "source": problem.source,
    }


def _arm(name: str) -> dict[str, Any]:
    """A built-in robot's joints, kinds of limits, and how well each kind is known."""
    arm = robots.arm(name)
    return {
        "name": name,
        "description": arm.description,
        "joint_names": list(arm.joint_names),
        "limits": {kind: origin.status for kind, origin in arm.origins.items()},
        "falling_velocity": bool(arm.falling_velocity),
    }


def _planner_table(planners: Sequence[dict[str, Any]]) -> Any:
    table = console.table("planner", "what it is, its options, and the limits it knows")
    for planner in planners:
        lines = [console.markup(planner["description"])]
        options = planner["options"]
        settings = ", ".join(f"{key}={value}" for key, value in options.items())
        if settings:
            lines.append(f"[dim]{console.markup(settings)}[/dim]")
        if planner["available"]:
            lines.append(f"[dim]{_limits_in_words(planner)}[/dim]")
        else:
            missing = console.markup(planner["missing"])
            lines.append(f"[red]not available: {missing}[/red]")
        name = console.markup(planner["name"])
        table.add_row(f"[bold]{name}[/bold]", "\n".join(lines))
    return table


def _limits_in_words(planner: dict[str, Any]) -> str:
    known = ", ".join(planner["knows"])
    sentences = [f"knows {known or 'no'} limits"]
    if planner["ignores"]:
        ignored = " and ".join(planner["ignores"])
        sentences.append(f"ignores {ignored} limits: relaxed then")
    if planner["refuses"]:
        refused = " and ".join(planner["refuses"])
        sentences.append(f"refuses {refused} limits")
    return "; ".join(sentences)


def _problem_table(problems: Sequence[dict[str, Any]]) -> Any:
    table = console.table("problem", "joints", "waypoints", "limits")
    for problem in problems:
        name = console.markup(problem["name"])
        table.add_row(
            f"[bold]{name}[/bold]",
            str(problem["joints"]),
            str(problem["waypoints"]),
            ", ".join(problem["limits"]),
        )
    return table


def _arm_table(arms: Sequence[dict[str, Any]]) -> Any:
    table = console.table("robot", "joints", "limits, and how they are known")
    for arm in arms:
        origins = []
        for kind, status in arm["limits"].items():
            origins.append(f"{kind} ({status})")
        if arm["falling_velocity"]:
            origins.append("constant velocity limits; the arm allows less near its position limits")
        table.add_row(
            f"[bold]{console.markup(arm['name'])}[/bold]",
            str(len(arm["joint_names"])),
            ", ".join(origins),
        )
    return table
