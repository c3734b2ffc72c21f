"""Limits on the speed of points that are fixed to links of an arm."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from trajopt.core.arrays import Array, Indices
from trajopt.core.chain import LinkChain, LinkPoint
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.joint_limit import brief_segments, by_segment
from trajopt.core.limits.limit import Use
from trajopt.core.limits.link_frames import FramesLimit, frame_columns
from trajopt.core.limits.rows import JointState, Row

if TYPE_CHECKING:
    from trajopt.core.problem import Problem
    from trajopt.core.trajectory import Trajectory

_ROUNDING_RTOL = 1e-12  # by which a chord in the closed form is shorter than the computed one
_SHORT_CHORD = 1e-9  # m; a shorter one counts as none, by rounding it may be none


@dataclass(frozen=True, eq=False)
class PointSpeed(FramesLimit):
    """Speed of points of an arm, m/s, by its link frames.

    Its numbers are the speed, `FRAMES`, and a place in the frame of the joint that moves the point,
    m. A row is the square of a speed, which falls as `1 / k²` if the motion is dilated by `k`.
    """

    degree = 1
    power = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        for speed in self.column("speed").ravel().tolist():
            if not np.isnan(speed) and not 0 < speed < np.inf:
                raise InvalidInput(f"limits.{self.key}", "a positive number, m/s", value=speed)

    @property
    @abstractmethod
    def points(self) -> list[tuple[LinkPoint, int | None]]:
        """Return the points, each with the joint whose limit it is, from 0."""

    @cached_property
    def chain(self) -> LinkChain:
        """The arm's link frames, without the tool."""
        return LinkChain(self.origins, self.column("axes"), self.column("slides") != 0)

    def with_frames(self, numbers: Array, chain: LinkChain | None, places: Array) -> Array:
        """Return numbers, with an arm's frames and the points' places, `(joints, 3)`.

        Raises:
            InvalidInput: The link frames of these joints are not known.
        """
        if chain is None or chain.joints != len(self.bounds):
            right = (
                "the link frames of all joints: of a robot (`trajopt list robots` says which have "
                "them), of a URDF, or as [chain] of a problem file"
            )
            raise InvalidInput(f"limits.{self.key}", right, value=self.table())
        numbers = numbers.copy()
        numbers[..., 1:] = np.column_stack([frame_columns(chain), places])
        return numbers

    def rows(self, at: JointState) -> Iterator[Row]:
        """Yield the square of each point's speed, as a share of its limit's."""
        for point, joint in self.points:
            _, (x, y, z) = self.chain.moving(point, at.q, at.v)
            speed, wider = self.within(point.joint, at.segments)
            yield Row((x**2 + y**2 + z**2) / speed**2, high=wider**2, joint=joint)

    def at_instants(self, motion: Trajectory, smooth: Indices) -> Use | None:
        if self.segments is None:
            return None
        brief = brief_segments(motion, self.segments)
        times = motion.waypoint_times[brief]
        q, v = (list(motion(times, order).T) for order in range(2))
        found = []
        for point, joint in self.points:
            limits = np.nan_to_num(self.column("speed")[brief, point.joint], nan=np.inf)
            speeds = np.linalg.norm(np.array(self.chain.moving(point, q, v)[1]), axis=0)
            own = zip((speeds / limits).tolist(), times.tolist(), strict=True)
            found += [Use(share, joint, time) for share, time in own]
        return max(found, key=lambda use: use.value, default=None)

    def least_times(self, problem: Problem) -> Array:
        """Return the longest of the chords between a point's places over its speed.

        Where a waypoint may be passed within a tolerance the time is 0: the places are not known.
        """
        exact = (problem.route.demand("tolerance") == 0).all(axis=1)
        least = np.zeros(problem.segments)
        for point, _ in self.points:
            places = self.chain.places(problem.waypoints, point)
            chords = np.linalg.norm(np.diff(places, axis=0), axis=1)
            chords[chords <= _SHORT_CHORD] = 0.0
            speeds = np.nan_to_num(self.column("speed")[..., point.joint], nan=np.inf)
            least = np.maximum(least, chords / speeds * (1 - _ROUNDING_RTOL))
        return np.where(exact[:-1] & exact[1:], least, 0.0)

    # --- words ---

    def unit(self, problem: Problem) -> str:
        return "m/s"

    def of_joint(self, joint: int, problem: Problem) -> str:
        if not self.bounds[joint]:
            return "–"
        each = self.column("speed")[..., joint].ravel().tolist()
        return by_segment(["–" if np.isnan(own) else f"{own:.6g} m/s" for own in each])

    def stated(self, column: Array) -> Any:
        return np.nan_to_num(column, nan=np.inf).tolist()
