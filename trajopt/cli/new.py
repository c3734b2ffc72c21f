"""`trajopt new`: a commented problem file to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.benchmark.store import atomic
from trajopt.cli import console
from trajopt.cli.plan import check_target

_TEXT = """\
# A problem: pass every waypoint in order, from rest to rest, as fast as the limits allow.
#   trajopt plan {file}                        the fastest motion
#   trajopt plan {file} --out motion.yaml      ... as a ROS message
#   trajopt compare {file}                     every planner on it

# A known robot brings its limits and its joints' names; `trajopt list` has them all.
robot = "ur5e"

# One row per waypoint, one number per joint, in the robot's order.
waypoints = [
    [0, -90, 90, -90, -90, 0],
    [40, -70, 80, -100, -90, 20],
    [80, -100, 110, -100, -80, 40],
    [60, -90, 90, -90, -90, 0],
]
units.waypoints = "deg"             # "deg" or "rad"; ["deg", "m"], a unit per joint, if one slides

# For a robot of your own leave out `robot`, and say:
# joint_names = ["shoulder", "elbow", "wrist"]
# units.limits = "rad"              # the same for the limits below, per s, s² and s³

# What is said here counts in place of the robot's. A number is [-number, number].
# [limits]
# velocity = [3.1, 3.1, 3.1, 3.1, 3.1, 3.1]               # rad/s
# acceleration = [5, 5, 5, 5, 5, 5]                       # rad/s²
# jerk = [50, 50, 50, 50, 50, 50]                         # rad/s³; real controllers want some
# position = [[-6, 6], [-6, 6], [-3, 3], [-6, 6], [-6, 6], [-6, 6]]   # rad
"""


def new(
    name: Annotated[str, Parameter(help="The file; .toml is added if it has no ending.")] = (
        "problem.toml"
    ),
    /,
    *,
    force: Annotated[bool, Parameter(negative=(), help="Overwrite the file.")] = False,
) -> int:
    """Write a commented problem file to start from."""
    path = Path(name)
    if not path.suffix:
        path = path.with_suffix(".toml")
    check_target(
        path,
        force=force,
        key="new",
    )
    text = _TEXT.format(file=path)
    atomic.write(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    console.line(f"{path}: edit it, then run: trajopt plan {path}")
    return 0
