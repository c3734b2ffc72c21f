"""A motion that is shown beside others, in a figure or in a race."""

from __future__ import annotations

from typing import NamedTuple

from trajopt.core.trajectory import Trajectory


class ShownMotion(NamedTuple):
    """A motion that is shown.

    Attributes:
        planner: Whose look it has.
        name: As it is labelled.
        trajectory: Within the limits.
        slowed: The factor on time that brought it within them; 1 if it kept them as claimed.
    """

    planner: str
    name: str
    trajectory: Trajectory
    slowed: float = 1.0
