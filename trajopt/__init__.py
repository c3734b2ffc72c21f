"""Judge minimum-time robot trajectory planners: run, verify exactly, compare, explain."""

from trajopt.exceptions import (
    InvalidInput,
    InvalidTrajectory,
    MissingBackend,
    StoreError,
    TrajoptError,
    UnknownName,
)
from trajopt.planner import Planner, Relation
from trajopt.problem import Limits, Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import Certificate, Tolerance, verify

__all__ = [
    "Certificate",
    "InvalidInput",
    "InvalidTrajectory",
    "Limits",
    "MissingBackend",
    "Planner",
    "Problem",
    "Relation",
    "Solution",
    "Status",
    "StoreError",
    "Tolerance",
    "Trajectory",
    "TrajoptError",
    "UnknownName",
    "verify",
]
