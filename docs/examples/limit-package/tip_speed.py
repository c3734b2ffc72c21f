"""A limit that is no joint's: the speed of the tip of a planar arm."""

import numpy as np

from trajopt.core.limits import Quantity, Row, RowLimit


class TipSpeed(RowLimit):
    """Speed of the tip of a planar arm with a link per joint, m/s."""

    key = "tip_speed"
    degree = 2  # of the row: it is a square of velocities
    fields = (
        Quantity("links", metres=1),
        Quantity("speed", metres=1, time=-1, common=True, widens=1),
    )

    def rows(self, at):
        angle = rate = x = y = 0.0
        for length, q, v in zip(self.column("links"), at.q, at.v, strict=True):
            angle, rate = angle + q, rate + v
            x, y = x - length * np.sin(angle) * rate, y + length * np.cos(angle) * rate
        yield Row((x**2 + y**2) / self.column("speed")[0] ** 2, high=1.0)
