"""Can the judge be cheated with velocities at the ends? Motions that claim less than the optimum.

    python tests/soak.py moving_ends           # 500 motions, some minutes
    python tests/soak.py moving_ends --quick   # 20 motions

A dilation changes the velocities at the ends, and that could be used to cheat. Take a motion that
begins with a velocity away from its goal and exceeds its acceleration limit by 125 %. Dilated by
1.5 it keeps the limit, and takes 17 % less than the optimum. Here random problems of two waypoints
begin and end in motion, half of them with jerk limits. Ruckig finds their optima. Each motion is
planned for limits that are wider by 1e-12 to 125 %, or for other velocities at the ends, or is the
optimum run faster. It is judged as it is, with very wide tolerances, and as the certified motion,
judged again.

*Claimed* and *certified* are percent above the optimum. Exit code 1 if a motion is certified more
than 1e-9 below the optimum.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.ruckig_ import RuckigStop
from experiments.common.output import say
from soaks import soak_report
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Tolerance
from trajopt.judging.verification import certified, verify

CERTIFIED_BELOW = 1e-9  # a smaller amount below the optimum, relative, is rounding
WIDE = Tolerance(position=1e9, position_limit=1e9, jump=1e9)
FAMILIES = ("wider limits", "other velocities at the ends", "run faster")


def drawn(seed: int, *, waypoints: int = 2, joints: int | None = None, jerk: bool) -> Problem:
    """Return a random problem that begins and ends in motion, up to 70 % of its velocity limits.

    With jerk limits it begins accelerating too, so that velocity and acceleration can be kept.
    """
    rng = np.random.default_rng([51, seed])
    joints = joints or int(rng.integers(1, 5))
    V = rng.uniform(0.5, 3, joints)
    A = rng.uniform(1, 8, joints)
    steps = rng.normal(0, 1, (waypoints - 1, joints))
    rows = np.vstack([np.zeros(joints), np.cumsum(steps, axis=0)])
    demands = {
        key: V * rng.uniform(-0.7, 0.7, joints) for key in ("start_velocity", "end_velocity")
    }
    J = A * rng.uniform(4, 30, joints) if jerk else None
    if J is not None:
        for end in ("start", "end"):
            room = V - np.abs(demands[f"{end}_velocity"])
            most = np.minimum(A, np.sqrt(2 * J * room))
            demands[f"{end}_acceleration"] = most * rng.uniform(-0.6, 0.6, joints)
    return Problem(rows, Limits(V, A, J), name=f"moving-{seed}", demands=demands)


def halves(problem: Problem, motion: Trajectory, time: float) -> tuple[Problem, Problem]:
    """Return the problems before and after a time, in the motion's state at that time.

    Args:
        problem: Begins or ends in motion.
        motion: Its motion.
        time: s; a waypoint's time, or one within a segment.
    """
    kinds = {key.split("_")[1] for key in problem.demands}
    orders = {"velocity": 1, "acceleration": 2}
    before, after = (np.sign(motion.waypoint_times - time) == side for side in (-1, 1))
    at = motion.waypoint_times == time
    place = problem.waypoints[at] if at.any() else motion(time)[None]
    rows = [problem.waypoints[before], place], [place, problem.waypoints[after]]
    found = []
    for waypoints, end, other in zip(rows, ("end", "start"), ("start", "end"), strict=True):
        demands = {f"{other}_{kind}": problem.demands[f"{other}_{kind}"] for kind in kinds}
        for kind in kinds:
            limits = getattr(problem.limits, kind)
            demands[f"{end}_{kind}"] = np.clip(motion(time, orders[kind]), *limits.T)
        found.append(Problem(np.vstack(waypoints), problem.limits, demands=demands))
    return found[0], found[1]


def optimum(problem: Problem) -> Trajectory | None:
    """Return the fastest motion of a problem of two waypoints, by Ruckig."""
    return RuckigStop().solve(problem).trajectory


def cheats(seed: int) -> Iterator[tuple[str, Problem, Trajectory, float]]:
    """Yield a motion of each family that may claim less than the optimum, s, of one problem."""
    problem = drawn(seed, jerk=seed % 2 == 1)
    best = optimum(problem)
    if best is None:
        return
    rng = np.random.default_rng([52, seed])
    excess = 10 ** rng.uniform(-12, 0.1)
    limits = problem.limits
    wider = replace(
        limits,
        velocity=limits.velocity * (1 + excess) ** 0.5,
        acceleration=limits.acceleration * (1 + excess),
        jerk=limits.jerk * (1 + excess) ** 1.5,
    )
    ends = {key: own * (1 + _changed(rng)) for key, own in problem.demands.items()}
    planned = [
        optimum(replace(problem, limits=wider)),
        optimum(replace(problem, limits=wider, demands=ends)),
        best.dilated(1 / (1 + excess)),
    ]
    for family, motion in zip(FAMILIES, planned, strict=True):
        if motion is not None:
            yield family, problem, motion, best.duration


def _changed(rng: np.random.Generator) -> float:
    return float(rng.choice([-1, 1]) * 10 ** rng.uniform(-9, 0))


def judged(problem: Problem, motion: Trajectory, best: float) -> dict[str, object]:
    """Return a motion's claim, and the least certified duration of all three ways of judging."""
    durations: list[float] = []
    for tolerance in (None, WIDE):
        duration = verify(problem, motion, tolerance).certified_duration
        durations.append(np.inf if duration is None else duration)
    again = certified(problem, motion)
    if again is not None:
        durations.append(verify(problem, again).certified_duration or np.inf)
    return {
        "optimum s": best,
        "claimed %": 100 * (motion.duration / best - 1),
        "certified %": 100 * (np.min(durations) / best - 1),
    }


def rows(motions: int) -> pd.DataFrame:
    """Return a row per motion, for a number of motions."""
    found: list[dict[str, object]] = []
    seed = 0
    while len(found) < motions:
        for family, problem, motion, best in cheats(seed):
            found.append({"family": family, "seed": seed, **judged(problem, motion, best)})
        seed += 1
    return pd.DataFrame(found[:motions])


def main(
    motions: int = 500, output: Path = Path("results/moving_ends"), quick: bool = False
) -> None:
    """Judge every motion, 20 at most if `quick`; write the table and print it."""
    motions = min(motions, 20) if quick else motions
    say(f"{motions} motions in all")
    found = rows(motions)
    believed = found["certified %"] < -100 * CERTIFIED_BELOW
    kept = found[np.isfinite(found["certified %"])]
    said = kept.groupby("family", sort=False)["certified %"].agg(["size", "min", "median", "max"])
    print("certified, percent above the optimum:")
    print(said.to_string(float_format="{:.2e}".format))
    soak_report.conclude(found, believed, output / "moving_ends")
