"""Check a front's lower bounds with whole numbers only: python check_front.py < RECORD.json

Floating point chooses costates only, and any costates prove a bound
(docs/mathematics/smoothness.md, section 12).
"""

import json
import sys
from fractions import Fraction
from functools import cache
from itertools import product
from math import comb, factorial, floor, lcm, prod
from operator import mul

DIGITS = 2**128  # values of polynomials are rounded down to multiples of 1/DIGITS of the claim
COSTATE_BITS = 100
SHARES = 32  # instants are multiples of a 32nd of their segment
NAMES = ("position", "velocity", "acceleration", "jerk")
CURVED, CENTRE = 3, Fraction(1, 50)


def refuse(reason):
    sys.exit(f"no proof: {reason}")


# --- Bernstein coefficients on a simplex ---


@cache
def exponents(corners, degree):
    return [e for e in product(range(degree + 1), repeat=corners) if sum(e) == degree]


def inverse(matrix):  # Gauss and Jordan, in fractions
    n = len(matrix)
    rows = [list(row) + [Fraction(i == k) for k in range(n)] for i, row in enumerate(matrix)]
    for i in range(n):
        pivot = next(k for k in range(i, n) if rows[k][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i and (s := rows[k][i]):
                rows[k] = [x - s * y if y else x for x, y in zip(rows[k], rows[i], strict=True)]
    return [row[n:] for row in rows]


def whole(matrix):  # whole numbers, and what they are divided by
    divisor = lcm(*(x.denominator for row in matrix for x in row))
    return [[int(x * divisor) for x in row] for row in matrix], divisor


@cache
def to_bernstein(corners, degree):
    own = exponents(corners, degree)
    many = [factorial(degree) // prod(map(factorial, e)) for e in own]

    def value(e, point):
        return Fraction(prod(x**i for x, i in zip(point, e, strict=True)), degree**degree)

    return whole(inverse([[m * value(e, p) for m, e in zip(many, own, strict=True)] for p in own]))


@cache
def interpolation(corners, curve, degree):  # from values at curve's points to those at degree's
    own = exponents(corners, curve)

    def monomials(points, divisor):
        return [
            [prod(Fraction(x, divisor) ** i for x, i in zip(p, e, strict=True)) for e in own]
            for p in points
        ]

    back = inverse(monomials(own, max(curve, 1)))
    ahead = monomials(exponents(corners, degree), degree)
    table = [
        [sum(x * y for x, y in zip(row, column, strict=True)) for column in zip(*back, strict=True)]
        for row in ahead
    ]
    return whole(table)


# --- rows: power, segment, two shares in 32nds, and each joint's low and high ---


def gram(rows, times, unit, order):  # whole numbers over 240 unit^(2 order - 1)
    starts = [sum(times[:k]) for k in range(len(times))]
    at = [(starts[k] * SHARES + share * times[k], p) for p, k, since, share in rows]
    changes = [i for i, (p, k, since, share) in enumerate(rows) if since < share]
    at += [
        (starts[rows[i][1]] * SHARES + rows[i][2] * times[rows[i][1]], rows[i][0]) for i in changes
    ]
    top = 2 * order - 1

    def entry(early, late):
        (m, p), (t, q) = early, late
        d = t - m
        terms = (
            240
            // ((p + r + 1) * factorial(p) * factorial(q))
            * comb(q, r)
            * d ** (q - r)
            * m ** (p + r + 1)
            for r in range(q + 1)
        )
        return sum(terms) * unit ** (top - p - q - 1)

    table = [[0] * len(at) for _ in at]
    for i, a in enumerate(at):
        for k in range(i, len(at)):
            table[i][k] = table[k][i] = entry(*sorted((a, at[k]), key=lambda x: x[0]))
    count = len(rows)  # a change: the later instant less the earlier one
    for i, own in enumerate(changes):
        table[own] = [x - y for x, y in zip(table[own], table[count + i], strict=True)]
    for row in table[:count]:
        for i, own in enumerate(changes):
            row[own] -= row[count + i]
    return [row[:count] for row in table[:count]]


def solved(matrix, right):  # floating point: any costates do
    scale = [1 / max(row[i], 1e-300) ** 0.5 for i, row in enumerate(matrix)]
    rows = [
        [x * scale[i] * scale[k] + 1e-12 * (i == k) for k, x in enumerate(row)]
        + [y * scale[i] for y in right[i]]
        for i, row in enumerate(matrix)
    ]
    n = len(rows)
    for i in range(n):
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i:
                s = rows[k][i]
                rows[k] = [x - s * y for x, y in zip(rows[k], rows[i], strict=True)]
    return [[scale[i] * x for x in row[n:]] for i, row in enumerate(rows)]


class Front:
    """The rows of a problem at a duration, and the lower bounds of simplices."""

    def __init__(self, problem, order, duration, kept, limits, shortest):
        self.order, points = order, [problem["waypoints"][int(k)] for k in kept]
        moving = [j for j in range(len(points[0])) if len({x[j] for x in problem["waypoints"]}) > 1]
        unit = duration or Fraction(1)
        A, V = (problem["limits"][name] for name in ("acceleration", "velocity"))
        units = problem.get("joint_units") or ["rad"]
        self.weights = [
            1 / min(map(abs, A[j])) ** 2 if len(set(units)) > 1 else Fraction(1) for j in moving
        ]
        self.K = len(points) - 1
        self.rows = [(order - 1, k, SHARES, SHARES) for k in range(self.K)]
        self.rows += [(order - 1 - d, self.K - 1, SHARES, SHARES) for d in range(1, order)]
        sides = [[[x[j] - points[0][j]] * 2 for j in moving] for x in points[1:]]
        sides += [[[Fraction(0)] * 2 for _ in moving]] * (order - 1)
        self.equations = len(sides)
        for of, segment, since, share in limits:
            of, power = int(of), order - 1 - int(of) + (since < share)
            if not (0 <= since <= share <= 1 and 0 <= segment < self.K and power >= 0):
                refuse("a limit at no instant")
            table = problem["limits"][NAMES[of]]
            self.rows.append((power, int(segment), int(since * SHARES), int(share * SHARES)))
            sides.append(
                [
                    [
                        None if x is None else (x - points[0][j] * (of == 0)) * unit**of
                        for x in table[j]
                    ]
                    for j in moving
                ]
            )
        share = [x / unit for x in shortest]
        self.start = [
            [x + (i == k) * (1 - sum(share)) for k, x in enumerate(share)] for i in range(self.K)
        ]
        if any(share) and (sum(share) >= 1 or not duration):
            refuse("no time is left")
        for k, seconds in enumerate(shortest):
            ways = ((points[k + 1][j] - points[k][j], V[j], A[j]) for j in moving)
            if not any(self.takes(k, seconds, *own) for own in ways):
                refuse("a segment may take less")
        every = [x for row in sides for pair in row for x in pair if x is not None]
        self.divisor = lcm(*(x.denominator for x in every))
        self.sides = [
            [[None if x is None else int(x * self.divisor) for x in pair] for pair in row]
            for row in sides
        ]
        self.floats = [
            [float(Fraction(pair[0], self.divisor)) for pair in row]
            for row in self.sides[: self.equations]
        ]

    def takes(self, k, seconds, way, velocity, acceleration):  # at least these seconds
        up = way > 0
        way, v = abs(way), abs(velocity[up])
        rates = [abs(acceleration[up])] if k == 0 else []
        rates += [abs(acceleration[not up])] if k == self.K - 1 else []
        far = [a * seconds**2 / 2 if a * seconds < v else v * (seconds - v / a / 2) for a in rates]
        return way >= min([*far, v * seconds])

    def lengths(self, times, unit):  # what each row's limits are multiplied by
        return [
            Fraction((share - since) * times[k], SHARES * unit) if since < share else 1
            for p, k, since, share in self.rows
        ]

    def times(self, corners, degree):  # at the lattice's points, whole numbers over the second
        divisor = lcm(*(x.denominator for c in corners for x in c))
        own = [[int(x * divisor) for x in c] for c in corners]
        points = exponents(len(corners), degree)
        return [
            [sum(i * c[k] for i, c in zip(e, own, strict=True)) for k in range(self.K)]
            for e in points
        ], (degree * divisor)

    def best(self, times):  # the equations' best costates, floating point
        unit = 2**60
        own = [int(t * unit) for t in times]
        table = gram(self.rows[: self.equations], own, unit * SHARES, self.order)
        scale = 240 * (unit * SHARES) ** (2 * self.order - 1)
        return solved([[x / scale for x in row] for row in table], self.floats)

    def gain(self, table, divisor):  # of each row, of costates over the divisor
        for row, sides in zip(table, self.sides[: len(table)], strict=True):
            if any(v and pair[v < 0] is None for v, pair in zip(row, sides, strict=True)):
                refuse("a costate of no limit")
        return [
            sum(
                w * Fraction(v * self.sides[i][j][v < 0], divisor * self.divisor)
                for j, (w, v) in enumerate(zip(self.weights, row, strict=True))
                if v
            )
            for i, row in enumerate(table)
        ]

    def ratio(self, corners, degree, costates, divisor, gains, claim):
        """The largest t with (z·c)² - t claim z'Gz nowhere negative by its Bernstein coefficients.

        `costates` has for each point a table of whole numbers, over the divisor.
        """
        points, unit = self.times(corners, degree)
        matrix, _ = to_bernstein(len(corners), degree)
        unit *= SHARES
        scale = 240 * unit ** (2 * self.order - 1)
        squares = []
        for times, table in zip(points, costates, strict=True):
            used = [i for i, row in enumerate(table) if any(row)]
            own = gram([self.rows[i] for i in used], times, unit, self.order)
            total = Fraction(0)
            for j, weight in enumerate(self.weights):
                y = [table[i][j] for i in used]
                square = sum(
                    a * sum(map(int.__mul__, row, y)) for a, row in zip(y, own, strict=True) if a
                )
                total += weight * Fraction(square, divisor**2 * scale)
            squares.append(total * claim)

        def coefficients(values, side):
            fixed = [floor(v * DIGITS) for v in values]
            return [sum(map(int.__mul__, row, fixed)) + side * sum(map(abs, row)) for row in matrix]

        above = coefficients([g * g for g in gains], -1)
        if min(coefficients(gains, -1)) <= 0 or min(above) < 0:
            return Fraction(0)
        below = coefficients(squares, 1)
        return min((Fraction(a, b) for a, b in zip(above, below, strict=True) if b > 0), default=1)

    def free(self, corners, claim):  # from the equations alone
        low = self.curved(corners, 0, claim)
        return low if low >= 1 else max(low, self.curved(corners, CURVED, claim))

    def curved(self, corners, curve, claim):  # costates of a degree in the times
        bits, degree = 2**COSTATE_BITS, 2 * curve + 2 * self.order - 1
        centre = [sum(c) / len(corners) for c in zip(*corners, strict=True)]
        weights, under = interpolation(len(corners), curve, degree)
        nodes = []
        for e in exponents(len(corners), curve):
            at = [
                sum(i * c[k] for i, c in zip(e, corners, strict=True)) / curve if curve else m
                for k, m in enumerate(centre)
            ]
            y = self.best([max(t, CENTRE * m) for t, m in zip(at, centre, strict=True)])
            gain = sum(
                float(w) * sum(a[j] * b[j] for a, b in zip(y, self.floats, strict=True))
                for j, w in enumerate(self.weights)
            )
            if gain <= 0:
                return Fraction(0)
            nodes.append([[int(v / gain * bits) for v in row] for row in y])
        between = [
            [
                [
                    sum(w * y[r][j] for w, y in zip(row, nodes, strict=True))
                    for j in range(len(self.weights))
                ]
                for r in range(self.equations)
            ]
            for row in weights
        ]
        gains = [sum(self.gain(table, under * bits)) for table in between]
        return self.ratio(corners, degree, between, under * bits, gains, claim)

    def linear(self, corners, costates, claim):  # costates at the corners, linear in between
        bits = 2**COSTATE_BITS
        fixed = [[[int(v * bits) for v in row] for row in y] for y in costates]
        degree = 2 * self.order + 1
        points, unit = self.times(corners, degree)
        own = [self.gain(y, bits) for y in fixed]
        between, gains = [], []
        for e, times in zip(exponents(len(corners), degree), points, strict=True):
            between.append(
                [
                    [
                        sum(i * y[r][j] for i, y in zip(e, fixed, strict=True))
                        for j in range(len(self.weights))
                    ]
                    for r in range(len(self.rows))
                ]
            )
            lengths = self.lengths(times, unit)
            gains.append(
                sum(
                    Fraction(i, degree) * sum(map(mul, gain, lengths))
                    for i, gain in zip(e, own, strict=True)
                    if i
                )
            )
        return self.ratio(corners, degree, between, bits * degree, gains, claim)


def proved(problem, claim, proof):
    """The lower bound that a proof gives, rounded down; at most what is claimed.

    Every simplex is compared with the claim; the least ratio counts.
    """
    order, duration = int(proof["order"][0]), Fraction(proof["duration"][0])
    kept, limits, shortest = (proof[name] for name in ("kept", "limits", "shortest"))
    front = Front(problem, order, duration, kept, limits, shortest)
    unit = (duration or 1) ** (2 * order - 1)
    goal = Fraction(claim) * unit
    entries = {}
    for leaf, row, joint, *values in proof["costates"]:
        entries.setdefault(int(leaf), []).append((int(row), int(joint), values))
    K = front.K
    waiting = [front.start]
    least, leaf = Fraction(1), 0
    for i, j in proof["steps"]:
        if not waiting:
            refuse("a step after the last simplex")
        corners = waiting.pop()
        if i >= 0:
            i, j = int(i), int(j)
            if not (i < K and j < K and i != j):
                refuse("an edge of unknown corners")
            middle = [(a + b) / 2 for a, b in zip(corners[i], corners[j], strict=True)]
            first, second = list(corners), list(corners)
            first[i], second[j] = middle, middle
            waiting += [second, first]
        elif i == -1:
            least = min(least, front.free(corners, goal))
        else:
            empty = [[[0] * len(front.weights) for _ in front.rows] for _ in range(K)]
            for row, joint, values in entries.get(leaf, []):
                for corner, value in zip(empty, values, strict=True):
                    corner[row][joint] = Fraction(value)
            least = min(least, front.linear(corners, empty, goal))
            leaf += 1
    if waiting:
        refuse("a simplex without a bound")
    return Fraction(claim) * least


def main():
    said = json.load(sys.stdin, parse_float=lambda x: Fraction(float(x)), parse_int=Fraction)
    holds = True
    for point in said["points"]:
        if point["lower"] is None:
            continue
        claim = point["lower"]
        proof = said["proofs"][int(point["proof"])]
        if proof["duration"][0] not in (0, point["duration"]):
            refuse("a proof of another duration")
        if not proof["duration"][0]:  # of 1 s without limits
            claim = claim * point["duration"] ** (2 * int(proof["order"][0]) - 1)
        found = point.setdefault("found", proved(said["problem"], claim, proof))
        good = found >= claim * (1 - Fraction(1, 10**9))
        holds &= good
        word = "holds" if good else "does not hold"
        lower = float(point["lower"])
        print(f"{float(point['duration']):.6g} s: no motion has less than {lower:.6g}: {word}")
    sys.exit(not holds)


if __name__ == "__main__":
    main()
