"""Do the eight branches of the paper's arm hold, and what do they save?

    python -m experiments.paper_inverse             # 1000 poses, 40 of them with Newton's method
    python -m experiments.paper_inverse --quick     # 50 poses, 2 of them

Random postures within Table 1's ranges give poses, others are where the arm comes from. Both
methods run one after the other in one process, CPU time each: the eight branches in closed form,
and Newton's method from the posture and random ones (the same arm with a twist 1e-11 rad off,
whose inverse is not known in closed form). `inverse.csv` in `--output` has the table.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table
from trajopt.benchmark.suites import catalogue as suite

_OFF_RAD = 1e-11


def main(
    poses: int = 1000, *, quick: bool = False, output: Path = Path("results/paper_inverse")
) -> None:
    """Measure, and write and print the table.

    Args:
        poses: How many poses; Newton's method gets a twenty-fifth of them.
        quick: 50 poses.
        output: The folder.
    """
    if quick:
        poses = 50
    robot = suite.robot("six-axis")
    newton = replace(robot, alpha=robot.alpha + _OFF_RAD * np.eye(6)[1])
    low, high = robot.joint_range.T
    q, posture = np.random.default_rng(0).uniform(low, high, (2, poses, 6))
    hands = robot.forward(q)

    before = time.process_time()
    found = robot.branches(hands)
    each = (time.process_time() - before) / poses
    missed = np.abs(robot.forward(found.q) - hands[:, None]).max(axis=(-1, -2))
    reached = found.miss < 1e-9
    rows = [
        {
            "method": "eight branches at once",
            "poses": poses,
            "CPU ms a pose": 1e3 * each,
            "largest miss": missed[reached].max(),
            "farther than the other's": "",
        }
    ]

    some = range(max(1, poses // 25))
    answers = {}
    with progress(2, "methods") as advance:
        for name, arm in (("nearest of the branches", robot), ("nearest by Newton", newton)):
            before = time.process_time()
            answers[name] = np.array([arm.nearest(hands[i], posture[i]) for i in some])
            each = (time.process_time() - before) / len(some)
            apart = np.abs(robot.forward(answers[name]) - hands[list(some)]).max()
            row = {
                "method": name,
                "poses": len(some),
                "CPU ms a pose": 1e3 * each,
                "largest miss": apart,
            }
            rows.append(row)
            advance(1)
    far = [np.linalg.norm(own - posture[: len(some)], axis=1) for own in answers.values()]
    for row, own, other in zip(rows[1:], far, reversed(far), strict=True):
        row["farther than the other's"] = str(int(np.sum(own > other + 1e-6)))
    table = pd.DataFrame(rows)
    save_table(table, output / "inverse")
    print(table.to_string(index=False, float_format="{:.3g}".format))
    counts = np.bincount(reached.sum(axis=1), minlength=9)
    print(f"of {poses} poses {counts[8]} have eight solutions, {counts[4]} have four")
    print(f"within the ranges: {found.within[reached].sum() / poses:.2f} a pose")


if __name__ == "__main__":
    cyclopts.run(main)
