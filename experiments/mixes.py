"""Make the parts of the suite `mixes`: optimal motions, cut in their own state.

    python -m experiments.mixes        # some minutes

A drawn problem of the suite keeps its tolerances, least times, limits and the states at its ends.
Its motion by `exact` or `exact-jerk` is cut at a cycle of a controller. The part after the cut is a
problem, or that before it, by turns. Its minimum time is what the part took, or less.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cyclopts
import numpy as np

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from experiments.common.output import say
from trajopt.benchmark.suites import mixes
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging.verification import verify

PARTS = 12
CYCLE_S = 1e-3
_BESIDE_S = 1e-6  # a waypoint that is nearer to the cut would leave a segment of rounding
_NO_SLOWER = 1e-9  # relative: the motion itself keeps its limits


def parts() -> Iterator[tuple[Problem, float]]:
    """Yield a part of each drawn problem's motion, and what it took there, s."""
    for index in itertools.count():
        drawn = mixes.draw(index)
        whole = replace(drawn, demands=mixes.inherited(drawn))
        motion = (ExactJerk() if whole.has("jerk") else Exact()).solve(whole).trajectory
        if motion is None or not verify(whole, motion).dilation <= 1 + _NO_SLOWER:
            continue
        rng = np.random.default_rng([mixes.VERSION, 61, index])
        cut = float(np.round(rng.uniform(0.02, 0.98) * motion.duration / CYCLE_S) * CYCLE_S)
        if np.abs(motion.waypoint_times - cut).min() < _BESIDE_S:
            continue
        try:
            part = mixes.halves(whole, motion, cut)[index % 4 > 1]
        except InvalidInput:  # it stands still
            continue
        took = motion.duration - cut if index % 4 > 1 else cut
        source = f"experiments.mixes, version {mixes.VERSION}, index {index}, cut at {cut:.6g} s"
        yield replace(part, name=f"mixes-part-{index:02}", source=source), took


def main(output: Path = Path("data/mixes"), quick: bool = False) -> None:
    """Write the first parts as problem files, two of them if `quick`."""
    output.mkdir(parents=True, exist_ok=True)
    for part, took in itertools.islice(parts(), 2 if quick else PARTS):
        (output / f"{part.name}.toml").write_text(part.to_toml())
        size = f"{len(part.waypoints)} waypoints, {part.joints} joints"
        say(f"{part.name}: {size}, {took:.9g} s at most")


if __name__ == "__main__":
    cyclopts.run(main)
