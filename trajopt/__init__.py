"""Judge minimum-time robot trajectory planners: run, verify exactly, compare, explain."""

from __future__ import annotations

TYPE_CHECKING = False  # not from `typing`: importing it takes time in which Ctrl-C is not caught
if TYPE_CHECKING:
    from typing import Any

    from trajopt.benchmark.front import front as front
    from trajopt.benchmark.objective import objective as objective
    from trajopt.benchmark.suites.catalogue import load as problem  # noqa: F401
    from trajopt.best_planner import plan as plan
    from trajopt.chunks import from_samples as from_samples
    from trajopt.comparison import compare as compare
    from trajopt.core.braking import brake_first as brake_first
    from trajopt.core.exceptions import InvalidInput as InvalidInput
    from trajopt.core.exceptions import InvalidTrajectory as InvalidTrajectory
    from trajopt.core.exceptions import MissingBackend as MissingBackend
    from trajopt.core.exceptions import StoreError as StoreError
    from trajopt.core.exceptions import TrajoptError as TrajoptError
    from trajopt.core.exceptions import UnitWarning as UnitWarning
    from trajopt.core.exceptions import UnknownName as UnknownName
    from trajopt.core.exceptions import WrongType as WrongType
    from trajopt.core.limits import Limits as Limits
    from trajopt.core.problem import Problem as Problem
    from trajopt.core.solution import Solution as Solution
    from trajopt.core.solution import Status as Status
    from trajopt.core.trajectory import Trajectory as Trajectory
    from trajopt.judgement import judge as judge
    from trajopt.judging.certificate import Certificate as Certificate
    from trajopt.judging.certificate import Tolerance as Tolerance
    from trajopt.judging.together import verify_many as verify_many
    from trajopt.judging.verification import verify as verify
    from trajopt.planners.planner import Planner as Planner
    from trajopt.planners.planner import Relation as Relation
    from trajopt.planners.search_planner import optimiser as optimiser
    from trajopt.retiming import retime as retime
    from trajopt.views.export.motion_file import write as write
    from trajopt.views.results import Results as Results

    __version__: str

_MODULE = {
    "Certificate": "judging.certificate",
    "InvalidInput": "core.exceptions",
    "InvalidTrajectory": "core.exceptions",
    "Limits": "core.problem",
    "MissingBackend": "core.exceptions",
    "Planner": "planners.planner",
    "Problem": "core.problem",
    "Relation": "planners.planner",
    "Results": "views.results",
    "Solution": "core.solution",
    "Status": "core.solution",
    "StoreError": "core.exceptions",
    "Tolerance": "judging.certificate",
    "Trajectory": "core.trajectory",
    "TrajoptError": "core.exceptions",
    "UnitWarning": "core.exceptions",
    "UnknownName": "core.exceptions",
    "WrongType": "core.exceptions",
    "brake_first": "core.braking",
    "compare": "comparison",
    "from_samples": "chunks",
    "front": "benchmark.front",
    "judge": "judgement",
    "objective": "benchmark.objective",
    "optimiser": "planners.search_planner",
    "plan": "best_planner",
    "problem": "benchmark.suites.catalogue:load",
    "retime": "retiming",
    "verify": "judging.verification",
    "verify_many": "judging.together",
    "write": "views.export.motion_file",
}
__all__ = sorted(_MODULE)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that `trajopt --help` need not wait."""
    if name == "__version__":
        from importlib.metadata import version

        return version("mintime")
    if name not in _MODULE:
        raise AttributeError(f"module 'trajopt' has no attribute {name!r}")
    from importlib import import_module

    module, _, other_name = _MODULE[name].partition(":")
    return getattr(import_module(f"trajopt.{module}"), other_name or name)


def __dir__() -> list[str]:
    return __all__
