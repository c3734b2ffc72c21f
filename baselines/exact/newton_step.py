"""Newton steps of the program of `exact.acceleration`: peaks are eliminated cell by cell.

A cell depends on one segment time and on two waypoint velocities (`exact.cells`). A step eliminates
its two peaks in closed form; `exact.chain` solves for the rest.
"""

from __future__ import annotations

import numpy as np

from baselines.exact.cells import Point, Rows, both_sides
from baselines.exact.chain import Chain, Links
from trajopt.core.arrays import Array


class Linear:
    """The program near a point: rows linear, the objective quadratic, peaks eliminated.

    With `s` the logarithm of the time `T`, `x` an end velocity and `p` a peak. The matrix over
    them is the Lagrangian's, and each row's gradient squared times its weight.

    Args:
        rows: the program at the point.
        multipliers: of the rows.
        weights: `z / s` of each row, multiplier over slack.
    """

    def __init__(self, rows: Rows, multipliers: Array, weights: Array) -> None:
        cells = rows.cells
        y_room, y_reach = multipliers
        w_room, w_reach = weights
        t = rows.t
        room_s = rows.room_s
        room_p = rows.room_p
        reach_x = rows.reach_x
        reach_p = rows.reach_p

        # The second derivative of the reach over x and p is 1/a. xx = y/a + w (∂reach/∂x)²
        curved = y_reach / cells.a
        weighted = w_reach * reach_x
        xx = curved + weighted * reach_x
        # of both ends: uw = w ∂reach/∂u ∂reach/∂w
        uw = weighted[0] * reach_x[1]
        # xp = w ∂reach/∂x ∂reach/∂p − y/a
        xp = weighted * reach_p - curved
        # pp = Σ y/a + w (∂room/∂p)² + w (∂reach/∂p)²
        pressed = w_room * room_p
        pp = curved.sum(axis=0) + pressed * room_p + w_reach * reach_p**2
        # x counts from the mean velocity, which changes with s
        mean = cells.h / t
        steep = mean / t
        sx = y_reach * reach_x
        sp = pressed * room_s - y_room * room_p
        ss = (sx * (steep + rows.x)).sum(axis=0)
        ss += w_room * room_s**2 + y_room * rows.cruise

        # Schur complement of the peaks: A −= b bᵀ / pp, where b are xp and sp
        peak_x = xp / pp
        peak_s = sp / pp
        ss -= sp * peak_s
        sx -= xp * peak_s
        xx -= xp * peak_x
        uw -= xp[0] * peak_x[1]

        # the sum of both sides, over s and both ends
        matrix = np.empty((*t.shape, 3, 3))
        matrix[..., 0, 0] = ss.sum(axis=0)
        matrix[..., 1, 2] = uw.sum(axis=0)
        matrix[..., 2, 1] = matrix[..., 1, 2]
        for end, over_s in enumerate(_both(sx)):
            matrix[..., 0, 1 + end] = over_s
            matrix[..., 1 + end, 0] = over_s
            matrix[..., 1 + end, 1 + end] = xx[end].sum(axis=0)
        links = Links(steep[0] - rows.point.ends, rows.missing)
        self.rows = rows
        self.pp = pp
        self.peak_x = peak_x
        self.peak_s = peak_s
        self.links = links
        self.chain = Chain(rows.times, links, matrix)

    def slope(self, multipliers: Array) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""
        by_s, by_x, by_p = self.rows.gradients(multipliers)
        steepest_peak = np.abs(by_p).max(axis=(0, 2, 3))
        steepest = self.chain.steepest(_by_cell(by_s, by_x))
        return np.maximum(steepest, steepest_peak)

    def step(self, aim: Array) -> tuple[Point, Array]:
        """The Newton step to these multipliers, and by how much it changes every row."""
        by_s, by_x, by_p = self.rows.gradients(aim)
        by_s -= self.peak_s * by_p
        by_x -= self.peak_x * by_p
        solved = self.chain.step(_by_cell(by_s, by_x))

        # back: p from s and x
        ends = solved.cells[..., 1:].transpose(3, 0, 1, 2)
        x = both_sides(ends)
        s = solved.log[..., None]
        peaks = by_p / self.pp - self.peak_s * s - (self.peak_x * x).sum(axis=0)
        step = Point(solved.log, solved.velocity, np.array([ends, peaks]))
        return step, self.rows.change(step, x)

    def bending(self, step: Point) -> None:
        """Unknown: clipping mends what a step misses."""


def _both(by_side: Array) -> Array:
    """The sum of both sides, seen from the upper one: `(2, 2, …)` to `(2, …)`."""
    return by_side[:, 0] - by_side[:, 1]


def _by_cell(by_s: Array, by_x: Array) -> Array:
    """A gradient over `s` and both ends, the sides summed, the variables on the last axis."""
    return np.stack([by_s.sum(axis=0), *_both(by_x)], axis=-1)
