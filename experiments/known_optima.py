"""Are `exact-jerk` and `exact` right where another method knows the optimum?

    python -m experiments.known_optima               # 2,382 problems, ten minutes
    python -m experiments.known_optima --quick       # 119 problems

The kinds of problems:

- Straight lines: all joints move in proportion, back and forth or one way, and the first has the
  tightest limits of every kind. So the first joint's optimum is the optimum. One way and with
  symmetric limits it has a closed form.
- Nearly straight: waypoints are off such a line by 1e-7 to 1e-3 of its length. The reference is a
  proved bound, of the problem or of its first joint alone.
- Two waypoints: the reference is Ruckig.
- One way: one joint through six to ten waypoints, some segments a millionth of the others. It
  passes them without losing time, so the optimum is Ruckig's from the first waypoint to the last.
- Suites: their problems without position limits; the references are the best known answers.

Without jerk limits `exact-jerk` calls `exact`. In the table, *late* is a certified duration over
the claimed one. *Brief* are pieces below 1e-6 s, and *needless* those of them without which a
motion between the same waypoint states keeps the limits.

Rows go to `problems.csv` in `--output` as soon as they are known; running again does only what is
missing. The table `kinds` counts them.
"""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from baselines.exact.jerk import ExactJerk
from baselines.lower_bound.bound import prove
from baselines.ruckig_ import RuckigStop
from experiments.common.brief_pieces import brief, needless
from experiments.common.kept import Rows, kept
from experiments.common.output import save_table
from trajopt import Limits, Problem, verify
from trajopt.benchmark.best_known.records import Record, find
from trajopt.benchmark.suites.catalogue import every_problem
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.planners.rest_to_rest import stop_times

# Numbers of problems, and differences that are allowed, relative.
KINDS = {
    "straight": (500, 1e-9),
    "nearly straight": (500, 1e-6),
    "two waypoints": (1000, 1e-9),
    "one way": (200, 1e-9),
    "suites": (84, 1e-6),
    "suites without jerk limits": (124, 1e-6),
}
PROOF_GAP = 5e-7  # relative
PROOF_S = 120.0

Generator = np.random.Generator


def line(rng: Generator, beside: float = 0.0) -> Problem:
    """Random waypoints on a straight line, or beside it by this share of its length."""
    joints = int(rng.integers(2, 7))
    segments = int(rng.integers(2, 10))
    steps = rng.uniform(0.05, 1.5, segments)
    turns = rng.uniform() < 0.5
    if turns:
        steps *= rng.choice([-1.0, 1.0], segments)
    along = np.append(0.0, np.cumsum(steps))
    share = rng.uniform(0.1, 1.0, joints)
    share *= rng.choice([-1.0, 1.0], joints)
    share[0] = 1.0
    waypoints = np.outer(along, share)
    sideways = rng.uniform(-1.0, 1.0, waypoints.shape)
    waypoints += beside * np.ptp(along) * sideways
    velocity = 0.1 * 10 ** rng.uniform(0.0, 2.0)
    acceleration = 0.2 * 10 ** rng.uniform(0.0, 2.0)
    jerk = acceleration * 10 ** rng.uniform(0.0, 2.5)
    sides = np.ones(2)
    lopsided = rng.uniform() < 0.5
    if lopsided:
        sides = 10 ** rng.uniform(-0.5, 0.5, 2)
    limits = Limits(
        velocity * limited(rng, share, sides),
        acceleration * limited(rng, share, sides),
        jerk * limited(rng, share, sides),
    )
    return Problem(waypoints, limits)


def limited(rng: Generator, share: Array, sides: Array) -> Array:
    """Limits for a joint's share of the way; those of all but the first are up to ten times it."""
    wider = 10 ** rng.uniform(0.0, 1.0, len(share))
    wider[0] = 1.0
    along = np.outer(wider * np.abs(share), sides)
    backwards = along[:, ::-1]
    own = np.where(share[:, None] < 0, backwards, along)
    return own * [-1.0, 1.0]


def alone(problem: Problem) -> Problem:
    """The first joint's problem."""
    limits = problem.limits
    first = Limits(limits.velocity[:1], limits.acceleration[:1], limits.jerk[:1])
    return Problem(problem.waypoints[:, :1], first)


def optimum(problem: Problem) -> float:
    """The optimum of a straight line, s."""
    first = alone(problem)
    steps = np.diff(first.waypoints[:, 0])
    one_way = (steps > 0).all()
    backward, forward = first.limits.jerk[0]
    if one_way and forward == -backward:
        ends = Problem(first.waypoints[[0, -1]], first.limits)
        return float(stop_times(ends).sum())
    solution = ExactJerk().solve(first)
    return float(min(solution.stats["start_duration"]))


def bound(problem: Problem) -> float:
    """A proved lower bound, s: of the problem, or of its first joint."""
    bounds = []
    for relaxed in (problem, alone(problem)):
        proof = prove(relaxed, within=PROOF_GAP, time_limit=PROOF_S)
        bounds.append(proof.lower_bound)
        if proof.status == "proved":
            break
    return max(bounds)


def one_way(seed: int) -> Problem:
    """A random problem whose joint moves one way, under symmetric jerk limits."""
    rng = np.random.default_rng([17, seed])
    waypoints = int(rng.integers(6, 11))
    problem = random_problem(seed, joints=1, waypoints=waypoints, jerk=True)
    passed = np.cumsum(np.abs(problem.displacements), axis=0)
    return Problem(np.vstack([[0.0], passed]), problem.limits)


def end_to_end(problem: Problem) -> float:
    """Ruckig's duration from the first waypoint to the last, s."""
    ends = Problem(problem.waypoints[[0, -1]], problem.limits)
    trajectory = RuckigStop().solve(ends).trajectory
    return np.nan if trajectory is None else trajectory.duration


def drawn(kind: str, seed: int) -> tuple[Problem, float]:
    """A random problem, and what is known of its optimum, s."""
    if kind == "straight":
        problem = line(np.random.default_rng([26, seed]))
        return problem, optimum(problem)
    if kind == "nearly straight":
        rng = np.random.default_rng([27, seed])
        beside = 10 ** rng.uniform(-7.0, -3.0)
        problem = line(rng, beside)
        return problem, bound(problem)
    if kind.startswith("suites"):
        problem = suites(jerk=kind == "suites")[seed]
        return problem, record(problem).duration
    problem = one_way(seed)
    if kind == "two waypoints":
        problem = random_problem(seed, waypoints=2, jerk=True)
    return problem, end_to_end(problem)


@cache
def suites(jerk: bool) -> list[Problem]:
    """The problems of all suites with a best known answer, with jerk limits, or without.

    Each is from rest to rest, under the same limits in all segments and without position limits;
    `experiments.replanning` asks the others.
    """
    found = []
    for listed in every_problem().values():
        own = listed.problem
        plain = not own.demands and own.limits.segments is None and not own.has("position")
        if plain and own.has("jerk") == jerk and not ExactJerk().unsupported(own):
            found.append(own)
    return list(filter(find, found))


def record(problem: Problem) -> Record:
    """The best known answer."""
    found = find(problem)
    if found is None:
        raise InvalidInput("problem", "one with a best known answer", value=problem.name)
    return found


def row(kind: str, seed: int) -> Rows:
    """One problem: claim and certificate above what is known, relative, and the motion's pieces."""
    problem, known = drawn(kind, seed)
    if not problem.moving.any():
        return []
    trajectory = ExactJerk().solve(problem).trajectory
    if trajectory is None:
        durations = dict.fromkeys(["claimed", "certified", "late"], np.inf)
        return [durations | dict.fromkeys(["pieces", "brief", "needless"], 0)]
    claimed = trajectory.duration
    certified = verify(problem, trajectory).certified_duration or np.inf
    return [
        {
            "claimed": claimed / known - 1,
            "certified": certified / known - 1,
            "late": certified / claimed - 1,
            "pieces": len(trajectory.lengths),
            "brief": len(brief(trajectory)),
            "needless": needless(problem, trajectory),
        }
    ]


def counted(rows: pd.DataFrame) -> pd.DataFrame:
    """Per kind: problems, those that differ by more than is allowed, and the widest differences."""
    kinds = rows["kind"]
    groups = rows.groupby("kind", sort=False)
    widest = rows[["claimed", "certified"]].abs().max(axis=1)
    allowed = kinds.map({kind: rtol for kind, (_, rtol) in KINDS.items()})
    beyond = ~(widest <= allowed)
    columns = {
        "problems": groups.size(),
        "beyond tolerance": beyond.groupby(kinds, sort=False).sum(),
        "lowest claim": groups["claimed"].min(),
        "highest claim": groups["claimed"].max(),
        "highest certified": groups["certified"].max(),
        "latest": groups["late"].max(),
        "pieces": groups["pieces"].sum(),
        "brief": groups["brief"].sum(),
        "needless": groups["needless"].sum(),
    }
    return pd.DataFrame(columns)


def main(
    share: float = 1.0, output: Path = Path("results/known-optima"), quick: bool = False
) -> None:
    """Solve and compare this share of all problems; `quick`: one in twenty of them."""
    if quick:
        share /= 20
    cells = {}
    for kind, (most, _) in KINDS.items():
        for seed in range(int(np.ceil(share * most))):
            cells[kind, seed] = partial(row, kind, seed)
    table = counted(kept(output / "problems.csv", ["kind", "seed"], cells))
    save_table(table, output / "kinds")
    print(table.to_string(float_format="{:.1e}".format))


if __name__ == "__main__":
    cyclopts.run(main)
