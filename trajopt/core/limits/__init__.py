"""Kinds of limits, a class each; no other module depends on their names.

In reading order:

- `limit`: what a kind of limit must offer, and the list of all kinds;
- `rows`: the inequalities that a kind asks for at every instant;
- `fields`: the numbers of a kind, declared;
- `row_limit`: a kind that is judged by its rows, too, with `enclosures`: bounds of a formula;
- `peaks`: the exact peak of a derivative over a whole motion;
- `joint_limit`: an interval for a joint's position or one of its derivatives;
- `strangers`: kinds of other people's packages and files;
- `beside_resting`: a limit of several joints, some of which rest;
- `limits`: all limits of a problem;
- `segment_tables`: limits of one segment in a problem file;
- `falling_velocity`: a velocity limit that falls towards the ends of a joint's range;
- `link_frames`: the frames of links among the numbers of a kind;
- `point_speed`: the speed of points that are fixed to links;
- `tool_speed`: the speed of the tool;
- `link_speed`: the speed of named links;
- `torque`: the torques of the drives.

A new kind is a subclass of `RowLimit` or `Limit` in a file of its own, imported here. Files,
digests, certificates, tables and figures then include it.
"""

# Kinds are in the order of their imports, in tables and files.
from trajopt.core.limits.joint_limit import Acceleration, Jerk, JointLimit, Position, Velocity

# isort: split
from trajopt.core.limits.falling_velocity import FallingVelocity
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.limit import KINDS, Interval, Limit, Use, named
from trajopt.core.limits.limits import LIMIT_NAMES, LIMIT_ORDERS, LimitName, Limits
from trajopt.core.limits.row_limit import RowLimit
from trajopt.core.limits.rows import JointState, Row
from trajopt.core.limits.tool_speed import ToolSpeed

# isort: split
from trajopt.core.limits.torque import Torque

# isort: split
from trajopt.core.limits.link_speed import LinkSpeed

__all__ = [
    "KINDS",
    "LIMIT_NAMES",
    "LIMIT_ORDERS",
    "Acceleration",
    "FallingVelocity",
    "Interval",
    "Jerk",
    "JointLimit",
    "JointState",
    "Limit",
    "LimitName",
    "Limits",
    "LinkSpeed",
    "Position",
    "Quantity",
    "Row",
    "RowLimit",
    "ToolSpeed",
    "Torque",
    "Use",
    "Velocity",
    "named",
]
