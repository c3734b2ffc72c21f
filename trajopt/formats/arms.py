"""The built-in arms (`trajopt.core.arm_file`) as limits by joint name."""

from __future__ import annotations

import numpy as np

from trajopt.core import arm_file
from trajopt.core.chain import frames_of
from trajopt.core.limits import LIMIT_NAMES, LimitName
from trajopt.formats.robot_limits import Bounds, JointBounds, RobotLimits


def named(name: str) -> RobotLimits:
    """A built-in arm's limits, rad and s; raises `UnknownName` with the arms there are."""
    arm = arm_file.read(name)
    joints: dict[str, JointBounds] = {}
    for joint, joint_name in enumerate(arm.joint_names):
        bounds: dict[LimitName, Bounds] = {}
        for kind in LIMIT_NAMES:
            low, high = getattr(arm.limits, kind)[joint]
            if np.isfinite([low, high]).any():
                bounds[kind] = (float(low), float(high))
        joints[joint_name] = bounds
    others = {}
    for key, own in arm.limits.others.items():
        others[key] = dict(zip(arm.joint_names, own.numbers, strict=True))
    return RobotLimits(
        joints,
        source=arm.name,
        units=dict.fromkeys(joints, "rad"),
        others=others,
        frames=frames_of(arm.chain, arm.joint_names),
    )
