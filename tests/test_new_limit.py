"""A new kind of limit is one class in one file: this one, which touches no other.

The sum of the speeds of some joints, |v1| + |v2| ≤ S: a limit that no joint has by itself. It is
read, judged, dilated, stored, printed and drawn, and planners that do not know it refuse it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Self

import h5py
import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory, verify, write
from trajopt.benchmark.best_known import records
from trajopt.benchmark.store import folder, trial_text
from trajopt.benchmark.trial import trials_of
from trajopt.cli import main
from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import KINDS, Interval, Limit, Use
from trajopt.explain.active_limits import active_limits, share_at_limits
from trajopt.judging.verification import certified
from trajopt.planners.planner import Relation
from trajopt.planners.registry import entries
from trajopt.views.figures import explanation, motions
from trajopt.views.report.panels import panel


@dataclass(frozen=True, eq=False)
class SpeedSum(Limit):
    """A limit on the sum of some joints' speeds, rad/s: `(joints, 1)`, NaN for the others."""

    key = "speed_sum"

    numbers: Array

    def __post_init__(self) -> None:
        if not np.nanmin(self.numbers) > 0:
            raise InvalidInput("limits.speed_sum", "a positive number", value=self.numbers.tolist())

    @classmethod
    def of_numbers(cls, numbers: Array) -> Self:
        return cls(numbers)

    @classmethod
    def read(cls, value: Any, joints: int) -> Self:
        sums = np.full((joints, 1), np.nan)
        sums[np.array(value["joints"]) - 1] = value["sum"]
        return cls(sums)

    def table(self) -> Any:
        of = (np.flatnonzero(self.bounds) + 1).tolist()
        return {"joints": of, "sum": float(np.nanmin(self.numbers))}

    @property
    def bounds(self) -> Bools:
        return np.isfinite(self.numbers[:, 0])

    def only(self, joints: Array) -> Self | None:
        left = self.numbers[joints]
        return type(self)(left) if np.isfinite(left).sum() == self.bounds.sum() else None

    def converted(self, sizes: Array) -> Self:
        return type(self)(sizes[:, None] * self.numbers)

    def in_units(self, time: float, lengths: Array | float) -> Self:
        return type(self)(self.numbers * time / lengths)

    def widened(self, joint: int | None, by: float) -> Self:
        return type(self)(self.numbers * (1 + by))

    def _signed(self, motion: Trajectory) -> Array:
        """The sum over the limit, for each choice of signs: `(degree + 1, choices, pieces)`."""
        speeds = motion.pieces(1)[..., self.bounds] / np.nanmin(self.numbers)
        signs = list(product([1, -1], repeat=int(self.bounds.sum())))
        return np.stack([speeds @ np.array(own) for own in signs], axis=1)

    def worst(self, motion: Trajectory) -> Use:
        sums = self._signed(motion)
        points = polynomials.critical_points(sums.reshape(len(sums), -1))
        points = points.reshape(-1, *sums.shape[1:])
        values = polynomials.evaluate(sums[:, None], points)
        row, choice, piece = np.unravel_index(np.argmax(values), values.shape)
        elapsed = points[row, choice, piece] * motion.lengths[piece]
        return Use(float(values.max()), None, float(motion.breaks[piece] + elapsed))

    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        over = self._signed(motion)
        over[-1] -= share
        begins, ends, (_, piece) = polynomials.positive_intervals(over)
        at, length = motion.breaks[piece], motion.lengths[piece]
        for start, end in zip(at + begins * length, at + ends * length, strict=True):
            yield Interval(None, float(start), float(end))

    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        speeds = np.abs(motion(times, 1)[:, self.bounds])
        return {None: speeds.sum(axis=1) / np.nanmin(self.numbers)}


del KINDS["speed_sum"]  # it is there in the tests below only


@pytest.fixture(autouse=True)
def known(monkeypatch):
    monkeypatch.setitem(KINDS, "speed_sum", SpeedSum)


TEXT = """
name = "two together"
angle_unit = "rad"
waypoints = [[0.0, 0.0, 0.0], [1.0, -1.0, 0.5]]
[limits]
velocity = [1.0, 1.0, 1.0]
acceleration = [2.0, 2.0, 2.0]
speed_sum = { joints = [1, 2], sum = 0.8 }
"""


@pytest.fixture
def problem(tmp_path):
    file = tmp_path / "two-together.toml"
    file.write_text(TEXT)
    return Problem.from_toml(file)


@dataclass(frozen=True)
class Knowing(Planner):
    """Knows the new kind: whatever it says, the verifier dilates."""

    knows = ("velocity", "acceleration", "speed_sum")

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        # there and back to rest: q = h (3 s² - 2 s³), whose highest velocity is 1.5 h / T
        h = problem.displacements[0]
        coefficients = np.stack([-2 * h / 8, 3 * h / 4, 0 * h, 0 * h])[:, None]
        motion = Trajectory([0.0, 2.0], coefficients + 0.0, [0.0, 2.0])
        return Solution(Status.SOLVED, motion)


@pytest.fixture
def trial(problem):
    return trials_of(Knowing(), problem, [0])[0]


def test_a_problem_file_states_it_and_its_digest_counts_it(problem, tmp_path):
    assert problem.limits.kinds["speed_sum"].numbers[:, 0].tolist()[:2] == [0.8, 0.8]
    file = tmp_path / "again.toml"
    file.write_text(problem.to_toml())
    again = Problem.from_toml(file)
    assert again.digest() == problem.digest()
    assert again.limits == problem.limits
    without = problem.without("speed_sum")
    assert without.digest() != problem.digest()
    assert without.limits != problem.limits
    assert "limits: velocity, acceleration, speed_sum" in repr(problem)
    in_python = Limits([1] * 3, [2] * 3, speed_sum={"joints": [2, 1], "sum": 0.8})
    assert replace(problem, limits=in_python) == problem
    assert "speed_sum" in problem.only([0, 1]).limits.kinds
    assert "speed_sum" not in problem.only([0, 2]).limits.kinds


def test_the_file_says_degrees(tmp_path):
    file = tmp_path / "degrees.toml"
    file.write_text(TEXT.replace('"rad"', '"deg"').replace("0.8", "45.0"))
    found = Problem.from_toml(file).limits.kinds["speed_sum"]
    assert found.numbers[0, 0] == pytest.approx(np.pi / 4, rel=1e-15)


def test_it_is_judged_and_dilated(problem, trial):
    use = trial.certificate.uses["speed_sum"]
    # the two joints move 1 rad each in 2 s: at half time 0.75 rad/s each
    assert use.value == pytest.approx(1.5 / 0.8, rel=1e-12)
    assert (use.joint, use.time) == (None, pytest.approx(1.0, rel=1e-9))
    assert trial.dilation == pytest.approx(1.5 / 0.8, rel=1e-12)
    assert trial.certified_duration == pytest.approx(3.75, rel=1e-12)
    motion = certified(problem, trial.solution.trajectory)
    assert verify(problem, motion).uses["speed_sum"].value == pytest.approx(1, rel=1e-12)
    assert verify(problem, trial.solution.trajectory, unjudged=["speed_sum"]).dilation < 1


def test_it_is_stored_and_read_back(problem, trial, tmp_path):
    again = trial_text.read(trial_text.write(trial))
    assert again.problem == problem
    assert again.certificate.uses == trial.certificate.uses
    file = tmp_path / "results.h5"
    folder.save(file, trial)
    (stored,) = folder.recorded(file)
    assert stored.id == trial.id
    assert stored.certificate.uses == trial.certificate.uses
    with h5py.File(file) as found:
        own = found["problems/two together"]
        assert own["limits/speed_sum"][:2, 0].tolist() == [0.8, 0.8]
        assert list(own.attrs["uses"]) == ["velocity", "acceleration", "speed_sum"]
        assert own["uses/joint"][0, -1] == 0
        assert own["uses/value"][0, -1] == pytest.approx(1.5 / 0.8)


def test_a_text_with_a_kind_that_nobody_knows_is_refused(trial, monkeypatch):
    text = trial_text.write(trial)
    monkeypatch.delitem(KINDS, "speed_sum")
    trial_text._PROBLEMS.clear()
    with pytest.raises((ValueError, LookupError), match="speed_sum"):
        trial_text.read(text)


def test_it_is_printed(problem, trial, tmp_path, capsys):
    motion = tmp_path / "motion.json"
    write(motion, trial)
    with pytest.raises(SystemExit):
        main(["judge", str(motion), str(tmp_path / "two-together.toml")])
    said = capsys.readouterr().out
    assert "speed sum" in said
    assert "1.000000 of limit" in said
    with pytest.raises(SystemExit):
        main(["judge", str(motion), str(tmp_path / "two-together.toml"), "--json"])
    table = json.loads(capsys.readouterr().out)
    assert table["certificate"]["speed_sum"]["ratio"] == pytest.approx(1)
    assert table["certificate"]["speed_sum"]["joint"] is None
    assert records.find(problem) is None


def test_it_is_explained(problem, trial):
    motion = trial.certified_trajectory
    (longest,) = active_limits(problem, motion, None)
    assert (longest.limit, longest.joint) == ("speed_sum", None)
    # v = 6 s (1 - s) h / T is within 1 % of its peak where |s - 1/2| < 0.05
    assert longest.end - longest.start == pytest.approx(0.1 * 3.75, rel=1e-6)
    # 1 % more of the limit is 1 % less time
    assert longest.saving == pytest.approx(3.75 * (1 - 1 / 1.01), rel=1e-9)
    assert share_at_limits(problem, motion) == pytest.approx(0.1, rel=1e-6)


def test_it_is_drawn(problem, trial):
    figure = explanation.limit_use(problem, trial.certified_trajectory)
    labels = [label.get_text() for axes in figure.axes for label in axes.get_yticklabels()]
    assert "speed sum" in labels
    drawn = motions.motion(problem, trial.certified_trajectory)
    own = drawn.axes[-1]
    assert own.get_ylabel() == "speed sum (use)"
    (times, use) = own.lines[0].get_data()
    assert max(use) == pytest.approx(1, abs=1e-3)
    assert times[-1] == pytest.approx(3.75)
    found = panel([trial], ["Knowing"], with_motions=True)
    (other,), (use,) = found["others"], found["motions"][0]["uses"]
    assert other == ("speed sum", ["0.8", "0.8", "–"])
    assert use[0] == "speed sum"
    assert max(use[1]) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("name", sorted(entries()))
def test_planners_that_do_not_know_it_refuse_it(problem, name):
    entry = entries()[name]
    if entry.missing():
        pytest.skip("not installed")
    planner = entry.load()
    if planner.drops:  # a bound, which holds under more limits
        assert planner.unknown(problem) == ["speed_sum"]
        return
    solution = planner.solve(problem)
    assert solution.status is Status.UNSUPPORTED
    assert "it does not know speed sum limits" in solution.message


def test_a_bound_says_that_it_was_left_out(problem):
    planner = entries()["prove"].load()
    found = planner.solve(problem)
    assert found.message.endswith("speed sum limits are left out")
    # each joint by itself: 1 rad at 1 rad/s and 2 rad/s²
    assert found.lower_bound == pytest.approx(1.5, rel=1e-3)
    assert found.lower_bound < 1.5 * (1 + 1e-9)
    assert planner.relation(problem) is Relation.RELAXATION
