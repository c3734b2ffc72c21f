"""Every registered planner that wraps somebody's library states the time inside it."""

from __future__ import annotations

import time

import pytest

from trajopt import problem
from trajopt.benchmark.trial import load_required
from trajopt.planners.registry import entries, named

TOOLS = {"casadi", "highspy", "scipy"}  # solvers inside methods of ours: no rival's planner
WRAPPERS = {"de"}  # requires nothing: SciPy always comes with the package
FEW = {"evaluations": 60, "iterations": 1, "tries": 1}  # as little work as an option allows


def wraps(name):
    rivals = {module.partition(".")[0] for module in named(name)[1].requires} - TOOLS
    return bool(rivals) or name in WRAPPERS


def quick(name):
    _, planner = named(name)
    few = [key for key in FEW if key in planner.options()]
    if "evaluations" in few and planner.options().get("iterations"):
        few = ["iterations"]
    if not few:
        return planner
    return named(f"{name}:{few[0]}={FEW[few[0]]}")[1]


@pytest.mark.parametrize("name", [name for name in sorted(entries()) if wraps(name)])
def test_the_time_in_a_library_is_a_part_of_the_whole(name):
    _, planner = named(name)
    for module in planner.requires:
        pytest.importorskip(module)
    load_required(planner.requires)
    planner = quick(name)
    began = time.perf_counter()
    (solution,) = planner.solve_batch(problem("six-axis"), [0])
    whole = time.perf_counter() - began
    assert solution.trajectory is not None, solution.message
    assert solution.library_time is not None, "no call is inside `inside_library`"
    assert 0 < solution.library_time < whole


@pytest.mark.parametrize("name", ["exact", "pso", "unoptimised"])
def test_methods_of_ours_have_no_library(name):
    assert quick(name).solve(problem("six-axis"), seed=0).library_time is None
