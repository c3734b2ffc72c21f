"""What is in scope, and the keys and options of other tools, each with what comes nearest here."""

from __future__ import annotations

import re

SCOPE = (
    "In scope: waypoints in a fixed order, passed exactly or within a tolerance, from rest to rest "
    "or between given states, with waits, least or given times, in loops, on any path "
    "between them; limits of velocity, acceleration, jerk, position and torque per joint, and of "
    "the speed of tool and links; motions as a controller executes them. Not in scope: obstacles, "
    "orientation."
)
_SPEED = (
    "a speed is not asked for in this tool, every motion is as fast as its limits allow; the "
    "nearest are lower limits, or the scaling factors of a joint_limits.yaml"
)


def _with(*kinds: str) -> str:
    """Return a pattern of names that have a word of each kind, in any order, parted by `_`."""
    return "".join(rf"(?=(.*_)?({kind})(_|$))" for kind in kinds) + r"\w+"


_START = "start|initial|init|current"
_END = "end|final|goal|target|boundary"
_VELOCITY = r"velocit(y|ies)|vels?|speeds?|states?|qds?|dqs?|sd|v"
_ACCELERATION = r"accelerations?|accels?|accs?|qdds?|ddqs?|sdd|a"
_AT_ENDS = (
    "states at the ends have names of their own in this tool; the nearest is {}, beside the "
    "waypoints of a problem file, a number per joint"
)
# A pattern of names (`max_torque`, `tcp_speed`), and the sentence that answers such a name.
_ELSEWHERE = {
    r"position_based_velocity(_limits?)?|(velocity_offset|deceleration_limit)s?": (
        "velocity limits that fall near the ends of a joint's range are limits.falling_velocity in "
        "this tool: a table with offset, deceleration and position, or true for the robot's own"
    ),
    r"(relative_)?(dynamics|velocity|acceleration|jerk)(_rel|_factor)": _SPEED,
    r"\w*(torque|effort)\w*": (
        "torques have a name of their own in this tool; the nearest is limits.torque of a problem "
        "file, a number per joint (N m), or --torque urdf, with an arm whose masses are known"
    ),
    r"\w*(payload|inertia|friction|dynamics|mass)\w*": (
        "masses have places of their own in this tool; the nearest are [dynamics] and [payload] of "
        "a problem file, <inertial> of a URDF, or --payload (kg)"
    ),
    r"\w*(elbow|link|flange|wrist)\w*(speed|velocity)\w*": (
        "the speed of a link has a name of its own in this tool; the nearest is limits.link_speed "
        "of a problem file, or --link-speed forearm_link=0.5 (m/s), with known link frames"
    ),
    r"\w*(tcp|tool|cartesian|end_effector)\w*|ee_\w+": (
        "of the tool's limits, that of its speed is in this tool; the nearest is limits.tool_speed "
        "of a problem file, or --tool-speed (m/s), with a robot whose link frames are known"
    ),
    r"\w*(obstacle|collision|octomap)\w*|(planning_)?scene|clearance": (
        "obstacles are not in this tool; the nearest are more waypoints, of a path that a "
        "collision-free planner has found"
    ),
    r"\w*(orientation|quaternion)\w*|poses?|rpy": (
        "poses of the tool are not in this tool; the nearest are joint angles from inverse "
        "kinematics as waypoints"
    ),
    r"\w*dwell\w*|(wait|pause|hold|stop)(_times?)?": (
        "a wait has a name of its own in this tool; the nearest is dwell, beside the waypoints of "
        "a problem file, a time at rest per waypoint"
    ),
    r"(minimum|min)_duration|(desired|target|total)_duration|(desired|total)_times?": (
        "a time of the whole motion has a name of its own in this tool; the nearest are "
        "least_duration and duration (exactly), beside the waypoints of a problem file, in s"
    ),
    r"(per_)?(section_|segment_)?(minimum|min|least)_(section_|segment_)?(durations?|times?)": (
        "least times have a name of their own in this tool; the nearest is least_times, beside the "
        "waypoints of a problem file, a time per segment"
    ),
    _with(_START, _ACCELERATION) + "|a0": _AT_ENDS.format("start_acceleration"),
    _with(_END, _ACCELERATION) + "|af": _AT_ENDS.format("end_acceleration"),
    _with(_START, _VELOCITY) + "|(v|qd|dq)0": _AT_ENDS.format("start_velocity"),
    _with(_END, _VELOCITY) + "|(v|qd|dq)f": _AT_ENDS.format("end_velocity"),
    r"(is_)?(cyclic|periodic|looped|loop|repeat(ed)?)": (
        "a motion that ends as it begins has a name of its own in this tool; the nearest is "
        "closed = true, beside waypoints whose last row is the first"
    ),
    (
        r"(segment|section)s?|(segment|section)s?_\w*(limit|velocit|speed|acceleration|jerk)\w*|"
        r"\w*(limits?_per|per_(segment|section|gridpoint))\w*"
    ): (
        "limits of one segment have a place of their own in this tool; the nearest are "
        "tables [[limits.segment]] of a problem file, each with number (from 1) and limits, "
        "as velocity = [...]"
    ),
    (r"(max_)?speed|((max_)?(velocity|acceleration)_)?scal(e|ing)(_factor)?|override"): _SPEED,
    r"(way_?point_)?times|time_?(points|stamps|from_start)|((section|segment)_)?durations|knots": (
        "the planner finds the times of waypoints; the nearest is given_times, beside the "
        "waypoints of a problem file, a time per segment; or `trajopt judge`, for a motion that "
        "has times"
    ),
    _with(f"{_START}|{_END}|intermediate|via", "positions?|points?|waypoints?"): (
        "start, goal and the points between them are rows of waypoints in this tool, in order"
    ),
    r"(way_?points?|via|intermediate)_(velocit(y|ies)|accelerations?)": (
        "the planner finds the states at inner waypoints; the nearest are start_velocity and "
        "end_velocity, or `trajopt judge`, for a motion that has states"
    ),
    r"(min|max)_(velocity|acceleration|jerk|position)s?|"
    r"(velocity|acceleration|jerk|position)_limits?|[vaj]_?(max|lims?)": (
        "limits are under [limits], as velocity = [...]; a pair [low, high] has two sides"
    ),
    r"\w*(margin|safety)\w*": (
        "a margin is not asked for in this tool; the nearest are lower limits, by the scaling "
        "factors of a joint_limits.yaml"
    ),
    r"blend\w*|\w*corner\w*|zones?|(path|goal)_tolerances?|(max_)?deviations?": (
        "passing near a waypoint has a name of its own in this tool; the nearest is tolerance, "
        "beside the waypoints of a problem file, or "
        "`trajopt judge --via-tolerance`, for a motion that passes near"
    ),
}
# Options that have another name here. Keys of a file with such a name are valid.
_OPTIONS = {
    r"dt|(time_?|sampl\w*_)?(step|period)|control_cycle": (
        "the nearest is `trajopt plan --cycle` (s), or --rate (cycles per second)"
    ),
    r"(limit_)?tol(erance)?|eps(ilon)?": (
        "limits have no tolerance here; the nearest is tolerance (rad) beside the waypoints of a "
        "problem file, to plan near them, or `trajopt judge --via-tolerance` (rad), for a motion "
        "that passes near"
    ),
    r"format|type": (
        "the ending of `trajopt plan --out` says the format; --as goal writes a ROS goal"
    ),
    r"(max_)?(velocity|jerk|position)(_limits?)?|(max_acceleration|acceleration_limits?)": (
        "limits are in files; the nearest are max_velocity, max_acceleration and max_jerk of a "
        "joint_limits.yaml (--limits), or [limits] of a problem file"
    ),
}


def out_of_scope(name: str) -> str:
    """Return a sentence about a key or an `--option` of other tools; empty for any other name."""
    word = re.sub("(?<=[a-z])(?=[A-Z])", "_", name.strip("-")).replace("-", "_").lower()
    word = re.sub("joints?_(?=.)", "", word)
    known = _OPTIONS | _ELSEWHERE if name.startswith("--") else _ELSEWHERE
    found = (text for pattern, text in known.items() if re.fullmatch(pattern, word))
    return next(found, "")
