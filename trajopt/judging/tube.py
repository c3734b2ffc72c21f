"""Find the motion of one joint within a tube of positions that uses the least of its limits.

The joint is known to be within `half` of its positions at given times. The unknown is a spline of
degree r, the order of the highest limit. A linear program chooses its B-spline coefficients:

    min s   with   |q(t_i) − q_i| ≤ d_i,   s low_k ≤ each coefficient of q⁽ᵏ⁾ ≤ s high_k

Velocity limits may depend on the time; a coefficient's limit is then that at its Greville point.

A derivative stays within the range of its coefficients. Those of the two highest derivatives are
values at knots. So the spline is a motion that uses the share `high` = s of its limits. The
program's multipliers prove that every motion uses at least the share `low`
(`trajopt.judging.tube_proof`). The two differ where the best motion has a switching time within a
piece. More knots there close this gap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.judging.tube_proof import Limit, TubeProof, bound

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Rates = Callable[[Array], tuple[Array, Array]]
"""Limits of the velocity at times: low < 0 and high > 0, within the constant ones."""

BROKEN_RTOL = 1e-9
"""A bound above 1 + this share counts as a proof that a limit is broken."""

_MAX_ITERATIONS = 90  # interior-point iterations
_MAX_SHORT_STEPS = 3
_GAP_RTOL = 1e-7  # complementarity gap of the interior-point method, relative to s
_MAX_ROUNDS = 8  # rounds of adding knots
_ROUNDS_RTOL = 1e-6  # gap between low and high that ends the rounds
_NEAREST_SHARE = 0.02  # least distance of knots, relative to the shortest step between samples
_TUBE_RTOL = 1e-9  # excess over the tube that is allowed beside rounding, relative to a half width
_SUPPORT_SHARES = (0.0, 1e-8, 1e-5)  # smaller multipliers at the ends of a proof are left out


@dataclass(frozen=True, eq=False)
class TubeAnswer:
    """The answer for one joint.

    Attributes:
        low: Every motion within the tube uses at least this share of the limits.
        high: Share that the motion found uses; infinite where none was found.
        degree: Degree r of the motion.
        knots, coefficients: The motion as a B-spline, rad and s.
        proof: The proof of `low`; None where it is 0.
    """

    low: float
    high: float
    degree: int
    knots: Array
    coefficients: Array
    proof: TubeProof | None

    def spline(self) -> BSpline:
        """Return the motion as SciPy's B-spline."""
        from scipy.interpolate import BSpline

        return BSpline(self.knots, self.coefficients, self.degree)

    @property
    def span(self) -> tuple[float, float]:
        """Return the first and the last time, s, whose samples the proof of `low` uses."""
        times = self.knots if self.proof is None else self.proof.times
        return float(times[0]), float(times[-1])

    @property
    def decided(self) -> bool:
        return self.low > 1 + BROKEN_RTOL or self.high <= 1


def tube(
    times: Array,
    positions: Array,
    half: Array,
    limits: Sequence[Limit],
    *,
    rest: bool = False,
    rounds: int = _MAX_ROUNDS,
    rates: Rates | None = None,
) -> TubeAnswer:
    """Return the smallest share of the limits that a motion within the tube uses.

    Args:
        times: Increasing, s, `(samples,)`.
        positions: rad, `(samples,)`.
        half: Half the tube's width, positive, rad, `(samples,)`.
        limits: Of the derivatives of order 1 to r = 2 or 3, `(low, high)`, low < 0 < high; the
            last is finite, the others may be infinite.
        rest: Whether derivatives below order r are zero at both ends.
        rounds: Largest number of rounds of adding knots. They end when `low` and `high` are on the
            same side of 1, or equal.
        rates: Velocity limits that depend on the time.
    """
    program = _Program(times, positions, half, limits, rest, rates)
    knots = _resolved(program)
    nearest = _NEAREST_SHARE * float(np.diff(times).min())
    best: TubeAnswer | None = None
    for _ in range(rounds):
        with np.errstate(all="ignore"):
            found = _solved(program, knots)
        roots = found.proof.roots if found.proof else np.zeros(0)
        if best is not None:
            low = max(best, found, key=lambda own: own.low)
            high = min(best, found, key=lambda own: own.high)
            found = replace(high, low=low.low, proof=low.proof)
        best = found
        place = np.clip(np.searchsorted(knots, roots), 1, len(knots) - 1)
        apart = np.minimum(knots[place] - roots, roots - knots[place - 1])
        new = roots[apart > nearest]
        if found.decided or not len(new) or found.high - found.low < _ROUNDS_RTOL * found.high:
            break
        knots = np.union1d(knots, new)
    assert best is not None
    return best


@dataclass(frozen=True, eq=False)
class _Program:
    """The arguments of `tube`."""

    times: Array
    positions: Array
    half: Array
    limits: Sequence[Limit]
    rest: bool
    rates: Rates | None

    def bounds(self, order: int, points: Array) -> tuple[Array, Array]:
        """Return the limits of a derivative at some times, low and high; order 1 is velocity."""
        if order == 1 and self.rates is not None:
            return self.rates(points)
        low, high = self.limits[order - 1]
        return np.full(len(points), low), np.full(len(points), high)


def slope(times: Array, positions: Array, half: Array, limit: Limit) -> tuple[float, float, float]:
    """Return the smallest share of a velocity limit that a motion within the tube uses, exactly.

    Returns:
        The share, and the two times, s, whose positions prove it.
    """
    low, high = limit
    share, where = 0.0, (0, len(times) - 1)
    while True:
        # The pairs of samples that need the steepest rise and the steepest fall.
        found = [
            _steepest(times, positions - half, positions + half, share * high, high),
            _steepest(times, -positions - half, -positions + half, -share * low, -low),
        ]
        steeper, pair = max(found)
        if steeper <= share * (1 + 1e-12):
            return share, float(times[where[0]]), float(times[where[1]])
        share, where = steeper, pair


def _steepest(
    times: Array, lowest: Array, highest: Array, rate: float, limit: float
) -> tuple[float, tuple[int, int]]:
    """Return the pair of samples that exceeds a rate most: its share of the limit, its indices."""
    start = highest - rate * times
    earlier = np.minimum.accumulate(start)
    later = int(np.argmax(lowest[1:] - rate * times[1:] - earlier[:-1])) + 1
    first = int(np.argmin(start[:later]))
    rise = (lowest[later] - highest[first]) / (times[later] - times[first])
    return float(rise / limit), (first, later)


def _resolved(program: _Program) -> Array:
    """Return the first knots: at samples, but no closer than the tube's width resolves.

    Where samples are far apart there are knots in the middle too, if acceleration is the highest
    limit.
    """
    times, limits = program.times, program.limits
    r = len(limits)
    size = min(-limits[-1][0], limits[-1][1])
    apart = float((np.median(program.half) / size) ** (1 / r) / 3)
    step = float(np.median(np.diff(times)))
    if apart < 2 * step and len(times) > 2 * r:
        if apart >= step or r == 3:
            return times
        return np.sort(np.concatenate([times, (times[1:] + times[:-1]) / 2]))
    kept = [times[0]]
    for time in times[1:-1]:
        if kept[-1] + apart <= time <= times[-1] - apart:
            kept.append(time)
    if len(kept) < 2 * r:  # enough to be at rest at both ends
        return np.linspace(times[0], times[-1], 2 * r)
    return np.array([*kept, times[-1]])


def _solved(program: _Program, breaks: Array) -> TubeAnswer:
    """Return the answer of the program with these knots."""
    times, half, limits = program.times, program.half, program.limits
    r = len(limits)
    knots = np.concatenate([[breaks[0]] * r, breaks, [breaks[-1]] * r])
    base = program.positions.mean()
    local = program.positions - base
    known = local / half
    count = len(known)
    used = [order for order, (_, high) in enumerate(limits, start=1) if np.isfinite(high)]
    column = np.arange(len(knots) - r - 1)
    if program.rest:  # the first r coefficients are equal, and the last r
        column = np.clip(column, r - 1, len(column) - r) - (r - 1)
    matrix, points, bounds = _matrix(program, knots, column, used)
    up, down = [np.zeros(count)], [np.zeros(count)]
    for lowest, highest in bounds.values():
        up.append(np.ones(len(highest)))
        down.append(-lowest / highest)
    filled = np.diff(matrix.indptr) > 0  # equal coefficients have an empty row of differences
    rows = _Rows(matrix if filled.all() else matrix[filled])
    del matrix
    upper, lower = np.concatenate(up)[filled], np.concatenate(down)[filled]
    limited = upper > 0
    if not limited.any():
        return TubeAnswer(0.0, np.inf, r, knots, np.zeros(len(column)), None)
    right = np.zeros((2, len(upper)))
    right[:, :count] = 1 + known, 1 - known
    # The initial guess is a least-squares fit to the positions with small derivatives.
    try:
        x = rows.fitted(count, known, np.where(limited, 1e-6, 1.0))
    except (np.linalg.LinAlgError, ValueError):  # beyond the range of floats
        return TubeAnswer(0.0, np.inf, r, knots, np.zeros(len(column)), None)
    x, own_y = _interior_point(rows, right.ravel(), np.concatenate([upper, lower]), x)
    y = np.zeros(len(filled))
    y[filled] = own_y

    values = rows.matrix @ x
    high = float(np.max(np.maximum(values[limited], -values[limited] / lower[limited])))
    if not np.abs(values[:count] - known).max() <= 1 + rows.rounding(x):
        high = np.inf  # the method stopped outside the tube
    del rows, right, values
    derivatives = [(own, np.zeros(len(own))) for own in points[:-1]]
    place = count
    for order in used[:-1]:
        at = points[order - 1]
        derivatives[order - 1] = (at, y[place : place + len(at)] / bounds[order][1])
        place += len(at)
    whole = TubeProof(
        limits,
        times,
        local,
        half,
        y[:count] / half,
        derivatives,
        np.zeros(0),
        bounds[1] if program.rates else None,
    )
    low, proof = _best_proof(whole)
    return TubeAnswer(low, high, r, knots, x[column] + base, proof)


def _matrix(
    program: _Program, knots: Array, column: Indices, used: Sequence[int]
) -> tuple[Any, list[Array], dict[int, tuple[Array, Array]]]:
    """Return the rows of positions and of limited derivatives, over half widths and limits.

    Args:
        program: The program.
        knots: Of the spline.
        column: The unknown of each of its coefficients.
        used: Orders of the derivatives that are limited.

    Returns:
        The matrix; the Greville points of each derivative; the limits of those that are limited.
    """
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array, vstack

    r = len(program.limits)
    levels = _levels(knots, r)
    points = [own for _, own in levels]
    bounds = {order: program.bounds(order, points[order - 1]) for order in used}
    design = csr_array(BSpline.design_matrix(program.times, knots, r))
    blocks = [design * (1 / program.half)[:, None]]
    for order in used:
        blocks.append(levels[order - 1][0] * (1 / bounds[order][1])[:, None])
    del design, levels  # a log's are as large as the matrix
    matrix = vstack(blocks).tocsr()
    del blocks
    if program.rest:
        shape = (len(column), column[-1] + 1)
        ones = np.ones(len(column))
        matrix = (matrix @ csr_array((ones, (np.arange(len(column)), column)), shape=shape)).tocsr()
    return matrix, points, bounds


def _best_proof(whole: TubeProof) -> tuple[float, TubeProof | None]:
    """Return the best bound: of the whole proof, or of its part with the large multipliers.

    The part has smaller rounding errors.
    """
    best: tuple[float, TubeProof | None] = (0.0, None)
    weight = np.abs(whole.multipliers * whole.half)
    for share in _SUPPORT_SHARES:
        large = whole.times[weight > share * weight.max()]
        if len(large) <= len(whole.limits):
            continue
        first = int(np.searchsorted(whole.times, large.min())) - 1
        last = int(np.searchsorted(whole.times, large.max(), side="right")) + 1
        part = slice(max(first, 0), last)
        times = whole.times[part]

        def inside(points: Array, times: Array = times) -> Bools:
            return (points >= times[0]) & (points <= times[-1])

        derivatives = []
        for points, values in whole.derivatives:
            own_part = inside(points)
            derivatives.append((points[own_part], values[own_part]))
        of_velocity = inside(whole.derivatives[0][0])
        own = replace(
            whole,
            times=times,
            positions=whole.positions[part],
            half=whole.half[part],
            multipliers=whole.multipliers[part],
            derivatives=derivatives,
            velocity=whole.velocity
            and (
                whole.velocity[0][of_velocity],
                whole.velocity[1][of_velocity],
            ),
        )
        low, mended = bound(own)
        if low > best[0]:
            best = low, mended
    return best


def _levels(knots: Array, degree: int) -> list[tuple[Any, Array]]:
    """Return, for each derivative, the matrix of its coefficients and their Greville points."""
    from scipy.sparse import csr_array

    matrix, found = None, []
    for order in range(1, degree + 1):
        p = degree - order + 1
        rows = len(knots) - degree - 1 - order
        span = knots[order + p : -order] - knots[order : -order - p]
        index = np.arange(rows)
        places = np.concatenate([index, index]), np.concatenate([index, index + 1])
        values = np.concatenate([-p / span, p / span])
        step = csr_array((values, places), shape=(rows, rows + 1))
        matrix = step if matrix is None else csr_array(step @ matrix)
        own = knots[order:-order]
        if p > 1:
            windows = np.lib.stride_tricks.sliding_window_view(own[1:-1], p - 1)
            points = windows.mean(axis=1)
        else:
            points = (own[1:] + own[:-1]) / 2
        found.append((matrix, points))
    return found


class _Rows:
    """A matrix whose rows have few neighbouring columns, and its normal matrix as a band.

    Attributes:
        matrix: M.
    """

    def __init__(self, matrix: Any) -> None:
        from scipy.sparse import csr_array

        self.matrix = csr_array(matrix)
        self.matrix.sort_indices()
        count = np.diff(self.matrix.indptr)
        self._width = int(count.max())
        self._columns = self.matrix.shape[1]
        first = np.minimum.reduceat(self.matrix.indices, self.matrix.indptr[:-1])
        first = np.minimum(first, self._columns - self._width)
        row = np.repeat(np.arange(len(count)), count)
        dense = np.zeros((self._width, len(count)))
        dense[self.matrix.indices - first[row], row] = self.matrix.data
        self._order = np.argsort(first, kind="stable")
        self._unique, self._starts = np.unique(first[self._order], return_index=True)
        self._dense = dense[:, self._order]

    def forth(self, x: Array) -> Array:
        """Return `[M; −M] x`."""
        found = np.empty((2, self.matrix.shape[0]))
        found[0] = self.matrix @ x
        np.negative(found[0], out=found[1])
        return found.ravel()

    def back(self, y: Array) -> Array:
        """Return `[M; −M]ᵀ y`."""
        half = len(y) // 2
        found: Array = self.matrix.T @ (y[:half] - y[half:])
        return found

    def rounding(self, x: Array) -> float:
        """Return the allowed error of a row of `M x`: its rounding and `_TUBE_RTOL`."""
        from scipy.sparse import csr_array

        own = self.matrix
        sizes = csr_array((np.abs(own.data), own.indices, own.indptr), shape=own.shape)
        return _TUBE_RTOL + 1e-15 * float((sizes @ np.abs(x)).max())

    def fitted(self, count: int, values: Array, weights: Array) -> Array:
        """Return the weighted least-squares solution of `M x = values` in the first rows."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        factor = (cholesky_banded(self.normal(weights), lower=True), True)
        found: Array = cho_solve_banded(factor, self.matrix[:count].T @ values)
        return found

    def normal(self, weights: Array) -> Array:
        """Return the lower band of `Mᵀ diag(weights) M`."""
        own = weights[self._order]
        band = np.zeros((self._width, self._columns))
        for i in range(self._width):
            for j in range(i, self._width):
                products = self._dense[i] * self._dense[j] * own
                band[j - i, self._unique + i] += np.add.reduceat(products, self._starts)
        band[0] += 1e-14 * band[0].max()
        return band


def _dot(left: Array, right: Array) -> float:
    """Return the inner product without BLAS, whose threads cost more than they save here."""
    return float((left * right).sum())


@dataclass(frozen=True, eq=False)
class _Newton:
    """The Newton equations of one iterate, factored.

    Attributes:
        rows, u: The program, see `_interior_point`.
        w, y: Slacks and multipliers, the upper sides before the lower ones.
        primal, dual, dual_s: Residuals, the last one of the variable s.
    """

    rows: _Rows
    u: Array
    w: Array
    y: Array
    primal: Array
    dual: Array
    dual_s: float

    @cached_property
    def _factor(self) -> Any:
        from scipy.linalg import cholesky_banded

        theta = self.y / self.w
        half = len(theta) // 2
        return cholesky_banded(self.rows.normal(theta[:half] + theta[half:]), lower=True), True

    @cached_property
    def _border(self) -> tuple[Array, Array, float]:
        """The column of s, its solution with the band, and the Schur complement of s."""
        from scipy.linalg import cho_solve_banded

        theta = self.y / self.w
        column = self.rows.back(theta * self.u)
        solved = cho_solve_banded(self._factor, column)
        return column, solved, _dot(column, solved) - _dot(theta, self.u**2)

    def direction(self, complement: Array) -> tuple[Array, float, Array, Array]:
        """Return the steps of x, s, w and y for target products `w y`."""
        from scipy.linalg import cho_solve_banded

        column, solved, corner = self._border
        scaled = self._corrected(complement, self.primal)
        inner = cho_solve_banded(self._factor, self.dual - self.rows.back(scaled))
        ds = (self.dual_s - _dot(self.u, scaled) - _dot(column, inner)) / corner
        del scaled
        dx = inner + solved * ds
        dw = self.rows.forth(dx)
        np.subtract(self.primal, dw, out=dw)
        dw += ds * self.u
        return dx, ds, dw, self._corrected(complement, dw)

    def _corrected(self, complement: Array, slack: Array) -> Array:
        """Return `(complement − y slack) / w`, in one array: a log has millions of rows."""
        found = self.y * slack
        np.subtract(complement, found, out=found)
        found /= self.w
        return found


def _interior_point(rows: _Rows, b: Array, u: Array, x: Array) -> tuple[Array, Array]:
    """Solve min s with `[M; −M] x − s u ≤ b` by Mehrotra's method (SIAM J. Optim. 2, 1992).

    Returns:
        x, and the multiplier of each row of M: that of its upper side minus that of its lower.
    """
    size = len(u)
    limited = u > 0
    s = 1.1 * max(1e-3, float(np.max((rows.forth(x) - b)[limited] / u[limited])))
    w = np.maximum(b - rows.forth(x) + s * u, 0.1 * np.where(limited, s * u, 1.0))
    y = 1.0 / w
    y /= _dot(u, y)
    short = 0
    rounding = np.inf
    for iteration in range(_MAX_ITERATIONS):
        primal = rows.forth(x)
        np.subtract(b, primal, out=primal)
        primal += s * u
        primal -= w
        system = _Newton(rows, u, w, y, primal, -rows.back(y), 1 - _dot(u, y))
        mu = _dot(w, y) / size
        if iteration % 8 == 0:
            rounding = rows.rounding(x)
        converged = mu * size < _GAP_RTOL * s and abs(system.dual_s) < 1e-6
        if (converged and np.abs(primal).max() < rounding) or short > _MAX_SHORT_STEPS:
            break
        try:
            _, _, dw, dy = system.direction(-w * y)
        except (np.linalg.LinAlgError, ValueError):  # not positive definite, or overflows
            break
        products = dw * dy
        dw *= _longest(w, dw)
        dw += w
        dy *= _longest(y, dy)
        dy += y
        affine = _dot(dw, dy) / size
        del dw, dy
        target = (affine / mu) ** 3 * mu - w * y
        target -= products
        del products
        dx, ds, dw, dy = system.direction(target)
        along, across = 0.995 * _longest(w, dw), 0.995 * _longest(y, dy)
        short = short + 1 if max(along, across) < 0.02 else 0
        dw *= along
        dw += w
        dy *= across
        dy += y
        x, s, w, y = x + along * dx, s + along * ds, dw, dy
    return x, y[: size // 2] - y[size // 2 :]


def _longest(values: Array, steps: Array) -> float:
    """Return the longest step, at most 1, that keeps every value from becoming negative."""
    falls = steps < 0
    return min(1.0, float(np.min(-values[falls] / steps[falls], initial=np.inf)))
