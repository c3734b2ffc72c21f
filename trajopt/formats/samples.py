"""Samples of a motion, as a CSV file or a ROS message holds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt.core import interpolation as between
from trajopt.core.interpolation import Interpolation
from trajopt.core.problem import check_joint_names, frozen
from trajopt.core.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Samples:
    """Positions of named joints at some times, perhaps with their derivatives.

    Attributes:
        joint_names: one per joint.
        times: strictly increasing, s, `(samples,)`.
        positions: rad (metres for a prismatic joint), `(samples, joints)`.
        velocities: rad/s, `(samples, joints)`, or None.
        accelerations: rad/s², `(samples, joints)`, or None.
        joint_units: "rad", or "m" for a prismatic joint; empty if unknown.

    Raises:
        InvalidInput: These do not fit together, are not finite, or times do not increase.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    accelerations: Array | None = None
    joint_units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        for name in ("times", "positions", "velocities", "accelerations"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, frozen(values))
        between.check(self.times, self.positions, self.velocities, self.accelerations)
        check_joint_names(self.joint_names, self.positions.shape[1])

    def interpolation(self, wanted: Interpolation = "auto") -> Interpolation:
        """The interpolation that is meant: for `auto`, the controller's.

        Raises:
            InvalidInput: The samples lack what it needs.
        """
        return between.chosen(wanted, self.velocities, self.accelerations)

    def trajectory(self, interpolation: Interpolation = "auto") -> Trajectory:
        """The motion as executed, from time 0 on (`Trajectory.from_samples`)."""
        return Trajectory.from_samples(
            self.times,
            self.positions,
            self.velocities,
            self.accelerations,
            interpolation=interpolation,
        )
