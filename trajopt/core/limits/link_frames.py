"""Limits that depend on where an arm's links are: the link frames among their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.row_limit import RowLimit

FRAMES = (
    Quantity("origins", count=12),
    Quantity("axes", count=3),
    Quantity("slides"),
)
"""The frames of `LinkChain`: the upper three rows of each pose; 1 where a joint slides, else 0."""
_RIGID_ATOL = 1e-6


def frame_columns(chain: LinkChain) -> Array:
    """Return the numbers of `FRAMES`, `(joints, 16)`."""
    origins = chain.origins[:, :3].reshape(chain.joints, 12)
    return np.column_stack([origins, chain.axes, chain.slides])


@dataclass(frozen=True, eq=False)
class FramesLimit(RowLimit):
    """A limit with `FRAMES` among its fields; these are NaN until it has an arm's (`for_chain`)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.is_complete:
            turns = self.origins[:, :3, :3]
            apart = np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
            self.refuse("origins", "a pose, whose first three columns turn", apart > _RIGID_ATOL)
            sizes = np.linalg.norm(self.column("axes"), axis=1)
            self.refuse("axes", "a direction of length 1", np.abs(sizes - 1) > _RIGID_ATOL)

    @property
    def is_complete(self) -> bool:
        """Return whether it has link frames."""
        return bool(np.isfinite(self.numbers[:, 1:]).all())

    @property
    def origins(self) -> Array:
        """The poses of the joints' frames, `(joints, 4, 4)`."""
        last = np.tile([[0.0, 0.0, 0.0, 1.0]], (len(self.numbers), 1, 1))
        return np.concatenate([self.column("origins").reshape(-1, 3, 4), last], axis=1)

    def refuse(self, column: str, right: str, wrong: Bools) -> None:
        """Raise `InvalidInput` that names the first joint whose numbers of a field are wrong."""
        for joint in np.flatnonzero(wrong).tolist():
            value = self.column(column)[joint].tolist()
            raise InvalidInput(f"limits.{self.key}.{column}", right, value=value, joint=joint)
