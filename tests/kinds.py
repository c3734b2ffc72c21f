"""Kinds of limits of strangers: each says its numbers and its rows, and nothing else.

They are known in tests with the fixture `strangers` only.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trajopt.core.limits import KINDS, JointState, Quantity, Row, RowLimit


class TipSpeed(RowLimit):
    """Speed of the tip of a planar arm."""

    key = "tip_speed"
    degree = 2
    fields = (
        Quantity("links", metres=1),
        Quantity("speed", metres=1, time=-1, common=True, widens=1),
    )

    def rows(self, at: JointState) -> Iterator[Row]:
        angle = rate = x = y = 0.0
        for length, q, v in zip(self.column("links"), at.q, at.v, strict=True):
            angle, rate = angle + q, rate + v
            x, y = x - length * np.sin(angle) * rate, y + length * np.cos(angle) * rate
        yield Row((x**2 + y**2) / self.column("speed")[0] ** 2, high=1.0)


class SpeedsTogether(RowLimit):
    """|v1| + |v2| of the first two joints."""

    key = "speeds_together"
    degree = 1
    fields = (Quantity("sum", length=1, time=-1, common=True, widens=1),)

    def rows(self, at: JointState) -> Iterator[Row]:
        (highest, *_) = self.column("sum")
        yield Row((at.v[0] + at.v[1]) / highest, -1.0, 1.0)
        yield Row((at.v[0] - at.v[1]) / highest, -1.0, 1.0)


class Apart(RowLimit):
    """|a1 − a2| of the first two joints."""

    key = "apart"
    degree = 2
    fields = (Quantity("difference", length=1, time=-2, common=True, widens=1),)

    def rows(self, at: JointState) -> Iterator[Row]:
        yield Row((at.a[0] - at.a[1]) / self.column("difference")[0], -1.0, 1.0)


class Torque(RowLimit):
    """Torque over inertia of pendulums, a + g cos q."""

    key = "pendulum_torque"
    fields = (Quantity("gravity", time=-2), Quantity("torque", time=-2, widens=1))

    def rows(self, at: JointState) -> Iterator[Row]:
        for joint in np.flatnonzero(self.bounds):
            load = at.a[joint] + self.column("gravity")[joint] * np.cos(at.q[joint])
            yield Row(load / self.column("torque")[joint], -1.0, 1.0)


class Power(RowLimit):
    """Power over inertia, v · a, that a motor gives."""

    key = "motor_power"
    degree = 3
    separate = True
    fields = (Quantity("power", length=2, time=-3, widens=1),)

    def rows(self, at: JointState) -> Iterator[Row]:
        for joint in np.flatnonzero(self.bounds):
            yield Row(at.v[joint] * at.a[joint] / self.column("power")[joint], high=1.0)


STRANGERS = {kind.key: kind for kind in (TipSpeed, SpeedsTogether, Apart, Torque, Power)}
for _key in STRANGERS:
    del KINDS[_key]
