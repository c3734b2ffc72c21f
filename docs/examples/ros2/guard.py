"""Decide whether a ROS 2 trajectory goal may run; a goal is dictionaries and lists, without ROS."""

from __future__ import annotations

from typing import Any

from trajopt import Certificate, InvalidInput, Limits
from trajopt.formats import joint_trajectory
from trajopt.formats.motion import motion
from trajopt.judgement import as_executed


def refusal(goal: dict[str, Any], names: list[str], limits: Limits) -> str:
    """Return why the goal must not run, or an empty text where it keeps every limit.

    Args:
        goal: A `FollowJointTrajectory` goal or a `JointTrajectory`, as dictionaries and lists.
        names: The joints in the order of the limits.
        limits: Of these joints, rad (or m) and seconds.
    """
    if goal.get("multi_dof_trajectory", {}).get("points"):
        return "multi_dof_trajectory has points: only joint trajectories are judged"
    try:
        sent = motion(joint_trajectory.from_message(goal))
        if set(sent.joint_names) != set(names):
            return f"joint_names is {list(sent.joint_names)}: expected {names}"
        execution = as_executed(sent.for_joints(names), limits, ends={})
    except InvalidInput as error:
        return str(error)
    if execution.kept:
        return ""
    return worst(execution.certificate, names)


def worst(certificate: Certificate, names: list[str]) -> str:
    """Name the joint that is furthest beyond a limit, the time, and by how much."""
    if certificate.flaws:
        return "; ".join(certificate.flaws)
    found = {}
    for kind in ("velocity", "acceleration", "jerk"):
        peak = getattr(certificate, kind)
        if peak:
            found[peak.value] = (kind, peak)
    value = max(found)
    kind, peak = found[value]
    return f"{names[peak.joint]} reaches {value:.3f} of its {kind} limit at {peak.time:.3f} s"
