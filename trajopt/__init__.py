"""Judge minimum-time robot trajectory planners: run, verify exactly, compare, explain."""

from __future__ import annotations

TYPE_CHECKING = False  # as type checkers take it: `typing` loads while nobody hears Ctrl-C yet
if TYPE_CHECKING:
    from typing import Any

    from trajopt.benchmark.compare import compare as compare
    from trajopt.exceptions import InvalidInput as InvalidInput
    from trajopt.exceptions import InvalidTrajectory as InvalidTrajectory
    from trajopt.exceptions import MissingBackend as MissingBackend
    from trajopt.exceptions import StoreError as StoreError
    from trajopt.exceptions import TrajoptError as TrajoptError
    from trajopt.exceptions import UnitWarning as UnitWarning
    from trajopt.exceptions import UnknownName as UnknownName
    from trajopt.judgement import judge as judge
    from trajopt.planner import Planner as Planner
    from trajopt.planner import Relation as Relation
    from trajopt.problem import Limits as Limits
    from trajopt.problem import Problem as Problem
    from trajopt.solution import Solution as Solution
    from trajopt.solution import Status as Status
    from trajopt.trajectory import Trajectory as Trajectory
    from trajopt.verification import Certificate as Certificate
    from trajopt.verification import Tolerance as Tolerance
    from trajopt.verification import verify as verify

_MODULE = {
    "Certificate": "verification",
    "InvalidInput": "exceptions",
    "InvalidTrajectory": "exceptions",
    "Limits": "problem",
    "MissingBackend": "exceptions",
    "Planner": "planner",
    "Problem": "problem",
    "Relation": "planner",
    "Solution": "solution",
    "Status": "solution",
    "StoreError": "exceptions",
    "Tolerance": "verification",
    "Trajectory": "trajectory",
    "TrajoptError": "exceptions",
    "UnitWarning": "exceptions",
    "UnknownName": "exceptions",
    "compare": "benchmark.compare",
    "judge": "judgement",
    "verify": "verification",
}
__all__ = sorted(_MODULE)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that `trajopt --help` need not wait."""
    if name not in _MODULE:
        raise AttributeError(f"module 'trajopt' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(f"trajopt.{_MODULE[name]}")
    return getattr(module, name)


def __dir__() -> list[str]:
    return __all__
