"""Check a front's lower bounds in exact fractions: python check_front.py < RECORD.json

A front's bound says that no motion of a duration has a smaller integral of jerk² (or of
acceleration²). It is believed because this file derives it again, with the numbers, the problem and
the refusals of `check_proof.py` beside it. Both import the standard library only.

Equation numbers are those of docs/mathematics/smoothness.md. Any costates prove a bound, so those
of the equations, which a proof does not state, are computed here in floating point. All else is
whole numbers and fractions; values of polynomials are rounded such that the bound gets smaller.

In reading order: the rows of a problem at a duration; polynomials on a simplex of segment times;
the bound of one simplex; the walk through the tree of simplices.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import pairwise, product
from math import comb, factorial, lcm, perm, prod
from operator import mul
from typing import Any, NamedTuple

if __package__:
    from trajopt.judging import check_proof as kernel
else:  # a script beside the kernel
    import check_proof as kernel  # type: ignore[import-not-found, no-redef]

NoProof = kernel.NoProof
TABLES = {  # the tables of a proof, and how many columns each has; 0 for a plain list
    "kept": 0,
    "order": 0,
    "duration": 0,
    "shortest": 0,
    "limits": 4,
    "steps": 2,
    "costates": 0,  # 3, and one more for each segment
}
ORDERS = {"jerk": 3, "acceleration": 2}  # of the derivative whose square is integrated
FREE, WITH_LIMITS = -1, -2  # kinds of leaves
SHARES = 32  # instants are multiples of a 32nd of their segment
COSTATE_BITS = 100
SIMPLEX_BITS = 128  # values of polynomials are multiples of 2^-128 of the claim
CURVED = 3  # degree of the costates of the equations in the segment times
# Weight of the centre in their points: at a segment time of 0 they would be infinite.
CENTRE = Fraction(1, 50)
ROUNDING_RTOL = Fraction(1, 10**9)  # of a recorded bound, and of its claim for another duration
ZERO, ONE = Fraction(0), Fraction(1)

Numbers = list[Fraction]
Corners = list[Numbers]  # segment times at each corner of a simplex, relative to the duration
Costates = list[list[int]]  # by row and joint
Pair = tuple[Fraction | None, Fraction | None]


# --- the rows of a problem ---


class FrontRow(NamedTuple):
    """A derivative at an instant, or its change between two instants of a segment, (12.2).

    Attributes:
        power: p, of the kernel (t − s)^p / p!.
        segment: Of the instants.
        since, share: Where they are in it, in 32nds; equal for one instant.
        sides: Low and high of each joint; equal for an equation. Of a change: of the mean rate.
    """

    power: int
    segment: int
    since: int
    share: int
    sides: list[Pair]


@dataclass(frozen=True)
class FrontRows:
    """The rows of a problem at a duration, which is the unit of time.

    Attributes:
        order: 3 for jerk, 2 for acceleration.
        weights: Factor on each joint's square.
        rows: The equations first.
        equations: How many of them are equations: of the waypoints, and of rest at the end.
        start: The simplex of all segment times.
    """

    order: int
    weights: Numbers
    rows: list[FrontRow]
    equations: int
    start: Corners

    @property
    def segments(self) -> int:
        return len(self.start)


def front_rows(said: dict[str, Any], proof: dict[str, Any]) -> FrontRows:
    """Return the rows that a proof uses, of the joints that move and the waypoints that it keeps.

    Raises:
        NoProof: The problem has a demand, or a part of the proof is not what it must be.
    """
    demands = sorted(said.keys() & {*kernel.DEMANDS} - {*kernel.IGNORED})
    if demands:
        raise NoProof("a demand", "none", ", ".join(demands))
    if len(proof["order"]) != 1 or proof["order"][0] not in (2, 3):
        raise NoProof("order", "2 or 3")
    if len(proof["duration"]) != 1 or proof["duration"][0] < 0:
        raise NoProof("duration", "one time; 0 for a bound without limits")
    if proof["limits"] and not proof["duration"][0]:
        raise NoProof("limits", "none in a bound for every duration", len(proof["limits"]))
    problem = kernel.of_moving_joints(kernel.stated(said))
    weights = joint_weights(problem, set(said.get("joint_units") or ["rad"]))
    problem = kernel.through_stated(problem, proof["kept"])
    order, duration = int(proof["order"][0]), proof["duration"][0]
    start, last = problem.waypoints[0], len(problem.segments) - 1
    ways = [[x - x0 for x, x0 in zip(q, start, strict=True)] for q in problem.waypoints[1:]]
    rows = [FrontRow(order - 1, k, SHARES, SHARES, equal(way)) for k, way in enumerate(ways)]
    rest = equal([ZERO] * len(start))
    rows += [FrontRow(order - 1 - d, last, SHARES, SHARES, rest) for d in range(1, order)]
    limits = [limit_row(problem, order, duration or ONE, *row) for row in proof["limits"]]
    times = all_times(problem, duration, proof["shortest"])
    return FrontRows(order, weights, rows + limits, len(rows), times)


def joint_weights(problem: kernel.ExactProblem, units: set[str]) -> Numbers:
    """Return 1 for each joint; where units differ 1/A², A the smaller acceleration limit."""
    if len(units) == 1:
        return [ONE] * len(problem.joints)
    return [1 / min(map(min, sizes)) ** 2 for sizes in zip(*problem.acceleration, strict=True)]


def equal(values: Numbers) -> list[Pair]:
    return [(x, x) for x in values]


def limit_row(
    problem: kernel.ExactProblem,
    order: int,
    unit: Fraction,
    derivative: Fraction,
    segment: Fraction,
    since: Fraction,
    share: Fraction,
) -> FrontRow:
    """Return the limit of a derivative at an instant, or of its mean over a part of a segment."""
    of = kernel.counted("limits", derivative, 4)
    k = kernel.counted("limits", segment, len(problem.segments))
    start, end = (kernel.counted("limits", x * SHARES, SHARES + 1) for x in (since, share))
    power = order - 1 - of + (start < end)
    if start > end or not 0 <= power < order:
        raise NoProof("limits", "instants of their segment, at which it bounds something")
    if of == 0:
        sides = [
            (None if low is None else low - x0, None if high is None else high - x0)
            for (low, high), x0 in zip(problem.position, problem.waypoints[0], strict=True)
        ]
    else:
        sizes = (problem.velocity, problem.acceleration, problem.jerk)[of - 1][k]
        rate = unit**of
        sides = [(low and -low * rate, high and high * rate) for low, high in sizes]
    return FrontRow(power, k, start, end, sides)


def all_times(problem: kernel.ExactProblem, duration: Fraction, shortest: Numbers) -> Corners:
    """Return the simplex of all segment times that are at least the shortest ones.

    Raises:
        NoProof: Some segment may take less, or no time is left.
    """
    if len(shortest) != len(problem.segments):
        raise NoProof("shortest", "a time of each segment", len(shortest))
    for k, (seconds, ways) in enumerate(zip(shortest, problem.displacements(), strict=True)):
        if seconds < 0 or not any(takes(problem, k, j, seconds, way) for j, way in enumerate(ways)):
            raise NoProof("shortest", "times that no segment falls below", seconds)
    share = [seconds / (duration or ONE) for seconds in shortest]
    if any(share) and (sum(share) >= 1 or not duration):
        raise NoProof("shortest", "less than the duration", kernel.total(shortest))
    left = 1 - kernel.total(share)
    return [[x + left * (i == k) for k, x in enumerate(share)] for i in range(len(share))]


def takes(problem: kernel.ExactProblem, k: int, j: int, seconds: Fraction, way: Fraction) -> bool:
    """Return whether a joint needs at least these seconds for its way over a segment.

    It keeps its velocity limit, and its acceleration limit from and to rest.
    """
    up = way > 0
    v, a = problem.velocity[k][j][up], problem.acceleration[k][j]
    rates = [a[up]] if k == 0 else []
    rates += [a[not up]] if k == len(problem.segments) - 1 else []
    far = [r * seconds**2 / 2 if r * seconds < v else v * (seconds - v / r / 2) for r in rates]
    return abs(way) >= min([*far, v * seconds])


# --- polynomials on a simplex, by their Bernstein coefficients ---


@cache
def exponents(corners: int, degree: int) -> list[tuple[int, ...]]:
    """Return the exponents of all monomials of a degree; over it: the points of a lattice."""
    return [e for e in product(range(degree + 1), repeat=corners) if sum(e) == degree]


@cache
def to_bernstein(corners: int, degree: int) -> list[list[int]]:
    """Return the matrix from values at the lattice's points to (n!)² times the coefficients.

    With n the degree, Π C(n xᵢ, δᵢ) is 1 at the point δ/n and 0 at the others. A monomial x^γ of it
    has the coefficients Π (αᵢ)_γᵢ / (n)_|γ|; (x)_k is the falling factorial.
    """
    lattice = exponents(corners, degree)

    def entry(at: tuple[int, ...], point: tuple[int, ...]) -> int:
        by_degree = [1]
        for a, d in zip(at, point, strict=True):
            by_degree = multiplied(by_degree, monomials(degree, a, d))
        many = factorial(degree) // prod(map(factorial, point))
        return many * sum(c * factorial(degree - g) for g, c in enumerate(by_degree))

    return [[entry(at, point) for point in lattice] for at in lattice]


@cache
def monomials(n: int, a: int, d: int) -> list[int]:
    """Return (a)_g times the coefficient of x^g in (n x)_d, for each g that does not exceed a."""
    falling = [1]
    for m in range(d):
        falling = multiplied(falling, [-m, n])
    return [perm(a, g) * c for g, c in enumerate(falling[: a + 1])]


def multiplied(one: list[int], other: list[int]) -> list[int]:
    """Return the coefficients of the product of two polynomials."""
    coefficients = [0] * (len(one) + len(other) - 1)
    for i, x in enumerate(one):
        for k, y in enumerate(other):
            coefficients[i + k] += x * y
    return coefficients


@cache
def interpolation(corners: int, curve: int, degree: int) -> tuple[list[list[int]], int]:
    """Return the matrix from values at one degree's points to those at another's, and its divisor.

    It has Π C(k xᵢ, eᵢ) for each point e of the first degree k.
    """

    def weight(e: tuple[int, ...], point: tuple[int, ...]) -> int:
        steps = (curve * x - m * degree for i, x in zip(e, point, strict=True) for m in range(i))
        return prod(steps, start=factorial(curve) // prod(map(factorial, e)))

    nodes, points = exponents(corners, curve), exponents(corners, degree)
    weights = [[weight(e, point) for e in nodes] for point in points]
    return weights, factorial(curve) * degree**curve


def least_ratio(
    points: Sequence[tuple[int, int]],
    divisors: tuple[int, int],
    matrix: list[list[int]],
    claim: Fraction,
) -> Fraction:
    """Return the largest t with (z·c)² − t claim z'Gz nowhere negative, at most 1, (12.4).

    0 where z·c may be negative.

    Args:
        points: z·c and z'Gz at the lattice's points, of these divisors.
        divisors: Of both.
        matrix: From there to Bernstein coefficients.
        claim: What the bound is compared with.
    """

    def coefficients(values: list[int], divisor: int, side: int) -> list[int]:
        fixed = [(value << SIMPLEX_BITS) // divisor for value in values]
        return [sum(map(mul, row, fixed)) + side * sum(map(abs, row)) for row in matrix]

    of_gain, of_square = divisors
    gains = [gain for gain, _ in points]
    above = coefficients([gain * gain for gain in gains], of_gain**2, -1)
    if min(coefficients(gains, of_gain, -1)) <= 0 or min(above) < 0:
        return ZERO
    squares = [square * claim.numerator for _, square in points]
    below = coefficients(squares, of_square * claim.denominator, 1)
    return min([ONE, *(Fraction(a, b) for a, b in zip(above, below, strict=True) if b > 0)])


# --- the bound of a simplex ---


def multiple(x: Fraction | None, divisor: int) -> int | None:
    return None if x is None else int(x * divisor)


@dataclass(frozen=True)
class FrontBounds:
    """Lower bounds of simplices, relative to a claim.

    Attributes:
        front: The rows.
        claim: The integral over a duration of 1.
        gains: What a costate of each row and joint gains, below 0 and above, times `divisor`; None
            without a limit on that side.
        divisor: Of the gains.
        weights: Of the joints, times `weight_divisor`.
        instants: Segment, place, row and sign of all instants of rows, the last one first.
    """

    front: FrontRows
    claim: Fraction
    gains: list[list[tuple[int | None, int | None]]]
    divisor: int
    weights: list[int]
    weight_divisor: int
    instants: list[tuple[int, int, int, int]]

    @classmethod
    def of(cls, front: FrontRows, claim: Fraction) -> FrontBounds:
        sides = [
            [
                (high and w * high, low and w * low)
                for w, (low, high) in zip(front.weights, row.sides, strict=True)
            ]
            for row in front.rows
        ]
        divisor = lcm(*(x.denominator for row in sides for pair in row for x in pair if x))
        gains = [
            [(multiple(high, divisor), multiple(low, divisor)) for high, low in row]
            for row in sides
        ]
        weight_divisor = lcm(*(w.denominator for w in front.weights))
        weights = [int(w * weight_divisor) for w in front.weights]
        instants = [(row.segment, row.share, i, 1) for i, row in enumerate(front.rows)]
        instants += [
            (row.segment, row.since, i, -1)
            for i, row in enumerate(front.rows)
            if row.since < row.share
        ]
        instants.sort(reverse=True)
        return cls(front, claim, gains, divisor, weights, weight_divisor, instants)

    def with_equations(self, corners: Corners) -> Fraction:
        """Return the bound by costates of the equations alone: constant ones, or curved."""
        constant = self.curved(corners, 0)
        return constant if constant >= 1 else max(constant, self.curved(corners, CURVED))

    def curved(self, corners: Corners, curve: int) -> Fraction:
        """Return the bound by costates of a degree in the segment times."""
        segments = self.front.segments
        degree = 2 * curve + 2 * self.front.order - 1
        centre = [kernel.total(c) / len(corners) for c in zip(*corners, strict=True)]
        nodes = []
        for e in exponents(segments, curve):
            at = [
                kernel.total(map(mul, map(Fraction, e), column)) / curve if curve else m
                for column, m in zip(zip(*corners, strict=True), centre, strict=True)
            ]
            node = best_costates(
                self.front, [float(max(t, CENTRE * m)) for t, m in zip(at, centre, strict=True)]
            )
            if node is None:
                return ZERO
            nodes.append(node)
        weights, divisor = interpolation(segments, curve, degree)
        lattice, unit = lattice_times(corners, degree)
        points = []
        for row, times in zip(weights, lattice, strict=True):
            y = [
                [sum(map(mul, row, values)) for values in zip(*costates, strict=True)]
                for costates in zip(*nodes, strict=True)
            ]
            points.append((sum(self.gains_of(y)), self.square(y, times)))
        divisor <<= COSTATE_BITS
        divisors = divisor * self.divisor, self.square_divisor(divisor, unit)
        return least_ratio(points, divisors, to_bernstein(segments, degree), self.claim)

    def linear(self, costates: list[Costates], corners: Corners) -> Fraction:
        """Return the bound by costates at the corners, linear in between.

        What they gain is concave in them, so between corners it is at least its interpolation.
        """
        degree = 2 * self.front.order + 1
        gains = list(map(self.gains_of, costates))
        stated = [
            (i, j, values)
            for i, rows in enumerate(zip(*costates, strict=True))
            for j, values in enumerate(zip(*rows, strict=True))
            if any(values)
        ]
        lattice, unit = lattice_times(corners, degree)
        points = []
        for e, times in zip(exponents(self.front.segments, degree), lattice, strict=True):
            y = [[0] * len(self.weights) for _ in self.front.rows]
            for i, j, values in stated:
                y[i][j] = sum(map(mul, e, values))
            lengths = [
                (row.share - row.since) * times[row.segment] // SHARES
                if row.since < row.share
                else unit
                for row in self.front.rows
            ]
            gain = sum(i * sum(map(mul, rates, lengths)) for i, rates in zip(e, gains, strict=True))
            points.append((gain, self.square(y, times)))
        divisor = degree << COSTATE_BITS
        divisors = divisor * self.divisor * unit, self.square_divisor(divisor, unit)
        return least_ratio(points, divisors, to_bernstein(self.front.segments, degree), self.claim)

    def gains_of(self, costates: Costates) -> list[int]:
        """Return what the costates of each row gain, the limits on the side of their signs."""
        gains = []
        for row, sides in zip(costates, self.gains, strict=False):
            gain = 0
            for y, pair in zip(row, sides, strict=True):
                side = pair[y > 0]
                if y and side is None:
                    raise NoProof("costates", "none of a limit that is not there")
                gain += y * (side or 0)
            gains.append(gain)
        return gains

    def square(self, costates: Costates, times: list[int]) -> int:
        """Return z'Gz = ∫ λ², times `square_divisor`.

        From the end to the start, λ is a polynomial between instants. At an instant of a row one
        of its derivatives changes by the row's costate.
        """
        order, unit = self.front.order, sum(times)
        scales = [2 // factorial(p) * unit ** (order - 1 - p) for p in range(order)]
        starts = [sum(times[:k]) for k in range(len(times))]
        of_joints: list[list[tuple[int, int, int]]] = [[] for _ in self.weights]
        for k, share, i, sign in self.instants:
            if i < len(costates):
                at, power = starts[k] + share * (times[k] // SHARES), self.front.rows[i].power
                for changes, y in zip(of_joints, costates[i], strict=True):
                    if y:
                        changes.append((at, power, sign * y * scales[power]))
        return sum(map(mul, self.weights, map(integral_of_square, of_joints)))

    def square_divisor(self, divisor: int, unit: int) -> int:
        """Return the divisor of `square`, from that of the costates and of the times."""
        return 120 * self.weight_divisor * divisor**2 * unit ** (2 * self.front.order - 1)


def integral_of_square(changes: list[tuple[int, int, int]]) -> int:
    """Return 30 ∫ (c₀ + c₁ x + c₂ x²)² from the last instant to 0, x counted backwards.

    Args:
        changes: Instant, power and size of each change of a coefficient, the last one first.
    """
    c = [0, 0, 0]
    integral = 0
    for (at, power, size), (before, _, _) in pairwise([*changes, (0, 0, 0)]):
        c[power] += size
        x = at - before
        if not x:
            continue
        c0, c1, c2 = c
        integral += x * (
            30 * c0 * c0
            + x
            * (30 * c0 * c1 + x * (10 * (c1 * c1 + 2 * c0 * c2) + x * c2 * (15 * c1 + 6 * x * c2)))
        )
        c = [c0 + x * (c1 + x * c2), c1 + 2 * x * c2, c2]
    return integral


def lattice_times(corners: Corners, degree: int) -> tuple[list[list[int]], int]:
    """Return the segment times at the lattice's points, and their sum: the duration.

    All are whole multiples of a 32nd.
    """
    divisor = lcm(*(x.denominator for c in corners for x in c))
    columns = [[int(x * divisor) * SHARES for x in column] for column in zip(*corners, strict=True)]
    points = exponents(len(corners), degree)
    times = [[sum(map(mul, e, column)) for column in columns] for e in points]
    return times, degree * divisor * SHARES


def best_costates(front: FrontRows, times: list[float]) -> Costates | None:
    """Return the best costates of the equations, such that they gain 2^`COSTATE_BITS`.

    None where they gain nothing. In floating point: any costates prove a bound.
    """
    rows = front.rows[: front.equations]
    instants = [sum(times[: row.segment + 1]) for row in rows]
    at = [(instant, row.power) for instant, row in zip(instants, rows, strict=True)]
    gram = [
        [kernels(*sorted(pair, key=lambda instant: instant[0])) for pair in product([one], at)]
        for one in at
    ]
    values = [[float(low or 0) for low, _ in row.sides] for row in rows]
    costates = solved(gram, values)
    gain = sum(
        float(weight) * y[j] * value[j]
        for y, value in zip(costates, values, strict=True)
        for j, weight in enumerate(front.weights)
    )
    if gain <= 0:
        return None
    return [[int(y / gain * 2**COSTATE_BITS) for y in row] for row in costates]


def kernels(early: tuple[float, int], late: tuple[float, int]) -> float:
    """Return the entry of G, (12.3), of two instants and powers."""
    (start, p), (end, q) = early, late
    terms = (
        comb(q, r) * (end - start) ** (q - r) * start ** (p + r + 1) / (p + r + 1)
        for r in range(q + 1)
    )
    return sum(terms) / (factorial(p) * factorial(q))


def solved(matrix: list[list[float]], right: list[list[float]]) -> list[list[float]]:
    """Return the solution of a positive definite system, scaled, of several right-hand sides."""
    n = len(matrix)
    scale = [1 / max(row[i], 1e-300) ** 0.5 for i, row in enumerate(matrix)]
    rows = [
        [x * scale[i] * scale[k] + 1e-12 * (i == k) for k, x in enumerate(row)]
        + [y * scale[i] for y in right[i]]
        for i, row in enumerate(matrix)
    ]
    for i in range(n):
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i:
                s = rows[k][i]
                rows[k] = [x - s * y for x, y in zip(rows[k], rows[i], strict=True)]
    return [[scale[i] * x for x in row[n:]] for i, row in enumerate(rows)]


# --- the proof ---


def complete(tables: dict[str, Any]) -> dict[str, Any]:
    """Return a proof whose tables are all there and have their columns.

    Raises:
        NoProof: They are not.
    """
    columns = {**TABLES, "costates": 2 + len(tables.get("kept") or [])}
    return kernel.whole(tables, columns, ())


def proved(said: dict[str, Any], claim: Fraction, tables: dict[str, Any]) -> Fraction:
    """Return the lower bound that a proof gives, at most what is claimed.

    The proof is a tree of simplices of segment times. Every step is about the last one that is
    left: it halves an edge, or bounds the integral in it. Each bound is compared with the claim;
    the least ratio counts.

    Args:
        said: The problem, as `check_proof.read` returns it.
        claim: For the duration of the proof; for 1 s where the proof uses no limits.
        tables: The proof's.

    Raises:
        NoProof: A part is not what it must be, or the tree has a branch without a leaf.
    """
    proof = complete(tables)
    front = front_rows(said, proof)
    unit = (proof["duration"][0] or ONE) ** (2 * front.order - 1)
    bounds = FrontBounds.of(front, claim * unit)
    of_leaves: dict[int, list[Numbers]] = {}
    for leaf, *entry in proof["costates"]:
        of_leaves.setdefault(kernel.counted("costates", leaf, len(proof["steps"])), []).append(
            entry
        )
    left, least, leaves = [front.start], ONE, 0
    for i, j in proof["steps"]:
        if not left:
            raise NoProof("steps", "no step after the last simplex")
        corners = left.pop()
        if i == FREE:
            least = min(least, bounds.with_equations(corners))
        elif i == WITH_LIMITS:
            costates = costates_of(front, of_leaves.get(leaves, []))
            least = min(least, bounds.linear(costates, corners))
            leaves += 1
        else:
            left += halved(corners, *(kernel.counted("steps", end, len(corners)) for end in (i, j)))
    if left:
        raise NoProof("steps", "a bound of every simplex")
    return claim * least


def costates_of(front: FrontRows, entries: list[Numbers]) -> list[Costates]:
    """Return the costates at each corner of a simplex, those that are stated and else 0."""
    tables = [[[0] * len(front.weights) for _ in front.rows] for _ in front.start]
    for row, joint, *values in entries:
        i = kernel.counted("costates", row, len(front.rows))
        j = kernel.counted("costates", joint, len(front.weights))
        for table, y in zip(tables, values, strict=True):
            table[i][j] = int(y * 2**COSTATE_BITS)
    return tables


def halved(corners: Corners, i: int, j: int) -> list[Corners]:
    """Return both halves of a simplex, its edge between two corners halved; the first one last."""
    if i == j:
        raise NoProof("steps", "an edge between two corners")
    middle = [(a + b) / 2 for a, b in zip(corners[i], corners[j], strict=True)]
    return [[middle if k == end else corner for k, corner in enumerate(corners)] for end in (j, i)]


def main() -> None:
    """Check the record on the standard input; exit code 1 where a bound does not hold."""
    try:
        record = kernel.read(sys.stdin.read())
        all_hold = True
        for point in record["points"]:
            if point["lower"] is not None:
                holds = point_holds(record, point)
                all_hold &= holds
                word = "holds" if holds else "does not hold"
                duration, lower = float(point["duration"]), float(point["lower"])
                print(f"{duration:.6g} s: no motion has less than {lower:.6g}: {word}")
    except NoProof as reason:
        sys.exit(f"no proof: {reason}")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        sys.exit(f"no proof: the file is no record: {error!r}")
    sys.exit(not all_hold)


def point_holds(record: dict[str, Any], point: dict[str, Any]) -> bool:
    """Return whether a point's bound is what its proof proves."""
    proofs = record["proofs"]
    proof = proofs[kernel.counted("proof", point["proof"], len(proofs))]
    (duration,), (order,) = proof["duration"], proof["order"]
    if order != ORDERS.get(record["measure"]):
        raise NoProof("order", "that of the record's measure", order)
    if duration not in (0, point["duration"]):
        raise NoProof("duration", "that of the point", duration)
    claim = point["lower"]
    if not duration:  # of 1 s without limits
        claim *= point["duration"] ** (2 * int(order) - 1)
    return proved(record["problem"], claim, proof) >= claim * (1 - ROUNDING_RTOL)


if __name__ == "__main__":
    main()
