"""How far do a controller's quintics exceed the acceleration of a MoveIt trajectory?

    python -m experiments.moveit_reports    # half a minute of CPU
    python -m experiments.moveit_reports --quick    # three goals at one factor

A fuzzer's reports of June 2026 (moveit/moveit2 #3778, #3779, moveit/moveit2_tutorials #1096 to
#1098) name goals, limits and the largest value that a Panda's controller stated. They name no path:
a random tree's differs from run to run. Here the Panda goes from its ready pose to the goals of
#1097 and #1098 in turn, along straight lines in joint space, two lines at a time with their corner
rounded by a circle that leaves it by 0.1 rad, TOTG's default. The fastest timing of that path,
which is what TOTG computes, is sampled every 0.1 s, TOTG's default, with velocity and acceleration.
`joint_trajectory_controller` joins such samples by quintics, and states their acceleration.

The factors scale both limits, as MoveIt's requests do. The table has, for each factor, the use of
the acceleration limits at the samples and on the quintics, and the largest use of the velocity
limits. No motion within its acceleration limits has quintics above `worst_factor` times the limit:
that bound needs no path.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from baselines.topp_ra import along
from experiments.common.output import progress, save_table
from trajopt import Limits, Problem, Trajectory
from trajopt.benchmark.suites import catalogue
from trajopt.core.arrays import Array
from trajopt.core.chain import LinkChain
from trajopt.judging.verification import verify

# moveit_resources@ef5836dd panda_moveit_config/config/joint_limits.yaml; rad/s, rad/s².
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0])
# The same repository's SRDF, rad.
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
# Goals of the hand, m, as far as the threads' stored text reaches.
GOALS = np.array(
    [
        # moveit2_tutorials #1097
        [-0.3919, 0.1086, 0.4126],
        [-0.4120, 0.3737, 0.4803],
        [0.1720, -0.0807, 0.6223],
        [0.6000, 0.0000, 0.5000],
        [0.7500, 0.0000, 0.5000],
        [-0.5080, 0.3852, 0.7268],
        # moveit2_tutorials #1098
        [0.2968, 0.2449, 0.4064],
        [0.2207, 0.0201, 0.4907],
        [0.2755, -0.2108, 0.5855],
        [0.4444, -0.3774, 0.5840],
        [0.6000, -0.4290, 0.4879],
        [0.6000, -0.3498, 0.4054],
    ]
)
FACTORS = (1.0, 0.5, 0.2, 0.1)
TOLERANCE = 0.1  # of a corner, rad: DEFAULT_PATH_TOLERANCE
STEP = 0.1  # s: TOTG's resample_dt
_ARC = 9  # samples of a circle, joined by quintics


def worst_factor(points: int = 2001) -> float:
    """Return how far quintics through a motion's states exceed its acceleration, at most.

    Over an interval of length 1 a motion `|q̈| ≤ 1` from rest moves by `∫ (1 − s) q̈(s) ds` and
    gains `∫ q̈(s) ds`. The quintic's acceleration at `t` is linear in these two and in the
    accelerations at both ends: its largest value is `∫ |kernel(t, s)| ds + |c₀(t)| + |c₁(t)|`.
    """
    t = np.linspace(0, 1, points)
    moved = 60 * t - 180 * t**2 + 120 * t**3
    gained = -24 * t + 84 * t**2 - 60 * t**3
    first = 1 - 9 * t + 18 * t**2 - 10 * t**3
    last = 3 * t - 12 * t**2 + 10 * t**3
    kernel = np.abs(moved[:, None] * (1 - t) + gained[:, None])
    within = (kernel[:, :-1] + kernel[:, 1:]).sum(axis=1) / 2 / (points - 1)
    return float((within + np.abs(first) + np.abs(last)).max())


def reached(chain: LinkChain, goal: Array) -> Array:
    """Return the joint positions nearest to the ready pose that put the flange at a goal, rad."""
    answer = minimize(
        lambda q: ((q - READY) ** 2).sum(),
        READY,
        constraints={"type": "eq", "fun": lambda q: chain.forward(q)[:3, 3] - goal},
    )
    return np.asarray(answer.x)


def rounded(corners: Array) -> Trajectory:
    """Return the path of two lines and TOTG's circle between them, over its length, rad."""
    start, corner, end = corners
    sides = np.diff(corners, axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    before, after = sides / lengths[:, None]
    angle = np.arccos(np.clip(before @ after, -1, 1))
    distance = min(lengths.min() / 2, TOLERANCE / np.tan(angle / 4))
    radius = distance / np.tan(angle / 2)
    inward = (after - before) / np.linalg.norm(after - before)
    centre = corner + inward * radius / np.cos(angle / 2)
    turned = np.linspace(-angle / 2, angle / 2, _ARC)[:, None]
    forward = (before + after) / np.linalg.norm(before + after)
    away = forward * np.sin(turned) - inward * np.cos(turned)
    tangent = forward * np.cos(turned) + inward * np.sin(turned)
    begin, finish = corner - distance * before, corner + distance * after
    pieces = [
        _piece([0, lengths[0] - distance], [start, begin], [before, before], 0 * sides),
        _piece(
            radius * (turned.ravel() + angle / 2), centre + radius * away, tangent, -away / radius
        ),
        _piece([0, lengths[1] - distance], [finish, end], [after, after], 0 * sides),
    ]
    breaks = np.r_[0, np.cumsum(np.concatenate([np.diff(piece.breaks) for piece in pieces]))]
    coefficients = np.concatenate([piece.coefficients for piece in pieces], axis=1)
    return Trajectory(breaks, coefficients, breaks[[0, -1]])


def _piece(at: ArrayLike, positions: ArrayLike, slopes: ArrayLike, bends: ArrayLike) -> Trajectory:
    return Trajectory.from_samples(at, positions, slopes, bends, interpolation="quintic")


def sampled(motion: Trajectory) -> Trajectory:
    """Return the quintics through a motion's states every 0.1 s, and at its end."""
    steps = np.arange(0, motion.duration, STEP)
    times = np.r_[steps, motion.duration]
    return _piece(times, *(motion(times, order) for order in range(3)))


def main(*, output: Path = Path("results/moveit-reports"), quick: bool = False) -> None:
    """Run all, then write and print the table.

    Args:
        output: The folder of the table.
        quick: Three goals at one factor.
    """
    chain = catalogue.load("robots-franka-panda-w4").chain
    assert chain is not None
    goals, factors = (GOALS[:3], FACTORS[:1]) if quick else (GOALS, FACTORS)
    stops = [READY, *(reached(chain, goal) for goal in goals)]
    moves = [np.array(stops[i : i + 3]) for i in range(len(stops) - 2)]
    rows = []
    with progress(len(factors) * len(moves), "motions") as advance:
        for factor in factors:
            limits = Limits(factor * VELOCITY, factor * ACCELERATION)
            uses = []
            for corners in moves:
                path = rounded(corners)
                problem = Problem(path([0, path.duration]), limits)
                motion = along(problem, path, gridpoints=4000).trajectory
                assert motion is not None
                states = np.abs(motion(np.arange(0, motion.duration, STEP), 2))
                certificate = verify(problem, sampled(motion))
                assert certificate.acceleration is not None
                at_samples = (states / limits.acceleration[:, 1]).max()
                uses.append(
                    (at_samples, certificate.acceleration.value, certificate.velocity.value)
                )
                advance(1)
            at_samples, on_quintics, velocity = np.array(uses).T
            rows.append(
                {
                    "factor": factor,
                    "motions": len(moves),
                    "at the samples": at_samples.max(),
                    "on the quintics, median": np.median(on_quintics),
                    "on the quintics, most": on_quintics.max(),
                    "most there can be": worst_factor(),
                    "velocity on the quintics, most": velocity.max(),
                }
            )
    table = pd.DataFrame(rows)
    save_table(table, output / "moveit-reports")
    print(table.to_string(index=False))


if __name__ == "__main__":
    cyclopts.run(main)
