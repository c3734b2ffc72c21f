"""What does a limit of the torques cost, and how near do planners come to what is possible?

    python -m experiments.torque            # fifteen problems, a quarter of an hour
    python -m experiments.torque --quick    # two links alone, half a minute
    python -m experiments.torque --cops-arm # the robot arm of COPS, half a minute
    python -m experiments.torque --own      # TOPP-RA's own torque constraint, ten seconds
    python -m experiments.torque --figure   # the figure of the page on it, from the table

Each problem is that of an arm through four poses that are a hand's way apart, with the torques that
its maker states or a share of them, and with a payload. `a` is the limit of acceleration: the
maker's, or 40 rad/s², with which torques alone decide. The bound is proved without the torques, so
it says how much they cost at most. Planners: `collocation-refined`, which chooses the path;
`along`, the fastest timing of a spline; `exact` without the limit, slowed down into it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
import toppra
from matplotlib.figure import Figure
from toppra import constraint

from baselines.along.planner import Along
from experiments.common.output import progress, save_table
from experiments.tool_speed import certified
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.arms import FAST, fast, near
from trajopt.core.arrays import Array
from trajopt.core.bodies import Masses, body
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import KINDS, JointState, Quantity, Row, RowLimit, Torque
from trajopt.planners.registry import load
from trajopt.views.figures import plots
from trajopt.views.figures.style import BLACK, BLUE, GREEN, VERMILION

PLANNED = "collocation-refined:starts=1,refinements=1"
PROVED = "prove:time_limit=20"
GRIDPOINTS = 1000
_BRIEF = 1e-9  # s, pieces that are rounding
SHARES = (0.4, 0.45, 0.5, 0.6, 0.75, 1.0, 1.5, 2.0)


def two_links() -> Problem:
    """Return two links of 0.5 m and 0.4 m that swing up."""
    origins = np.tile(np.eye(4), (2, 1, 1))
    origins[1, 0, 3] = 0.5
    tool = np.eye(4)
    tool[0, 3] = 0.4
    bodies = [
        body(2.0, [0.25, 0, 0], [0, 0, 0, 0.04, 0, 0.04]),
        body(1.2, [0.2, 0, 0], [0, 0, 0, 0.016, 0, 0.016]),
    ]
    rubbing = np.full(2, 0.1)
    masses = Masses(np.array(bodies), rubbing, rubbing, np.array([40.0, 9.0]), payload=1.0)
    axes = np.tile([0.0, -1.0, 0.0], (2, 1))
    chain = LinkChain(origins, axes, np.zeros(2, dtype=bool), tool, masses)
    waypoints = np.radians([[-90, 0], [0, 40], [60, -30], [90, 20]])
    return Problem(waypoints, Limits([6.0, 6.0], [FAST, FAST]), "two links", chain=chain)


@dataclass(frozen=True)
class ArmCase:
    """An arm, whether its acceleration limits are `FAST`, share of torque, and payload, kg."""

    arm: str
    fast: bool
    share: float
    payload: float

    @property
    def named(self) -> dict[str, str]:
        """Return the cells that say which case it is."""
        return {
            "problem": self.arm if self.arm == "two links" else f"{self.arm}-near",
            "a, rad/s²": f"{FAST:g}" if self.fast else "own",
            "torque, %": f"{100 * self.share:g}",
            "payload, kg": f"{self.payload:g}",
        }

    def problems(self) -> tuple[Problem, Problem]:
        """Return the problem without the torques, and with them."""
        free = two_links() if self.arm == "two links" else near(self.arm)
        if self.fast:
            free = fast(free)
        assert free.chain is not None
        chain = free.chain.carrying({"mass": self.payload}) if self.payload else free.chain
        limits = Limits(**free.limits.kinds, torque=f"{100 * self.share:g} %")
        return free, replace(free, limits=limits, chain=chain)


CASES = (
    ArmCase("two links", False, 1.0, 0),
    ArmCase("two links", False, 0.6, 0),
    ArmCase("two links", False, 1.0, 1.0),
    ArmCase("ur5e", False, 1.0, 0),
    ArmCase("ur5e", False, 0.6, 0),
    ArmCase("ur5e", False, 1.0, 5),
    ArmCase("ur5e", True, 1.0, 0),
    ArmCase("ur5e", True, 0.6, 0),
    ArmCase("ur5e", True, 1.0, 5),
    ArmCase("franka-panda", False, 1.0, 0),
    ArmCase("franka-panda", False, 0.6, 0),
    ArmCase("franka-panda", False, 1.0, 3),
    ArmCase("kinova-gen3", True, 1.0, 0),
    ArmCase("kinova-gen3", True, 0.6, 0),
    ArmCase("kinova-gen3", True, 1.0, 2),
)


TOPPRA_CASES = (*CASES[:3], *CASES[7:9])


def row(case: ArmCase, planner: str) -> dict[str, object]:
    """Return the row of one case."""
    free, problem = case.problems()
    planned, seconds, judging = certified(problem, problem, planner)
    path, _, _ = certified(problem, problem, "along")
    slowed, _, _ = certified(problem, free, "exact")
    bound = load(PROVED).solve(problem).lower_bound or np.nan
    best = min(planned, path)
    return {
        **case.named,
        "without it, s": certified(free, free, "exact")[0],
        "proved bound, s": bound,
        "best, s": best,
        "above the bound, %": 100 * (best / bound - 1),
        "along a spline, s": path,
        "exact, slowed down, s": slowed,
        "CPU to plan, s": seconds,
        "CPU to judge, s": judging,
    }


def toppra_row(case: ArmCase) -> dict[str, object]:
    """Return the row of TOPP-RA's own torque constraint beside `along`, on the same spline.

    Its torques are those of our equations; it knows Coulomb friction, and no viscous one.
    """
    _, problem = case.problems()
    limit = problem.limits.kinds["torque"]
    assert isinstance(limit, Torque)
    forces = replace(limit.dynamics, damping=np.zeros(problem.joints)).forces

    def inverse(q: Array, v: Array, a: Array) -> Array:
        return np.array(forces(list(q), list(v), list(a)), dtype=float)

    chords = np.linalg.norm(np.diff(problem.waypoints, axis=0), axis=1)
    knots = np.append(0.0, np.cumsum(chords))
    torque = limit.column("torque")
    between = constraint.DiscretizationType.Interpolation
    asked = [
        constraint.JointVelocityConstraint(problem.limits.velocity),
        constraint.JointAccelerationConstraint(problem.limits.acceleration, between),
        constraint.JointTorqueConstraint(
            inverse, np.stack([-torque, torque], axis=1), limit.column("friction"), between
        ),
    ]
    grid = np.linspace(0, knots[-1], GRIDPOINTS + 1)
    spline = toppra.SplineInterpolator(knots, problem.waypoints)
    timed = toppra.algorithm.TOPPRA(
        asked, spline, gridpoints=grid, parametrizer="ParametrizeConstAccel"
    ).compute_trajectory(0, 0)
    motion = sampled(timed, knots)
    certificate = verify(problem, motion)
    path = Along(knots="chord", ends="not-a-knot").solve(problem).trajectory
    return {
        **case.named,
        "toppra, claimed, s": motion.duration,
        "its torque, of limit": certificate.uses["torque"].value,
        "certified, s": certificate.certified_duration,
        "along, certified, s": None if path is None else verify(problem, path).certified_duration,
    }


def sampled(timed: Any, knots: Array) -> Trajectory:
    """Return TOPP-RA's motion: of degree 6 between its gridpoints, as a cubic of a quadratic."""
    breaks, places = np.array(timed._ts), np.array(timed._ss)
    kept = np.append(True, np.diff(breaks) > _BRIEF)
    breaks, passed = breaks[kept], np.interp(knots, places, breaks)
    lengths = np.diff(breaks)
    nodes = (1 - np.cos(np.pi * np.arange(7) / 6)) / 2
    inside = np.clip(nodes, 1e-12, 1 - 1e-12)
    values = timed.eval(np.ravel(breaks[:-1, None] + inside * lengths[:, None]))
    tables = values.reshape(len(lengths), 7, -1).swapaxes(0, 1)
    flat = np.linalg.solve(np.vander(nodes, 7), tables.reshape(7, -1))
    powers = lengths[:, None] ** np.arange(6, -1, -1.0)[:, None, None]
    return Trajectory(breaks, flat.reshape(tables.shape) / powers, passed)


def curve(case: ArmCase) -> list[float]:
    """Return durations along a spline, s, by share of the torque; NaN where an arm cannot rest."""
    found = []
    for share in SHARES:
        try:
            _, problem = replace(case, share=share).problems()
        except InvalidInput:
            found.append(np.nan)
            continue
        found.append(certified(problem, problem, "along")[0])
    return found


@plots.styled
def drawn(table: pd.DataFrame) -> Figure:
    """Draw durations against the torques: along a spline, the best of the table, and the bound."""
    figure = Figure(figsize=(5.4, 3.6), layout="constrained")
    axes = figure.subplots()
    shown = {
        "two links": (ArmCase("two links", False, 1.0, 0), BLUE),
        "two links, 1 kg": (ArmCase("two links", False, 1.0, 1.0), VERMILION),
        "UR5e, 5 kg": (ArmCase("ur5e", True, 1.0, 5), GREEN),
    }
    percent = 100 * np.array(SHARES)
    for name, (case, colour) in shown.items():
        axes.plot(percent, curve(case), color=colour, lw=0.8, ls="--")
        arm = {key: value for key, value in case.named.items() if key != "torque, %"}
        same = [table[key].astype(str) == value for key, value in arm.items()]
        own = table[np.logical_and.reduce(same)]
        axes.plot(own["torque, %"], own["best, s"], color=colour, marker="o", ls="", label=name)
        bound = own["proved bound, s"].min()
        axes.axhline(bound, color=colour, lw=0.6, ls=":")
    axes.plot([], [], color=BLACK, lw=0.8, ls="--", label="along a spline")
    axes.plot([], [], color=BLACK, lw=0.6, ls=":", label="bound without torques")
    axes.set_xlabel("torques, % of those stated")
    axes.set_ylabel("duration, s")
    axes.set_ylim(bottom=0)
    axes.legend()
    return figure


class CopsArm(RowLimit):
    """Forces that slide, turn and tilt the rod of the robot arm of COPS (Dolan and Moré 2000)."""

    key = "cops_arm"
    degree = 2
    fields = (Quantity("length", metres=1, common=True), Quantity("force", widens=1))

    def rows(self, at: JointState) -> Iterator[Row]:
        """Yield each force over its limit."""
        length = float(self.column("length")[0])
        rho, _, phi = at.q
        inertia = ((length - rho) ** 3 + rho**3) / 3
        for joint, size in enumerate((length, inertia * np.sin(phi) ** 2, inertia)):
            yield Row(size * at.a[joint] / self.column("force")[joint], -1.0, 1.0, joint=joint)


del KINDS[CopsArm.key]  # known where it is asked for


def cops() -> Problem:
    """Return the robot arm of COPS; published: 9.1414 s on a fine grid."""
    KINDS[CopsArm.key] = CopsArm
    ends = [[4.5, 0, np.pi / 4], [4.5, 2 * np.pi / 3, np.pi / 4]]
    limits = Limits(
        [9.0] * 3,
        [1.0] * 3,
        position=[[0, 5], [-np.pi, np.pi], [0, np.pi]],
        cops_arm={"length": 5.0, "force": [1.0] * 3},
    )
    return Problem(ends, limits, "COPS robot arm", joint_units=["m", "rad", "rad"])


def main(
    output: Path = Path("results/torque"),
    *,
    quick: bool = False,
    arm: list[str] | None = None,
    cops_arm: bool = False,
    own: bool = False,
    figure: bool = False,
    planner: str = PLANNED,
) -> None:
    """Plan every problem in each way, or the first if `quick`; print the table.

    Args:
        output: Folder of the table.
        quick: Two links alone.
        arm: These arms alone.
        cops_arm: The robot arm of COPS alone.
        own: TOPP-RA's own torque constraint alone.
        figure: Draw the figure from the table that is in the folder.
        planner: What plans under the limit.
    """
    if figure:
        plots.save(drawn(pd.read_csv(output / "torque.csv")), output / "torque")
        return
    if cops_arm:
        problem = cops()
        seconds, cpu, _ = certified(problem, problem, "collocation-refined")
        print(f"{problem.name}: {seconds:.5f} s certified, {cpu:.0f} CPU s; published 9.1414 s")
        return
    if own:
        found = pd.DataFrame([toppra_row(case) for case in TOPPRA_CASES])
        save_table(found, output / "torque-toppra")
        print(found.to_string(index=False))
        return
    rows = []
    cases = CASES[:1] if quick else [case for case in CASES if not arm or case.arm in arm]
    with progress(len(cases), "problems") as advance:
        for case in cases:
            rows.append(row(case, planner))
            save_table(pd.DataFrame(rows), output / "torque")
            advance(1)
    print(pd.DataFrame(rows).to_string(index=False))


if __name__ == "__main__":
    cyclopts.run(main)
