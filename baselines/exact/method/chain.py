"""Newton steps of a chain of cells, for any model of a single cell.

A cell is one segment of one joint. It depends on `y = (s, x, a, x', a')`: the logarithm of its
segment's time, and velocity and acceleration at its two ends (without a jerk limit there is no
`a`). End velocities count from the cell's mean velocity in units of its time, and a link ties them
to the waypoint's velocity `v`:

    h/T + T x = v.                                                                            (1)

Neighbouring cells share a waypoint, and the joints of a segment share its time. So the matrix of a
Newton step is a band. LAPACK's Cholesky factorisation takes it, in a time proportional to the
number of segments.

The two cells at a waypoint have one velocity, which is one unknown. The cell of the shorter
segment provides it: its `x` is the unknown, with `dv = T dx + (T x − h/T) ds`. A change of velocity
that is negligible in a long segment may be large in a short one. If the long segment's `x` were the
unknown, the entries of the short one would be lost in rounding.

At given times the program is convex. So where the matrix is not positive definite, entries of the
times alone are increased.
"""

from __future__ import annotations

from functools import cache, cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices

# Added to the diagonal entries of the times, in units of each time, where the matrix is not
# positive definite: the first value, the factor between two trials, the largest value. Smaller:
# more factorisations before one succeeds. Larger: times change less in a step than they could.
START_CONVEXITY = 1e-2
CONVEXITY_FACTOR = 8.0
MAX_CONVEXITY = 1e14
# The whole diagonal grows by this share of that value. Beside segments of 1e-7 s rounding alone can
# make the matrix indefinite: with 0 no value succeeds there.
ROUNDING_RTOL = 1e-18


def at_ends(velocity: Array, outer: Array | None = None, closed: bool = False) -> Array:
    """Return waypoint velocities at both ends of each segment, `(2, starts, segments, joints)`.

    Args:
        velocity: at the inner waypoints, `(starts, segments - 1, joints)`; of a closed motion at
            all but the first, which has the last one's.
        outer: at the motion's ends, `(2, joints)`; by default zero, as of a step.
        closed: whether the motion is closed.
    """
    if closed:
        return np.array([np.roll(velocity, 1, axis=1), velocity])
    starts, inner, joints = velocity.shape
    segments = inner + 1
    shape = (2, starts, segments, joints)
    ends = np.zeros(shape)
    first, last = ends
    first[:, 1:] = velocity
    last[:, :-1] = velocity
    if outer is not None:
        first[:, 0], last[:, -1] = outer
    return ends


def with_outer(inner: Array, outer: Array, closed: bool = False) -> Array:
    """Return values at all waypoints, `(segments + 1, joints)`, from inner and outer ones.

    Of a closed motion `inner` has all waypoints but the first, which has the value of the last.
    """
    if closed:
        return np.concatenate([inner[-1:], inner])
    waypoints, joints = inner.shape
    ends = np.zeros((waypoints + 2, joints))  # in place of `np.pad`, 50 us slower
    ends[1:-1] = inner
    ends[[0, -1]] = outer
    return ends


class Links(NamedTuple):
    """The link (1) at both ends of every cell, `(2 ends, starts, segments, joints)`.

    Attributes:
        slope: change of `x` with `s` at a given waypoint velocity.
        missing: residual of the link, in units of `x`.
    """

    slope: Array
    missing: Array


class Solved(NamedTuple):
    """A Newton step.

    Attributes:
        log: change of the times' logarithms, `(starts, segments)`.
        cells: change of every cell's variables, `(starts, segments, joints, variables)`.
        velocity: change of the inner waypoints' velocities, `(starts, segments - 1, joints)`.
    """

    log: Array
    cells: Array
    velocity: Array


class _BandLayout(NamedTuple):
    """Positions of a cell's unknowns among all unknowns.

    A cell has the unknowns `(s, s before, s after, x, a, x', a')`.

    Attributes:
        width: unknowns of a segment: its time and the states after it.
        size: number of unknowns.
        unknowns: index of each unknown of each cell, `size` where there is none,
            `(segments, joints, unknowns)`.
        chosen: flat indices of the entries of the cells' matrices in the lower triangle.
        places: flat index of each such entry in the band.
    """

    width: int
    size: int
    unknowns: Indices
    chosen: Indices
    places: Indices

    @property
    def height(self) -> int:
        """Return the number of diagonals of the band."""
        return 2 * self.width + 1


@cache
def _layout(segments: int, joints: int, orders: int, closed: bool = False) -> _BandLayout:
    width = 1 + orders * joints
    size = segments * width if closed else (segments - 1) * width + 1
    time = np.arange(segments)[:, None, None] * width
    time = np.broadcast_to(time, (segments, joints, 1))
    after = time + 1 + np.arange(orders * joints).reshape(joints, orders)
    unknowns = np.concatenate([time, time - width, time + width, after - width, after], axis=-1)
    if closed:
        unknowns %= size
    unknowns = np.where((unknowns >= 0) & (unknowns < size), unknowns, size)
    row = unknowns[..., :, None]
    column = unknowns[..., None, :]
    is_lower = (row >= column) & (row < size)
    places = column * size + row if closed else column * 2 * width + row
    return _BandLayout(width, size, unknowns, np.flatnonzero(is_lower), places[is_lower])


@lru_cache(maxsize=8)  # a descent has one size, or a few
def _places(
    starts: int, segments: int, joints: int, orders: int, closed: bool
) -> tuple[Indices, Indices]:
    """Return flat indices for all starts: of the unknowns, and of the entries of the bands."""
    layout = _layout(segments, joints, orders, closed)
    height = layout.size if closed else layout.height
    first = np.arange(starts)[:, None]
    unknowns = first * (layout.size + 1) + layout.unknowns.ravel()
    return unknowns.ravel(), (first * layout.size * height + layout.places).ravel()


class Chain:
    """One Newton step: the matrix of every cell, and its links.

    Args:
        times: of the segments, `(starts, segments)`.
        links: of the cells.
        matrix: the quadratic model of every cell over its variables,
            `(starts, segments, joints, variables, variables)`.
        closed: whether the last segment's end is the first one's start. The matrix is then factored
            as a full one.
    """

    def __init__(self, times: Array, links: Links, matrix: Array, closed: bool = False) -> None:
        starts, segments, joints, variables, _ = matrix.shape
        orders = (variables - 1) // 2
        self.times = times
        self.links = links
        self.matrix = matrix
        self.orders = orders
        self.closed = closed
        self.layout = _layout(segments, joints, orders, closed)
        owned = owners(times, closed)
        self.owned = owned

        # y = B unknowns + constant
        t = times[..., None]
        ratio = np.ones(owned.shape)
        ratio[0, :, 1:] = t[:, :-1] / t[:, 1:]
        ratio[1, :, :-1] = t[:, 1:] / t[:, :-1]
        if closed:
            ratio[0, :, 0] = t[:, -1] / t[:, 0]
            ratio[1, :, -1] = t[:, 0] / t[:, -1]
        slope, missing = links
        beside = ratio * beside_it(slope, closed)
        missed = missing - ratio * beside_it(missing, closed)
        to_unknowns = np.zeros((starts, segments, joints, variables, variables + 2))
        constant = np.zeros((starts, segments, joints, variables))
        to_unknowns[..., 0, 0] = 1.0
        for end in (0, 1):
            v = 1 + orders * end
            own = owned[end]
            to_unknowns[..., v, 0] = np.where(own, 0.0, slope[end])
            to_unknowns[..., v, 1 + end] = np.where(own, 0.0, -beside[end])
            to_unknowns[..., v, v + 2] = np.where(own, 1.0, ratio[end])
            constant[..., v] = np.where(own, 0.0, missed[end])
            for order in range(1, orders):
                to_unknowns[..., v + order, v + order + 2] = 1.0
        self.to_unknowns = to_unknowns
        self.constant = constant

    def gradient(self, by_cell: Array) -> Array:
        """Return the gradient by the unknowns from that by the cells' variables.

        `(starts, unknowns)`. The gradient of the duration is subtracted.
        """
        layout = self.layout
        by_unknown = np.matmul(by_cell[..., None, :], self.to_unknowns)
        places, _ = self._places
        gradient = _summed(by_unknown, places, (len(by_cell), layout.size + 1))[:, :-1]
        gradient[:, :: layout.width] -= self.times
        return gradient

    def descent(self, by_cell: Array) -> Array:
        """Return the right-hand side of a Newton step: the gradient, less the links' residuals."""
        return self.gradient(by_cell - self._missed)

    @cached_property
    def _missed(self) -> Array:
        """Return what the links' residuals add to the gradient."""
        return np.matmul(self.matrix, self.constant[..., None])[..., 0]

    @property
    def _places(self) -> tuple[Indices, Indices]:
        return _places(*self.matrix.shape[:3], self.orders, self.closed)

    def steepest(self, by_cell: Array) -> Array:
        """Return the largest derivative by a time or a waypoint velocity, `(starts,)`."""
        width = self.layout.width
        gradient = np.abs(self.gradient(by_cell))
        over_times = gradient[:, ::width]
        # By the velocity: dv = T dx in the shorter segment.
        following = np.roll(self.times, -1, axis=1) if self.closed else self.times[:, 1:]
        briefer = np.minimum(self.times[:, : following.shape[1]], following)
        after = gradient[:, : briefer.shape[1] * width].reshape(*briefer.shape, width)
        over_velocities = after[..., 1 :: self.orders].max(axis=2) / briefer
        over_velocities = over_velocities.max(axis=1, initial=0.0)
        return np.maximum(over_times.max(axis=1), over_velocities)

    def offsets(self, of_unknowns: Array) -> Array:
        """Return the entries after the velocity of each waypoint, `(starts, waypoints, joints)`."""
        starts, size = of_unknowns.shape
        waypoints = size // self.layout.width
        after = of_unknowns[:, : waypoints * self.layout.width].reshape(starts, waypoints, -1)
        return after[..., 2 :: self.orders]

    def bands(self) -> Array:
        """Return the matrix by the unknowns as a lower band, for every start, a row per unknown.

        For a closed motion the band is the whole lower triangle.
        """
        layout = self.layout
        turned = self.to_unknowns.swapaxes(-1, -2)
        reduced = turned @ self.matrix @ self.to_unknowns
        starts = len(reduced)
        height = layout.size if self.closed else layout.height
        _, places = self._places
        entries = reduced.reshape(starts, -1)[:, layout.chosen]
        bands = _summed(entries, places, (starts, layout.size * height))
        bands = bands.reshape(starts, layout.size, height)
        if self.closed:
            of_times = np.arange(0, layout.size, layout.width)
            bands[:, of_times, of_times] += self.times
        else:
            bands[:, :: layout.width, 0] += self.times
        return bands

    def step(self, by_cell: Array) -> Solved:
        """Return the Newton step for a gradient by the cells' variables."""
        import scipy  # late: planners that are only listed need none of it

        gradient = self.descent(by_cell)
        starts, size = gradient.shape
        unknowns = np.zeros((starts, size + 1))
        for start, factor in enumerate(self._factors):
            solve = scipy.linalg.lapack.dpotrs if self.closed else scipy.linalg.lapack.dpbtrs
            solution, _ = solve(factor, gradient[start], lower=1)
            unknowns[start, :-1] = solution
        own = unknowns[:, self.layout.unknowns]
        cells = np.matmul(self.to_unknowns, own[..., None])[..., 0] + self.constant
        log = unknowns[:, : -1 : self.layout.width]
        velocities = self._velocities(log, cells)
        if self.closed:
            later = np.roll(velocities[0], -1, axis=1)
            return Solved(log, cells, np.where(self.owned[1], velocities[1], later))
        velocity = np.where(self.owned[1, :, :-1], velocities[1, :, :-1], velocities[0, :, 1:])
        return Solved(log, cells, velocity)

    def _velocities(self, log: Array, cells: Array) -> Array:
        """Return the change of waypoint velocities as each cell's ends give it."""
        ends = cells[..., 1 :: self.orders].transpose(3, 0, 1, 2)
        slope, missing = self.links
        changes = ends - slope * log[..., None] - missing
        return self.times[..., None] * changes

    @cached_property
    def _factors(self) -> list[Array]:
        """Return the Cholesky factor of every start's matrix."""
        return [self._factor(band, start) for start, band in enumerate(self.bands())]

    def _factor(self, band: Array, start: int) -> Array:
        """Return the Cholesky factor of a band; the times' entries grow until it exists."""
        import scipy  # late: planners that are only listed need none of it

        diagonal = np.einsum("ii->i", band) if self.closed else band[:, 0]
        factored = scipy.linalg.lapack.dpotrf if self.closed else scipy.linalg.lapack.dpbtrf
        added = 0.0
        while added <= MAX_CONVEXITY:
            factor, failed = factored(band.T, lower=1)
            if not failed:
                return factor
            more = max(CONVEXITY_FACTOR * added, START_CONVEXITY)
            diagonal[:: self.layout.width] += (more - added) * self.times[start]
            added = more
            diagonal *= 1 + ROUNDING_RTOL * added
        return np.full_like(band.T, np.nan)


def owners(times: Array, closed: bool = False) -> Bools:
    """Return where a cell's end provides the unknown, `(2 ends, starts, segments, 1)`."""
    owned = np.zeros((2, *times.shape, 1), dtype=bool)
    briefer = times[:, :-1] < times[:, 1:]
    owned[1, :, :-1, 0] = briefer
    owned[0, :, 1:, 0] = ~briefer
    if closed:
        last = times[:, -1] < times[:, 0]
        owned[1, :, -1, 0] = last
        owned[0, :, 0, 0] = ~last
    return owned


def beside_it(ends: Array, closed: bool = False) -> Array:
    """Return the neighbour's value at each end of every cell.

    At the motion's ends it is 0, or, where the motion is closed, the value at the other end.
    """
    beside = np.zeros(ends.shape)
    beside[0, :, 1:] = ends[1, :, :-1]
    beside[1, :, :-1] = ends[0, :, 1:]
    if closed:
        beside[0, :, 0] = ends[1, :, -1]
        beside[1, :, -1] = ends[0, :, 0]
    return beside


def _summed(values: Array, places: Indices, shape: tuple[int, int]) -> Array:
    """Return a table of this shape: sums of values that share a flat index."""
    sums = np.bincount(places, values.ravel(), minlength=shape[0] * shape[1])
    return np.asarray(sums.reshape(shape), dtype=float)
