"""What does the verifier make of trajectories that try to cheat it?

    python -m experiments.tricks       # 139 tricks, a second

Every trick claims less than an optimum known in closed form. *Claimed* and *certified* are that far
above the optimum, in percent: a claim is negative, a certified duration is not by more than
rounding, and where the verifier certifies none, its flaw says why. The table goes to `tricks.csv`
and `.md` in `--output`. Exit code 1 if a trick succeeds.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from experiments.common.tricks import Trick, tricks
from trajopt.judging.verification import verify

CERTIFIED_BELOW = 1e-9  # of the optimum: what rounding may gain


def judged(trick: Trick) -> dict[str, object]:
    """What a trick claims and what is certified, percent above the optimum, or its flaws."""
    certificate = verify(trick.problem, trick.trajectory)
    return {
        "trick": trick.name,
        "optimum s": trick.optimum,
        "claimed %": above(trick.trajectory.duration, trick.optimum),
        "certified %": above(certificate.certified_duration, trick.optimum),
        "flaw": "; ".join(certificate.flaws),
    }


def above(duration: float | None, optimum: float) -> float | None:
    """How far a duration is above the optimum, percent."""
    if duration is None:
        return None
    return 100 * (duration / optimum - 1)


def table(attempts: Sequence[Trick]) -> pd.DataFrame:
    """A row per trick."""
    rows = [judged(trick) for trick in attempts]
    return pd.DataFrame(rows)


def main(output: Path = Path("results/tricks")) -> None:
    """Judge every trick, write the table and print it."""
    rows = table(tricks())
    save_table(rows, output / "tricks")
    print(rows.to_string(index=False, na_rep="", float_format="{:.3g}".format))
    succeeded = rows["certified %"] < -100 * CERTIFIED_BELOW
    print(f"certified below the optimum: {succeeded.sum()} of {len(rows)}")
    if succeeded.any():
        sys.exit(1)


if __name__ == "__main__":
    cyclopts.run(main)
