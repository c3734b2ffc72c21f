"""A limit on the speed of a robot's tool."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.joint_limit import brief_segments, by_segment
from trajopt.core.limits.limit import Limit, Use
from trajopt.core.limits.link_frames import FRAMES, FramesLimit, frame_columns
from trajopt.core.limits.rows import JointState, Row
from trajopt.core.numerals import is_number

if TYPE_CHECKING:
    from trajopt.core.problem import Problem
    from trajopt.core.trajectory import Trajectory

_ROUNDING_RTOL = 1e-12  # by which a chord in the closed form is shorter than the computed one
_SHORT_CHORD = 1e-9  # m; a shorter one counts as none, by rounding it may be none


@dataclass(frozen=True, eq=False)
class ToolSpeed(FramesLimit):
    """Speed of the tool's origin, m/s, by the arm's link frames.

    A problem file states a number where the link frames are known, or a list with that of each
    segment; else a table with the number and the frames of `trajopt.core.chain.LinkChain`:
    `origins` (upper three rows of each pose), `axes`, `slides` (1 where a joint slides, else 0),
    `tool` (place in the last joint's frame, m). The row is the square of the speed, which falls as
    `1 / k²` if the motion is dilated by `k`.
    """

    key = "tool_speed"
    short = "tool"
    degree = 1
    power = 2
    flag = "Limit of the tool's speed, m/s, by the robot's link frames."
    fields = (
        Quantity("speed", metres=1, time=-1, common=True, widens=1),
        *FRAMES,
        Quantity("tool", metres=1, count=3, common=True),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for speed in self.column("speed")[..., 0].ravel().tolist():
            if not np.isnan(speed) and not 0 < speed < np.inf:
                raise InvalidInput(f"limits.{self.key}", "a positive number, m/s", value=speed)

    @classmethod
    def read_one(cls, value: Any, joints: int) -> Self:
        """Return the limit of a number, or of a table with the link frames.

        `inf` is no limit.
        """
        if not is_number(value) and value != np.inf:
            if not isinstance(value, Mapping):
                names = ", ".join(field.name for field in cls.fields)
                right = f"a number, or a table with {names}"
                raise InvalidInput(f"limits.{cls.key}", right, value=value)
            return super().read_one(value, joints)
        columns = sum(field.columns for field in cls.fields)
        numbers = np.full((joints, columns), np.nan)
        numbers[:, 0] = value if np.isfinite(value) else np.nan
        return cls(numbers)

    @classmethod
    def unlimited(cls, numbers: Array) -> Bools:
        """Return whether the speed is infinite, for every joint."""
        return np.asarray(numbers[:, 0] == np.inf)

    def table(self) -> Any:
        if self.segments is not None:
            return self.usual.table()
        speed = self.column("speed")
        return super().table() if self.is_complete else self.stated(speed)

    def stated(self, column: Array) -> float:
        return float(np.nan_to_num(column[0], nan=np.inf))

    @cached_property
    def chain(self) -> LinkChain:
        """The arm's link frames."""
        tool = np.eye(4)
        tool[:3, 3] = self.column("tool")[0]
        return LinkChain(self.origins, self.column("axes"), self.column("slides") != 0, tool)

    def for_chain(self, chain: LinkChain | None) -> Limit:
        """Return the limit with an arm's link frames, if it has none yet."""
        if self.is_complete or not self.bounds.any():
            return self
        joints = len(self.bounds)
        if chain is None or chain.joints != joints:
            right = (
                "the link frames of all joints: of a robot (`trajopt list robots` says which have "
                "them), of a URDF, or as [chain] of a problem file"
            )
            raise InvalidInput(f"limits.{self.key}", right, value=self.table())
        numbers = self.numbers.copy()
        frames = [frame_columns(chain), np.tile(chain.tool[:3, 3], (joints, 1))]
        numbers[..., 1:] = np.column_stack(frames)
        return type(self)(numbers)

    def rows(self, at: JointState) -> Iterator[Row]:
        """Yield the square of the speed, as a share of the limit's."""
        _, (x, y, z) = self.chain.moving_tool(at.q, at.v)
        speed, wider = self.within(0, at.segments)
        yield Row((x**2 + y**2 + z**2) / speed**2, high=wider**2)

    def at_instants(self, motion: Trajectory, smooth: Indices) -> Use | None:
        if self.segments is None:
            return None
        brief = brief_segments(motion, self.segments)
        times = motion.waypoint_times[brief]
        speeds = np.nan_to_num(self.column("speed")[brief, 0], nan=np.inf)
        q, v = (list(motion(times, order).T) for order in range(2))
        shares = np.linalg.norm(np.array(self.chain.moving_tool(q, v)[1]), axis=0) / speeds
        found = zip(shares.tolist(), times.tolist(), strict=True)
        worst = max(found, default=None)
        return worst and Use(worst[0], None, worst[1])

    def least_times(self, problem: Problem) -> Array:
        """Return the chords between the tool's places over its speed.

        Where a waypoint may be passed within a tolerance the time is 0: the tool's place is not
        known.
        """
        places = self.chain.forward(problem.waypoints)[:, :3, 3]
        chords = np.linalg.norm(np.diff(places, axis=0), axis=1)
        chords[chords <= _SHORT_CHORD] = 0.0
        exact = (problem.route.demand("tolerance") == 0).all(axis=1)
        known = exact[:-1] & exact[1:]
        speeds = np.nan_to_num(self.column("speed")[..., 0], nan=np.inf)
        return np.where(known, chords / speeds * (1 - _ROUNDING_RTOL), 0.0)

    # --- words ---

    def unit(self, problem: Problem) -> str:
        return "m/s"

    def of_joint(self, joint: int, problem: Problem) -> str:
        if not self.bounds[joint]:
            return "–"
        each = self.column("speed")[..., joint].ravel().tolist()
        return by_segment(["–" if np.isnan(own) else f"{own:.6g} m/s" for own in each])
