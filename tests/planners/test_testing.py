"""The contract: kept by small planners, and broken in every way by one small planner each."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm_planner import Unoptimised
from trajopt.planners.testing import ContractError, check_planner, examples


@dataclass(frozen=True)
class Quintic(Planner):
    """From rest to rest, each segment long enough for 15/8 h/T and 10/√3 h/T²."""

    spare: float = 1.0

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return None

    def solve(self, problem, *, seed=0):
        v, a = (
            np.abs(x).min(axis=1) for x in (problem.limits.velocity, problem.limits.acceleration)
        )
        h = np.abs(problem.displacements)
        times = np.maximum(15 / 8 * h / v, np.sqrt(10 / 3**0.5 * h / a)).max(axis=1)
        times = self.spare * np.where(times > 0, times, 0.1)
        blend = np.array([6, -15, 10, 0, 0, 0])[:, None] / times ** np.arange(5, -1, -1)[:, None]
        coefficients = blend[..., None] * problem.displacements
        coefficients[-1] += problem.waypoints[:-1]
        breaks = np.r_[0, np.cumsum(times)]
        return Solution(Status.SOLVED, Trajectory(breaks, coefficients, breaks))


@dataclass(frozen=True)
class OneJointStops(Planner):
    """Bang-bang from waypoint to waypoint, one joint with symmetric limits."""

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return None if problem.joints == 1 else "one joint only"

    def solve(self, problem, *, seed=0):
        (v,) = problem.limits.velocity[:, 1]
        (a,) = problem.limits.acceleration[:, 1]
        breaks = [0.0]
        pieces = []
        q = problem.waypoints[0, 0]
        for h in problem.displacements[:, 0]:
            ramp = min(v / a, np.sqrt(abs(h) / a))
            for length, acceleration, speed in [
                (ramp, a, 0.0),
                (abs(h) / (a * ramp) - ramp, 0.0, a * ramp),
                (ramp, -a, a * ramp),
            ]:
                if length > 1e-12:
                    pieces.append([np.sign(h) * acceleration / 2, np.sign(h) * speed, q])
                    q += np.sign(h) * (acceleration / 2 * length + speed) * length
                    breaks.append(breaks[-1] + length)
        stops = stop_times(problem.without("jerk"))  # which it does not know
        times = np.r_[0, np.cumsum(stops)]
        return Solution(Status.SOLVED, Trajectory(breaks, np.array(pieces).T[..., None], times))


def test_the_little_planner_takes_the_closed_forms_time():
    problem = examples()[0]  # 0.4, 0.6 and 0.5 rad at 1 rad/s and 2 rad/s²
    trajectory = OneJointStops().solve(problem).trajectory
    expected = 2 * np.sqrt(0.4 / 2) + (0.6 + 0.5) + (0.5 + 0.5)
    certificate = verify(problem, trajectory)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(expected, rel=1e-12)


def test_ones_own_problems_can_be_given():
    bad = Problem([[0.0, 0.0], [1.0, 2.0]], Limits([1.0, 1.0], [1.0, 1.0]))
    check_planner(OneJointStops(), [bad])  # unsupported, with a reason
    check_planner(Quintic(), iter([bad]))
    with pytest.raises(ContractError, match="without a trajectory"):
        check_planner(Empty(), [bad])


def test_the_examples_hold_every_edge():
    problems = examples()
    assert len({p.digest() for p in problems}) == len(problems)
    assert any(not p.moving.all() for p in problems)
    assert any(p.merged()[0].segments < p.segments for p in problems)
    assert any(p.segments == 1 for p in problems)
    assert any((p.limits.velocity.sum(axis=1) != 0).any() for p in problems)


class Undecorated(Planner):
    """No dataclass: nobody sees its options."""

    def __init__(self):
        self.spare = 1.0

    def solve(self, problem, *, seed=0):
        return Quintic(self.spare).solve(problem)


@dataclass
class Thawed(Undecorated):
    spare: float = 1.0


class SolveAlone:
    def solve(self, problem, *, seed=0):
        return Quintic().solve(problem)


@dataclass(frozen=True)
class Raising(Quintic):
    """Raises in a line of its own, and in one of another package."""

    through_numpy: bool = False

    def solve(self, problem, *, seed=0):
        if self.through_numpy:
            np.linalg.inv(np.zeros((1, 1)))
        return {}["nothing"]


@pytest.mark.parametrize(
    ("planner", "error", "line"),
    [
        (Raising(), "KeyError: 'nothing'", 'return {}["nothing"]'),
        (
            Raising(through_numpy=True),
            "LinAlgError: Singular matrix",
            "np.linalg.inv(np.zeros((1, 1)))",
        ),
    ],
)
def test_an_exception_is_a_breach_with_its_line(planner, error, line):
    lines = Path(__file__).read_text(encoding="utf-8").splitlines()
    (number,) = [n for n, text in enumerate(lines, 1) if text.strip() == line]
    with pytest.raises(ContractError) as caught:
        check_planner(planner)
    assert str(caught.value) == f"on 'one joint': {error} ({__file__}, line {number})"


@pytest.mark.parametrize("planner", [Unoptimised(), Quintic(), Quintic(0.3), OneJointStops()])
def test_good_planners_are_accepted(planner):
    check_planner(planner)


@dataclass(frozen=True)
class Locked(Quintic):
    """Cannot be pickled."""

    lock: object = field(default_factory=threading.Lock)


@dataclass(frozen=True)
class Forgetful(Quintic):
    """Comes back from pickling as another."""

    def __reduce__(self):
        return Quintic, (2 * self.spare,)


@dataclass(frozen=True)
class Secretive(Quintic):
    """Knows more than its fields say."""

    def __post_init__(self):
        object.__setattr__(self, "table", [1, 2])


@dataclass(frozen=True)
class Hollow(Quintic):
    """An option that nobody ever sets."""

    nothing: int = field(init=False)


@dataclass(frozen=True)
class VagueRelation(Quintic):
    def relation(self, problem):
        return "restriction"


@dataclass(frozen=True)
class EmptyReason(Quintic):
    def unsupported(self, problem):
        return ""


@dataclass(frozen=True)
class TrueReason(Quintic):
    def unsupported(self, problem):
        return problem.joints > 0


@dataclass(frozen=True)
class Bare(Quintic):
    """Returns the trajectory itself."""

    def solve(self, problem, *, seed=0):
        return super().solve(problem).trajectory


@dataclass(frozen=True)
class Empty(Quintic):
    def solve(self, problem, *, seed=0):
        return Solution(Status.SOLVED)


@dataclass(frozen=True)
class Silent(Quintic):
    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED)


MOODS = count()
TIRES = count()


@dataclass(frozen=True)
class Moody(Quintic):
    """Another answer every time."""

    def solve(self, problem, *, seed=0):
        return Quintic(1 + next(MOODS) / 100).solve(problem)


@dataclass(frozen=True)
class Tired(Quintic):
    """Solves now, and fails with the same seed later."""

    stochastic = True

    def solve(self, problem, *, seed=0):
        tired = next(TIRES) % 3 == 2
        return Solution(Status.FAILED, message="no") if tired else super().solve(problem)


@dataclass(frozen=True)
class ThroughTheAir(Quintic):
    """Jumps: at a constant speed from waypoint to waypoint."""

    def solve(self, problem, *, seed=0):
        times = np.arange(len(problem.waypoints), dtype=float)
        coefficients = np.stack([problem.displacements, problem.waypoints[:-1]])
        return Solution(Status.SOLVED, Trajectory(times, coefficients, times))


@dataclass(frozen=True)
class Elsewhere(Quintic):
    """Misses every waypoint by a micrometre."""

    def solve(self, problem, *, seed=0):
        t = super().solve(problem).trajectory
        moved = t.coefficients.copy()
        moved[-1] += 1e-6
        return Solution(Status.SOLVED, Trajectory(t.breaks, moved, t.waypoint_times))


@dataclass(frozen=True)
class TooFewTimes(Quintic):
    def solve(self, problem, *, seed=0):
        t = super().solve(problem).trajectory
        return Solution(
            Status.SOLVED, Trajectory(t.breaks, t.coefficients, t.waypoint_times[[0, 0, -1]])
        )


@dataclass(frozen=True)
class FirstJointOnly(Quintic):
    def solve(self, problem, *, seed=0):
        t = super().solve(problem).trajectory
        return Solution(
            Status.SOLVED, Trajectory(t.breaks, t.coefficients[..., :1], t.waypoint_times)
        )


@dataclass(frozen=True)
class ShortBatch(Quintic):
    def solve_batch(self, problem, seeds):
        return [self.solve(problem, seed=s) for s in seeds][1:]


@dataclass(frozen=True)
class OtherBatch(Quintic):
    def solve_batch(self, problem, seeds):
        return [Quintic(2.0).solve(problem, seed=s) for s in seeds]


@dataclass(frozen=True)
class FailingBatch(Quintic):
    def solve_batch(self, problem, seeds):
        return [Solution(Status.FAILED, message="no") for _ in seeds]


@dataclass(frozen=True)
class OtherMany(Quintic):
    def solve_many(self, problems, seeds=None):
        return [Quintic(2.0).solve(problem) for problem in problems]


@dataclass(frozen=True)
class Remembering(Quintic):
    """Keeps what was certified, and claims half of that."""

    def solve(self, problem, *, seed=0):
        certified = super().solve(problem)
        claim = certified.trajectory.dilated(0.5)
        history = np.array([[1.0, certified.trajectory.duration]])
        return replace(certified, trajectory=claim, history=history)


BROKEN = [
    (Remembering(), "on 'one joint': history: it ends at .* s, but the trajectory takes"),
    (Undecorated(), "its options are no fields"),
    (Quintic, r"expected an object, Quintic\(\)"),
    (object(), "planner is 'object': expected a planner: an object of a class derived from"),
    (SolveAlone(), "planner is 'SolveAlone': expected a planner: an object of a class derived"),
    (Thawed(), "its options can change while it runs"),
    (Locked(), "does not survive pickling"),
    (Forgetful(), "its options do not survive pickling"),
    (Hollow(), "option nothing has no value"),
    (Secretive(), "planner Secretive: table cannot be seen: expected a frozen dataclass"),
    (VagueRelation(), "on 'one joint': relation is not a Relation"),
    (EmptyReason(), "on 'one joint': unsupported is neither None nor a reason"),
    (TrueReason(), "on 'one joint': unsupported is neither None nor a reason"),
    (Bare(), "on 'one joint': solve returns no Solution"),
    (Empty(), "on 'one joint': solved without a trajectory"),
    (Silent(), "on 'one joint': failed without a message"),
    (Moody(), "differs between two calls: set `stochastic = True` if the seed matters"),
    (Tired(), "on 'one joint': solve differs for the same seed"),
    (ThroughTheAir(), "on 'one joint': invalid: joint 1 at 3 s: velocity jumps by 0.5 rad/s"),
    (Elsewhere(), "on 'one joint': invalid: .*misses the waypoint"),
    (TooFewTimes(), "on 'one joint': invalid: 3 waypoint times; the problem has 4"),
    (FirstJointOnly(), "on 'reversal': invalid: 1 joints; the problem has 2"),
    (ShortBatch(), "on 'one joint': solve_batch returns another number of solutions"),
    (OtherBatch(), "on 'one joint': solve_batch differs from solve"),
    (FailingBatch(), "on 'one joint': solve_batch differs from solve"),
    (OtherMany(), "on 'one joint': solve_many differs from solve"),
]


@pytest.mark.parametrize(("planner", "words"), BROKEN, ids=lambda x: type(x).__name__)
def test_every_breach_is_named(planner, words):
    with pytest.raises(ContractError, match=words):
        check_planner(planner)


def test_a_relaxation_may_break_what_it_ignores_if_it_says_so():
    @dataclass(frozen=True)
    class Relaxed(ThroughTheAir):
        status: str = "relaxed"

        def relation(self, problem):
            return Relation.RELAXATION

        def solve(self, problem, *, seed=0):
            return replace(super().solve(problem), status=Status(self.status), message="sorry")

    check_planner(Relaxed())
    with pytest.raises(ContractError, match="on 'one joint': invalid"):
        check_planner(Relaxed(status="solved"))

    @dataclass(frozen=True)
    class Denying(ThroughTheAir):
        def solve(self, problem, *, seed=0):
            return replace(super().solve(problem), status=Status.RELAXED, message="sorry")

    with pytest.raises(ContractError, match="not what its relation says"):
        check_planner(Denying())


def test_failing_with_a_word_is_allowed():
    @dataclass(frozen=True)
    class Honest(Quintic):
        def solve(self, problem, *, seed=0):
            return Solution(Status.FAILED, message="no luck")

    check_planner(Honest())


def test_beating_the_optimum_is_a_breach(monkeypatch):
    """As no valid trajectory can, the verifier is made to vouch for too short a duration."""

    def generous(problem, trajectory):
        return replace(verify(problem, trajectory), duration=1.9, dilation=1.0)

    monkeypatch.setattr("trajopt.planners.testing.verify", generous)
    with pytest.raises(ContractError, match=r"certified 1\.9 s where the optimum is 2\.0 s"):
        check_planner(OneJointStops())


def test_the_optimum_of_the_first_example_is_two_seconds():
    """1.5 rad at 1 rad/s and 2 rad/s²: half a second up, a second of cruise, half a second down."""
    problem = examples()[0]
    through = Problem(problem.waypoints[[0, -1]], problem.limits)
    assert stop_times(through).sum() == pytest.approx(2.0, rel=1e-15)
