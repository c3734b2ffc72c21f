"""Newton steps of the program of `exact.jerk_cells`; `exact.chain` solves for them."""

from __future__ import annotations

import numpy as np

from baselines.exact.cells import at_ends
from baselines.exact.chain import Chain, Links, owners
from baselines.exact.jerk_cells import Point, Rows
from baselines.exact.jerk_profiles import ACCELERATIONS, TIME, VELOCITIES
from trajopt.core.arrays import Array


class Linear:
    """The program near a point: rows linear, the Lagrangian quadratic.

    Args:
        rows: the program at the point.
        multipliers: of the rows.
        weights: `z / s` of each row, multiplier over slack.
    """

    def __init__(self, rows: Rows, multipliers: Array, weights: Array) -> None:
        first, second = rows.slopes
        point = rows.point
        reach = _reach(multipliers)
        weighted = _reach(weights) * first
        matrix = (weighted[:, None] * first - reach * second).sum(axis=2)
        pull = (reach * first).sum(axis=1)
        for end, v in enumerate(VELOCITIES):
            # the second derivative of the link h/T + T x = v
            matrix[TIME, TIME] += pull[v] * (rows.steep + point.ends[end])
            matrix[TIME, v] += pull[v]
            matrix[v, TIME] += pull[v]
        links = Links(rows.steep - point.ends, rows.missing)
        own_states = self._own_states(rows, links)
        at_waypoints = self._at_waypoints(
            rows,
            multipliers,
            weights,
        )
        cells = matrix.transpose(2, 3, 4, 0, 1)
        cells = cells + (own_states.swapaxes(-1, -2) @ at_waypoints @ own_states).sum(axis=3)
        self.rows = rows
        self.own_states = own_states
        self.at_waypoints = at_waypoints
        self.chain = Chain(
            rows.times,
            links,
            cells,
        )

    @staticmethod
    def _own_states(rows: Rows, links: Links) -> Array:
        """Change of the waypoints' states with the variables of the cells that own them.

        Velocity, `dv = T (dx − slope ds)`, and acceleration at both ends of a cell,
        `(starts, segments, joints, 2 ends, 2, variables)`.
        """
        owned = owners(rows.times)
        own_time = owned * rows.t
        states = np.zeros((*rows.steep.shape, 2, 2, 5))
        for end, (v, a) in enumerate(
            zip(
                VELOCITIES,
                ACCELERATIONS,
                strict=True,
            )
        ):
            states[..., end, 0, TIME] = -own_time[end] * links.slope[end]
            states[..., end, 0, v] = own_time[end]
            states[..., end, 1, a] = owned[end]
        return states

    @staticmethod
    def _at_waypoints(rows: Rows, multipliers: Array, weights: Array) -> Array:
        """The rows at waypoints, quadratic in velocity and acceleration, at both ends of a cell."""
        ramps = rows.ramps
        of_acceleration, of_velocity = _room(weights)
        _, multiplier = _room(multipliers)
        pressed = of_velocity * ramps
        vv = of_velocity.sum(axis=0)
        va = pressed[0] - pressed[1]
        aa = of_acceleration + pressed * ramps + multiplier * rows.cells.falling
        entries = [at_ends(table) for table in (vv, va, va, aa.sum(axis=0))]
        last = np.array(entries).transpose(2, 3, 4, 1, 0)
        return last.reshape(*last.shape[:-1], 2, 2)

    @property
    def apart(self) -> Array:
        """The most that a link misses, `(starts,)`."""
        return np.asarray(np.abs(self.rows.missing).max(axis=(0, 2, 3)))

    def slope(self, multipliers: Array) -> Array:
        """The largest right-hand side of a step over the times, `(starts,)`.

        It includes what the links miss: the barrier waits for both.
        """
        chain = self.chain
        gradient = chain.descent(self._gradient(multipliers))
        return np.asarray(np.abs(gradient[:, :: chain.layout.width]).max(axis=1))

    def step(self, aim: Array) -> tuple[Point, Array]:
        """The Newton step to these multipliers, and by how much it changes every row."""
        rows = self.rows
        log, cells, velocity = self.chain.step(self._gradient(aim))
        by_variable = cells.transpose(3, 0, 1, 2)
        accelerations = by_variable[list(ACCELERATIONS)]
        acceleration = accelerations[1, :, :-1]
        change = np.zeros_like(aim)
        reach = (rows.slopes.first * by_variable[:, None]).sum(axis=0)
        change[:2] = reach.reshape(change[:2].shape)
        faster = np.array([-velocity, velocity])
        change[2, ..., :-1, :] = np.array([-acceleration, acceleration])
        change[3, ..., :-1, :] = faster - rows.ramps * acceleration
        step = Point(
            log,
            by_variable[list(VELOCITIES)],
            velocity,
            acceleration,
        )
        return step, change

    def bending(self, step: Point) -> Array:
        """By how much a step changes every row at second order."""
        rows = self.rows
        acceleration = at_ends(step.acceleration)
        changes = np.empty((5, *acceleration.shape[1:]))
        changes[TIME] = step.log[..., None]
        changes[list(VELOCITIES)] = step.ends
        changes[list(ACCELERATIONS)] = acceleration
        bent = (rows.slopes.second * changes[:, None]).sum(axis=1)
        table = np.zeros_like(rows.values)
        table[:2] = ((bent * changes[:, None]).sum(axis=0) / 2).reshape(table[:2].shape)
        table[3, ..., :-1, :] = -rows.cells.falling * step.acceleration**2 / 2
        return table

    def _gradient(self, multipliers: Array) -> Array:
        """The gradient of the rows over the cells' variables, with what the links miss."""
        rows = self.rows
        of_reach = (_reach(multipliers) * rows.slopes.first).sum(axis=1)
        of_acceleration, of_velocity = _room(multipliers)
        pressed = (of_velocity * rows.ramps).sum(axis=0)
        states = np.array(
            [
                at_ends(of_velocity[1] - of_velocity[0]),
                at_ends(of_acceleration[1] - of_acceleration[0] - pressed),
            ]
        )
        by_state = states.transpose(2, 3, 4, 1, 0)
        velocity = (rows.t * rows.missing).transpose(1, 2, 3, 0)
        by_state = by_state + self.at_waypoints[..., 0] * velocity[..., None]
        own = (by_state[..., None, :] @ self.own_states)[..., 0, :]
        return np.asarray(of_reach.transpose(1, 2, 3, 0) + own.sum(axis=3))


def _reach(table: Array) -> Array:
    """Return the part of a table of rows for the reach, `(4, starts, segments, joints)`."""
    return table[:2].reshape(4, *table.shape[2:])


def _room(table: Array) -> Array:
    """Return the part of a table of rows for inner waypoints, `(2, 2, starts, …)`."""
    return table[2:, :, :, :-1]
