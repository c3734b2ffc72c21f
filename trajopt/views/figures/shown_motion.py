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
    """

    planner: str
    name: str
    trajectory: Trajectory
