"""Demands on the way beside the waypoints: read, refused, written, stored, and part of digests."""

from __future__ import annotations

import hashlib
import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Solution, Status
from trajopt.benchmark.store.document import problem_of, problem_table
from trajopt.cli import main
from trajopt.core.demand import DEMANDS, Demand
from trajopt.core.exceptions import InvalidInput
from trajopt.planners.registry import entries

TEXT = """
waypoints = [[0, 0.0], [90, 0.1], [45, 0.3]]
start_velocity = [90, 100]
end_velocity = [0, -50]
start_acceleration = [180, 0]
units = { waypoints = ["deg", "m"], limits = ["deg", "mm"] }
[limits]
velocity = [180, 500]
acceleration = [360, 1000]
jerk = [3600, inf]
"""
LIMITS = Limits([2.0, 3.0], [4.0, 5.0], jerk=[60.0, np.inf])
WAYPOINTS = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]


@pytest.fixture
def problem(tmp_path):
    file = tmp_path / "given.toml"
    file.write_text(TEXT, encoding="utf-8")
    return Problem.from_toml(file)


def moving(**demands):
    return Problem(WAYPOINTS, LIMITS, **demands)


def test_a_file_says_them_in_the_unit_of_the_limits(problem):
    assert np.allclose(problem.start_velocity, [np.pi / 2, 0.1], rtol=1e-15)
    assert np.allclose(problem.end_velocity, [0, -0.05], rtol=1e-15)
    assert np.allclose(problem.start_acceleration, [np.pi, 0], rtol=1e-15)
    assert problem.end_acceleration.tolist() == [0, 0]
    assert list(problem.demands) == ["start_velocity", "end_velocity", "start_acceleration"]
    assert not problem.route.dilatable


def test_files_texts_and_python_agree(problem, tmp_path):
    (tmp_path / "again.toml").write_text(problem.to_toml(), encoding="utf-8")
    assert Problem.from_toml(tmp_path / "again.toml") == problem
    assert problem_of(json.loads(json.dumps(problem_table(problem)))) == problem
    given = {key: getattr(problem, key) for key in DEMANDS}
    assert Problem(problem.waypoints, problem.limits, **given) == problem
    assert replace(problem, name="other") == problem
    assert "demands: start_velocity, end_velocity, start_acceleration" in repr(problem)


def test_the_digest_counts_what_is_asked_by_name():
    """The old tables first, then name, shape and numbers of what is not at its default."""
    problem = moving(start_velocity=[0.5, 0.0], end_velocity=[0.0, -1.0])
    known = hashlib.sha256()
    tables = [("", problem.waypoints), *(("", own) for own in LIMITS.by_name().values())]
    tables += [("end_velocity", np.array([0.0, -1.0])), ("start_velocity", np.array([0.5, 0.0]))]
    for name, table in tables:
        known.update(name.encode() + repr(table.shape).encode())
        known.update(b"".join(struct.pack("<d", number + 0.0) for number in table.ravel()))
    assert problem.digest() == known.hexdigest()
    at_rest = moving(start_velocity=[0, -0.0], end_acceleration=[0.0, 0.0])
    assert at_rest.demands == {}
    assert at_rest == Problem(WAYPOINTS, LIMITS)


@pytest.mark.parametrize(
    ("demands", "message"),
    [
        ({"start_velocity": [1.0]}, r"start_velocity is \[1.0\]: expected 2 numbers, one per j"),
        ({"start_velocity": 1.0}, "start_velocity is 1.0: expected 2 numbers, one per joint"),
        (
            {"start_velocity": np.ones((1, 2))},
            r"start_velocity is \[\[1.0, 1.0\]\]: expect",
        ),
        (
            {"end_velocity": [0, "fast"]},
            "end_velocity, joint 2 is 'fast': expected a finite number",
        ),
        ({"end_velocity": [np.nan, 0]}, "end_velocity, joint 1 is nan: expected a finite number"),
        ({"end_acceleration": [1, 1]}, "end_acceleration, joint 2: expected 0, or a jerk"),
    ],
)
def test_one_line_says_what_is_wrong(demands, message):
    with pytest.raises(InvalidInput, match=message):
        moving(**demands)


def test_a_rate_needs_the_unit_of_the_limits(tmp_path):
    """A robot's limits need no unit; a velocity of the file's own does."""
    file = tmp_path / "robot.toml"
    row = "[0, -90, 90, -90, -90, 0]"
    text = f'robot = "ur5e"\nwaypoints = [{row}, [40, -70, 80, -100, -90, 20]]\n'
    text += 'units.waypoints = "deg"\n'
    file.write_text(f"start_velocity = [1, 0, 0, 0, 0, 0]\n{text}", encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"units.limits: expected this key; it is missing"):
        Problem.from_toml(file)
    file.write_text(f'{text}units.limits = "deg"\nend_velocity = [0, 0, 0, 0, 0, 180]\n')
    assert Problem.from_toml(file).end_velocity[5] == np.pi


def test_a_route_made_simpler_keeps_what_is_asked():
    problem = moving(start_velocity=[0.5, 0.25], start_acceleration=[1.0, 0.0])
    assert problem.only([1]).start_velocity.tolist() == [0.25]
    twice = Problem([WAYPOINTS[0], *WAYPOINTS], LIMITS, end_velocity=[0.0, 1.0])
    merged, _ = twice.merged()
    assert merged == moving(end_velocity=[0.0, 1.0])
    back = problem.route.reversed()
    assert back.end.velocity.tolist() == [-0.5, -0.25]
    assert back.end.acceleration.tolist() == [1.0, 0.0]
    assert back.reversed().demands.keys() == problem.demands.keys()
    slower = problem.route.in_units(2.0, np.array([1.0, 10.0]))
    assert slower.start.velocity.tolist() == [1.0, 0.05]
    assert slower.start.acceleration.tolist() == [4.0, 0.0]
    stays = Problem([[0.0, 1.0], [1.0, 1.0]], LIMITS, start_velocity=[0.0, 0.1])
    assert stays.moving.all()
    assert problem.without("start_velocity").demands.keys() == {"start_acceleration"}


def test_a_planner_that_does_not_know_them_says_so():
    problem = Problem([[0.0], [1.0], [2.0], [3.0]], Limits([1.0], [1.0]), start_velocity=[0.5])
    for name in ("spline353-nlp", "issa"):
        solution = entries()[name].load().solve(problem)
        assert solution.status is Status.UNSUPPORTED
        assert solution.message == "it does not know start velocity"


# --- one declaration makes a demand ---

PATIENCE = Demand(
    key="patience",
    meaning="seconds that every segment takes at least",
    axes=("segments",),
    time=1,
    example="patience = [0, 0, 1]",
    left_out="relaxation",
)


@pytest.fixture
def patience(monkeypatch):
    monkeypatch.setitem(DEMANDS, "patience", PATIENCE)


class Bound(Planner):
    """Leaves out what it does not know."""

    drops = True

    def solve(self, problem, *, seed=0):
        assert "patience" not in problem.demands
        return Solution(Status.FAILED, lower_bound=1.0)


@pytest.mark.usefixtures("patience")
def test_a_new_demand_is_one_declaration():
    problem = Problem(WAYPOINTS, LIMITS, patience=[0.0, 3.0])
    assert problem_of(problem_table(problem)) == problem
    assert problem.digest() != Problem(WAYPOINTS, LIMITS).digest()
    assert problem.route.reversed().demands["patience"].tolist() == [3.0, 0.0]
    assert problem.route.in_units(2.0, 1.0).demands["patience"].tolist() == [0.0, 1.5]
    assert PATIENCE.say(problem.demands["patience"], "rad") == "patience 0, 3 s"
    assert problem.route.dilatable
    with pytest.raises(InvalidInput, match="patience, segment 2 is 'x': expected a finite number"):
        Problem(WAYPOINTS, LIMITS, patience=[1.0, "x"])
    with pytest.raises(InvalidInput, match="patience is 3: expected 2 numbers, one per segment"):
        Problem(WAYPOINTS, LIMITS, patience=3)
    assert Bound().solve(problem).lower_bound == 1.0
    assert Bound().solve(moving(start_velocity=[1, 0])).status is Status.UNSUPPORTED


def test_an_example_file_says_each(tmp_path, capsys):
    file = tmp_path / "new.toml"
    with pytest.raises(SystemExit):
        main(["new", str(file)])
    capsys.readouterr()
    text = file.read_text(encoding="utf-8")
    for key, demand in DEMANDS.items():
        line = next(own for own in text.splitlines() if own.startswith(f"# {key} = "))
        assert line.endswith(demand.meaning)
        assert len(line) <= 100
