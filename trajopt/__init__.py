"""Judge minimum-time robot trajectory planners: run, verify exactly, compare, explain."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trajopt.exceptions import InvalidInput as InvalidInput
    from trajopt.exceptions import InvalidTrajectory as InvalidTrajectory
    from trajopt.exceptions import MissingBackend as MissingBackend
    from trajopt.exceptions import StoreError as StoreError
    from trajopt.exceptions import TrajoptError as TrajoptError
    from trajopt.exceptions import UnknownName as UnknownName
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

_PUBLIC = {
    "exceptions": (
        "InvalidInput", "InvalidTrajectory", "MissingBackend", "StoreError", "TrajoptError",
        "UnknownName",
    ),
    "planner": ("Planner", "Relation"),
    "problem": ("Limits", "Problem"),
    "solution": ("Solution", "Status"),
    "trajectory": ("Trajectory",),
    "verification": ("Certificate", "Tolerance", "verify"),
}  # fmt: skip
_MODULE = {name: module for module, names in _PUBLIC.items() for name in names}
__all__ = sorted(_MODULE)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that `trajopt --help` need not wait."""
    if name not in _MODULE:
        raise AttributeError(f"module 'trajopt' has no attribute {name!r}")
    return getattr(import_module(f"trajopt.{_MODULE[name]}"), name)


def __dir__() -> list[str]:
    return __all__
