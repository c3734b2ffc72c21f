"""Decide whether a ROS 2 trajectory goal may run; a goal is dictionaries and lists, without ROS."""

from __future__ import annotations

from typing import Any

from trajopt import InvalidInput, Limits
from trajopt.benchmark.judgement import as_executed
from trajopt.formats import joint_trajectory
from trajopt.formats.motion import motion


def refusal(goal: dict[str, Any], names: list[str], limits: Limits) -> str:
    """Return why the goal must not run, or an empty text where it keeps every limit.

    Args:
        goal: A `FollowJointTrajectory` goal or a `JointTrajectory`, as dictionaries and lists.
        names: The joints in the order of the limits.
        limits: Of these joints, rad (or m) and seconds.
    """
    try:
        sent = motion(joint_trajectory.from_message(goal))
        execution = as_executed(sent.for_joints(names), limits)
    except InvalidInput as error:
        return str(error)
    if execution.kept:
        return ""
    return str(execution.certificate)
