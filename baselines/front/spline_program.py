"""The program for IPOPT whose variables are a spline's nodes and segment times.

Each segment is cut into pieces. A joint's position and velocity at the nodes and the Bernstein
coefficients of its acceleration are variables, and so are the segment times. Pieces are quintic; or
cubic, where acceleration may jump. Limits between nodes are imposed on Bernstein coefficients, so
they hold at every instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from math import comb
from typing import Any, NamedTuple

import numpy as np

from baselines.ipopt import Options, Program, program
from trajopt.core.arrays import Array
from trajopt.planners.planner import backend

_OPTIONS: Options = {
    "tol": 1e-9,
    "constr_viol_tol": 1e-11,
    "bound_relax_factor": 0.0,
    "max_iter": 400,
}
_WARM_OPTIONS: Options = {**_OPTIONS, "mu_init": 1e-4, "bound_push": 1e-5, "bound_frac": 1e-5}


class ProgramShape(NamedTuple):
    """The structure of a program; all numbers are its parameters.

    Attributes:
        pieces: Number of pieces of each segment.
        joints: Number of joints that move.
        order: Order of the derivative whose square is integrated: 3 for jerk, 2 for acceleration.
        quintic: Whether pieces are quintic, so that acceleration is continuous; else cubic.
        limits: The orders of the derivatives that are limited between nodes.
        budget: Whether the duration is minimised with a limit on the integral, or the integral for
            a given duration.
        warm: Whether the start is near the optimum.
    """

    pieces: tuple[int, ...]
    joints: int
    order: int
    quintic: bool
    limits: tuple[int, ...]
    budget: bool
    warm: bool


def hermite(states: Sequence[Array], lengths: Array) -> list[Array]:
    """Return the Bernstein coefficients of the acceleration between the states at the nodes.

    Args:
        states: Position, velocity (and acceleration) at the nodes, `(nodes, joints)` each.
        lengths: Of the pieces, `(pieces, 1)`.

    Returns:
        Four coefficients `(pieces, joints)` of quintic pieces, or two of cubic ones.
    """
    h = lengths
    q, v, *rest = states
    mean = np.diff(q, axis=0) / h
    v0, v1 = v[:-1], v[1:]
    if not rest:
        return [(6 * mean - 4 * v0 - 2 * v1) / h, (2 * v0 + 4 * v1 - 6 * mean) / h]
    a0, a1 = rest[0][:-1], rest[0][1:]
    return [
        a0,
        (20 * mean - 12 * v0 - 8 * v1) / h + a1 - 2 * a0,
        (8 * v0 + 12 * v1 - 20 * mean) / h + a0 - 2 * a1,
        a1,
    ]


def integrated(q: Any, v: Any, acceleration: Sequence[Any], lengths: Any) -> list[list[Any]]:
    """Return the Bernstein coefficients of position, velocity, acceleration and jerk.

    They are summed from the acceleration: differences of positions would lose the digits of short
    pieces.

    Args:
        q: Position where each piece starts, `(pieces, joints)`: an array or CasADi's symbol.
        v: Velocity there.
        acceleration: Its Bernstein coefficients.
        lengths: Of the pieces, `(pieces, joints)`.
    """
    velocity = [v]
    for coefficient in acceleration:
        velocity.append(velocity[-1] + lengths / len(acceleration) * coefficient)
    position = [q]
    for coefficient in velocity:
        position.append(position[-1] + lengths / len(velocity) * coefficient)
    degree = len(acceleration) - 1
    steps = pairwise(acceleration)
    jerk = [degree * (after - before) / lengths for before, after in steps]
    return [position, velocity, list(acceleration), jerk]


def squared(coefficients: Sequence[Any], lengths: Any) -> Any:
    """Return the integral over each piece of the square of Bernstein polynomials."""
    return inner(coefficients, coefficients, lengths)


def inner(left: Sequence[Any], right: Sequence[Any], lengths: Any) -> Any:
    """Return the integral over each piece of the product of Bernstein polynomials."""
    degree = len(left) - 1
    total = 0
    for i, one in enumerate(left):
        for k, other in enumerate(right):
            share = comb(degree, i) * comb(degree, k) / comb(2 * degree, i + k)
            total = total + share / (2 * degree + 1) * one * other
    return lengths * total


@lru_cache(maxsize=32)
def spline_program(layout: ProgramShape) -> Program:
    """Return the program: times, positions, velocities and accelerations (`accelerations`).

    Its constraints are the links of neighbouring pieces, the limits between nodes, and the
    duration or the budget.
    """
    ca = backend("casadi")
    count = sum(layout.pieces)
    joints = layout.joints
    times = ca.MX.sym("T", len(layout.pieces))
    q, v = (ca.MX.sym(name, count + 1, joints) for name in "qv")
    a = ca.MX.sym("a", count + 1, joints)
    first, second = (ca.MX.sym(name, count, joints) for name in ("a1", "a2"))
    own = [a, first, second] if layout.quintic else [first, second]
    acceleration = [a[:-1, :], first, second, a[1:, :]] if layout.quintic else own
    shares = ca.MX.sym("shares", count)
    weights = ca.MX.sym("weights", 1, joints)
    bound = ca.MX.sym("bound")
    segment = np.repeat(np.eye(len(layout.pieces)), layout.pieces, axis=0)
    lengths = ca.repmat((ca.DM(segment) @ times) * shares, 1, joints)
    found = integrated(q[:-1, :], v[:-1, :], acceleration, lengths)
    links = [found[1][-1] - v[1:, :], found[0][-1] - q[1:, :]]
    cost = squared(found[layout.order], lengths) * ca.repmat(weights, count, 1)
    integral = ca.sum1(ca.sum2(cost))
    duration = ca.sum1(times)
    between = [
        coefficient for order in layout.limits for coefficient in between_nodes(found, order)
    ]
    objective, limited = (duration, integral) if layout.budget else (integral, duration)
    return program(
        "smooth",
        [times, q, v, *own],
        [shares, weights, bound],
        objective,
        [*links, *between, limited - bound],
        _WARM_OPTIONS if layout.warm else _OPTIONS,
    )


def between_nodes(found: list[list[Any]], order: int) -> list[Any]:
    """Return the coefficients of a derivative that are no variables of the program."""
    if order == 2:
        return []
    return found[order][1:-1] if order < 2 else found[order]
