"""Proofs that every motion within a tube uses at least some share of its limits.

The numbers are found here in floats; what they prove, `check_tube` says, in exact fractions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import factorial

import numpy as np

from trajopt.core.arrays import Array
from trajopt.judging import check_tube
from trajopt.judging.proved_bounds import rounded_down

Limit = tuple[float, float]
"""Low and high; infinite where a derivative has no limit."""

_LOST_SHARE = 1e-7  # share of a piece's area: a root that changes it by less gets no break


@dataclass(frozen=True, eq=False)
class TubeProof:
    """Numbers that prove a bound.

    Symbols are those of `check_tube`.

    Attributes:
        limits: Of the derivatives of order 1 … r; the last one is finite.
        times: `t_i`, increasing, s, `(samples,)`.
        positions: `q_i`, rad, `(samples,)`.
        half: `d_i`, rad, `(samples,)`.
        multipliers: `λ_i`, `(samples,)`.
        derivatives: For each order below r the times `x_kj` and the numbers `μ_kj`.
        roots: Times at which g changes its sign within a piece.
        velocity: Velocity limits at the times `x_1j`, low and high; by default those of `limits`.
    """

    limits: Sequence[Limit]
    times: Array
    positions: Array
    half: Array
    multipliers: Array
    derivatives: Sequence[tuple[Array, Array]]
    roots: Array
    velocity: tuple[Array, Array] | None = None

    def bounds(self, order: int) -> tuple[Array, Array]:
        """Return the limits of a derivative of order below r at its times `x_kj`, low and high."""
        if order == 1 and self.velocity is not None:
            return self.velocity
        low, high = self.limits[order - 1]
        count = len(self.derivatives[order - 1][0])
        return np.full(count, low), np.full(count, high)


def proved(proof: TubeProof) -> float:
    """Return the bound on s that the numbers prove, in exact fractions, rounded down."""
    limits = [
        None if not np.isfinite(high) else (Fraction(low), Fraction(high))
        for low, high in proof.limits
    ]
    bounds = [
        [*zip(*map(_exact, proof.bounds(order)), strict=True)] if limit is not None else []
        for order, limit in enumerate(limits[:-1], start=1)
    ]
    return rounded_down(
        check_tube.proved(
            limits,
            [*zip(*map(_exact, (proof.times, proof.positions, proof.half)), strict=True)],
            _exact(proof.multipliers),
            [[*zip(*map(_exact, pair), strict=True)] for pair in proof.derivatives],
            bounds,
            _exact(proof.roots),
        )
    )


def _exact(values: Array) -> list[Fraction]:
    return [Fraction(value) for value in values.tolist()]


def bound(proof: TubeProof) -> tuple[float, TubeProof]:
    """Return the bound on s in floats, and the proof with its roots and mended multipliers.

    With the solver's multipliers polynomials contribute a little. So r of the multipliers are
    changed, which makes g vanish before the first time.
    """
    r = len(proof.limits)
    try:
        multipliers = _mended(proof)
    except np.linalg.LinAlgError:  # times that differ by more digits than floats have
        return 0.0, proof
    counts = [len(proof.times), *(len(x) for x, _ in proof.derivatives)]
    when = np.concatenate([proof.times, *(x for x, _ in proof.derivatives)])
    size = np.concatenate([multipliers, *(mu for _, mu in proof.derivatives)])
    order = np.repeat(range(r), counts)
    latest = np.argsort(-when, kind="stable")
    when, size, order = when[latest], size[latest], order[latest]
    jumps = np.zeros((3, len(when)))
    jumps[r - 1 - order, np.arange(len(when))] = -size
    gaps = np.append(-np.diff(when), 0.0)
    bend = np.cumsum(jumps[2])
    slope = np.cumsum(jumps[1] + _delayed(bend * gaps))
    value = np.cumsum(jumps[0] + _delayed(slope * gaps + bend * gaps**2 / 2))
    cost, roots = _area(value, slope, bend / 2, gaps, when, proof.limits[-1])
    for number, (_, values) in enumerate(proof.derivatives, start=1):
        if values.any():
            low, high = proof.bounds(number)
            cost += float(np.maximum(high * values, low * values).sum())
    gain = -float((multipliers * proof.positions + np.abs(multipliers) * proof.half).sum())
    mended = replace(proof, multipliers=multipliers, roots=roots)
    return (gain / cost if cost > 0 else 0.0), mended


def _delayed(values: Array) -> Array:
    return np.concatenate([[0.0], values[:-1]])


def _mended(proof: TubeProof) -> Array:
    """Return the multipliers, r of them changed: polynomials of degree below r contribute 0."""
    r = len(proof.limits)
    times = proof.times
    centre, unit = times.mean(), np.ptp(times)
    at = (times - centre) / unit
    wrong = np.zeros(r)
    for power in range(r):
        wrong[power] = (proof.multipliers * at**power).sum()
        for order, (points, values) in enumerate(proof.derivatives, start=1):
            if power >= order:
                factor = factorial(power) / factorial(power - order) / unit**order
                scaled = ((points - centre) / unit) ** (power - order)
                wrong[power] += factor * (values * scaled).sum()
    changed = np.unique(np.linspace(0, len(times) - 1, r + 2).astype(int)[1:-1])
    if len(changed) < r:
        changed = np.arange(r)
    multipliers = np.array(proof.multipliers)
    powers = np.vander(at[changed], r, increasing=True).T
    multipliers[changed] -= np.linalg.solve(powers, wrong)
    return multipliers


def _area(
    c: Array, b: Array, a: Array, gaps: Array, when: Array, limit: Limit
) -> tuple[float, Array]:
    """Integrate max(high g, low g) over pieces g = c + b x + a x², with `x` from 0 to `gap`.

    Returns:
        The integral, and the times of the roots within pieces.
    """
    low, high = limit
    with np.errstate(all="ignore"):
        root = np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))
        stable = -(b + np.where(b >= 0, root, -root)) / 2
        roots = np.stack([stable / a, c / stable])
    roots = np.nan_to_num(roots, nan=0.0, posinf=0.0, neginf=0.0)
    cuts = np.sort(np.clip(roots, 0, gaps), axis=0)
    edges = np.vstack([np.zeros_like(gaps), cuts, gaps])
    parts = np.diff(((a / 3 * edges + b / 2) * edges + c) * edges, axis=0)
    area = float(np.maximum(high * parts, low * parts).sum())
    lost = np.minimum(np.maximum(parts, 0).sum(axis=0), np.maximum(-parts, 0).sum(axis=0))
    inside = (cuts > 0) & (cuts < gaps) & (lost > _LOST_SHARE * np.abs(parts).sum())
    return area, (when - cuts)[inside]
