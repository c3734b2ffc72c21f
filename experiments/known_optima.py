"""Is `exact-jerk` right where another method knows the optimum under jerk limits?

    python -m experiments.known_optima               # 500 + 500 + 1000 problems, ten minutes
    python -m experiments.known_optima --share 0.05  # a quick look

Straight lines: all joints move in proportion, forth and back or one way, and the first has the
tightest limits of every kind. So its own optimum is the optimum; one way and symmetric, in closed
form. Nearly straight: waypoints beside such a line by 1e-7 to 1e-3 of its length, against a proved
bound, of the problem or of its first joint alone. Two waypoints: Ruckig.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from baselines.exact.jerk import ExactJerk
from baselines.lower_bound.bound import certify
from baselines.ruckig_ import RuckigStop
from experiments.common.output import save_table
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.core.arrays import Array
from trajopt.planners.rest_to_rest import stop_times

PROBLEMS = {
    "straight": 500,
    "nearly straight": 500,
    "two waypoints": 1000,
}
# Differences that are allowed, relative.
TOLERANCES = {
    "straight": 1e-9,
    "nearly straight": 1e-6,
    "two waypoints": 1e-9,
}
PROOF_GAP = 5e-7  # relative
PROOF_S = 10.0

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


def limited(
    rng: Generator,
    share: Array,
    sides: Array,
) -> Array:
    """Limits for a joint's share of the way; those of all but the first are up to ten times it."""
    wider = 10 ** rng.uniform(0.0, 1.0, len(share))
    wider[0] = 1.0
    along = np.outer(wider * np.abs(share), sides)
    backwards = along[:, ::-1]
    own = np.where(
        share[:, None] < 0,
        backwards,
        along,
    )
    return own * [-1.0, 1.0]


def alone(problem: Problem) -> Problem:
    """The first joint's problem."""
    limits = problem.limits
    first = Limits(
        limits.velocity[:1],
        limits.acceleration[:1],
        limits.jerk[:1],
    )
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
        proof = certify(
            relaxed,
            within=PROOF_GAP,
            time_limit=PROOF_S,
        )
        bounds.append(proof.lower_bound)
        if proof.status == "proved":
            break
    return max(bounds)


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
    problem = random_problem(
        seed,
        waypoints=2,
        jerk=True,
    )
    trajectory = RuckigStop().solve(problem).trajectory
    if trajectory is None:
        return problem, np.nan
    return problem, trajectory.duration


def row(kind: str, seed: int) -> dict[str, object]:
    """One problem: claim and certificate above what is known, relative."""
    problem, known = drawn(kind, seed)
    trajectory = ExactJerk().solve(problem).trajectory
    claimed = np.inf
    certified = np.inf
    if trajectory is not None:
        claimed = trajectory.duration
        certificate = verify(problem, trajectory)
        certified = certificate.certified_duration or np.inf
    return {
        "kind": kind,
        "seed": seed,
        "claimed": claimed / known - 1,
        "certified": certified / known - 1,
    }


def counted(rows: pd.DataFrame) -> pd.DataFrame:
    """Per kind: problems, those that differ by more than is allowed, and the widest differences."""
    kinds = rows["kind"]
    groups = rows.groupby("kind", sort=False)
    differences = rows[["claimed", "certified"]].abs()
    widest = differences.max(axis=1)
    allowed = kinds.map(TOLERANCES)
    beyond = ~(widest <= allowed)
    columns = {
        "problems": groups.size(),
        "beyond tolerance": beyond.groupby(kinds, sort=False).sum(),
        "lowest claim": groups["claimed"].min(),
        "highest claim": groups["claimed"].max(),
        "highest certified": groups["certified"].max(),
    }
    return pd.DataFrame(columns)


def main(share: float = 1.0, output: Path = Path("results/known-optima")) -> None:
    """Solve and compare this share of all problems."""
    cells = []
    for kind, most in PROBLEMS.items():
        count = int(np.ceil(share * most))
        cells += [(kind, seed) for seed in range(count)]
    rows = []
    with console.progress(len(cells)) as advance:
        for cell in cells:
            rows.append(row(*cell))
            advance(1)
    every = pd.DataFrame(rows)
    table = counted(every)
    save_table(every, output / "problems")
    save_table(table, output / "kinds")
    print(table.to_string(float_format="{:.1e}".format))


if __name__ == "__main__":
    cyclopts.run(main)
