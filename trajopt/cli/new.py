"""`trajopt new`: a problem file of waypoints and limits, or a commented one to start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trajopt.benchmark.store import atomic
from trajopt.cli import asked, console
from trajopt.cli.asked import NO_FLAGS, RobotFlags
from trajopt.cli.plan import check_target
from trajopt.core import problem_file
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem

_HEAD = """\
# A problem: pass every waypoint in order, from rest to rest, as fast as the limits allow.
#   trajopt plan {file}                        the fastest motion
#   trajopt plan {file} --out motion.yaml      ... as a ROS message
#   trajopt compare {file}                     every planner on it

"""
_EXAMPLE = """\
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

{demands}

# What is said here counts in place of the robot's. A number is [-number, number].
# [limits]
# velocity = [3.1, 3.1, 3.1, 3.1, 3.1, 3.1]               # rad/s
# acceleration = [5, 5, 5, 5, 5, 5]                       # rad/s²
# jerk = [50, 50, 50, 50, 50, 50]                         # rad/s³; real controllers want some
# position = [[-6, 6], [-6, 6], [-3, 3], [-6, 6], [-6, 6], [-6, 6]]   # rad
# tool_speed = 0.25                                       # m/s, by the robot's link frames
# link_speed.elbow_joint = 0.5                            # m/s, of the link that this joint moves
# torque = [150, 150, 150, 28, 28, 28]                    # N m, by its masses; or true, or "60 %"
# # Velocity that falls near joint ends: falling_velocity = true is the robot's own (franka-fr3),
# # or a table with offset, deceleration and position.

# # Slower through one section: what a segment says counts in place of [limits], there.
# [[limits.segment]]
# number = 2                                              # from 1
# velocity = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]               # rad/s; or most other kinds

# # What the tool carries, for torques.
# [payload]
# mass = 3                                                # kg
"""


def new(
    name: str = ("problem.toml"),
    waypoints: str | None = None,
    /,
    *,
    robot: RobotFlags = NO_FLAGS,
    force: bool = False,
) -> int:
    """Write a problem file: of waypoints and limits, or a commented one to start from.

    Args:
        name: The file; .toml is added if it has no ending.
        waypoints: Waypoints to write with limits; by default an example's.
        force: Overwrite the file.
    """
    path = Path(name)
    if not path.suffix:
        path = path.with_suffix(".toml")
    if path.suffix != ".toml":
        right = "a problem file (.toml), and behind it the waypoints that the limits are for"
        raise InvalidInput("NAME", right, value=name)
    if waypoints is None and robot.said:
        right = f"a file of them, for the limits: trajopt new {path} waypoints.csv …"
        raise InvalidInput("waypoints are missing", right)
    text = _EXAMPLE.replace("{demands}", _demands())
    if waypoints is not None:
        problem = asked.problem(waypoints, robot)
        units = asked.units(waypoints, robot)
        text = _stated(replace(problem, name=path.stem), robot, units)
    check_target(path, force=force, key="NAME")
    whole = _HEAD.format(file=path) + text
    atomic.write(path, lambda temporary: temporary.write_text(whole, encoding="utf-8"))
    console.line(f"{path}: edit it, then run: trajopt plan {path}")
    return 0


def _demands() -> str:
    """Return a commented line for each demand of a route."""
    lines = [f"# {own.example:<41} # {own.meaning}" for own in DEMANDS.values() if own.example]
    return "\n".join(["# The way may ask for more, in the units of waypoints and limits:", *lines])


def _stated(problem: Problem, robot: RobotFlags, units: Sequence[str]) -> str:
    """Return the text of a problem file; limits of a built-in arm are given by its name."""
    if robot.limits is None and robot.robot is not None:
        return f'robot = "{robot.robot}"\n{problem_file.text(problem, units)}'
    return problem_file.text(problem, units)
