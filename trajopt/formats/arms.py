"""The built-in arms (`trajopt.core.arm_file`) as limits by joint name."""

from __future__ import annotations

from typing import get_args

import numpy as np

from trajopt.core import arm_file
from trajopt.core.limits import LimitName
from trajopt.formats.robot_limits import Bounds, JointBounds, RobotLimits


def named(name: str) -> RobotLimits:
    """A built-in arm's limits, rad and s; raises `UnknownName` with the arms there are."""
    arm = arm_file.read(name)
    joints: dict[str, JointBounds] = {}
    for joint, joint_name in enumerate(arm.joint_names):
        bounds: dict[LimitName, Bounds] = {}
        for kind in get_args(LimitName):
            low, high = getattr(arm.limits, kind)[joint]
            if np.isfinite([low, high]).any():
                bounds[kind] = (float(low), float(high))
        joints[joint_name] = bounds
    return RobotLimits(
        joints,
        source=arm.name,
        units=dict.fromkeys(joints, "rad"),
        falling_velocity=dict(zip(arm.joint_names, arm.falling_velocity, strict=False)),
    )
