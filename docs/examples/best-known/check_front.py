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

DIGITS = 2**128  # values of polynomials are rounded down to multiples of 1/DIGITS of the claim
COSTATE_BITS = 100
SHARES = 32  # instants are multiples of a 32nd of their segment
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
def interpolation(corners, degree):  # from values at CURVED's points to those at degree's
    own = exponents(corners, CURVED)

    def monomials(points, divisor):
        return [
            [prod(Fraction(x, divisor) ** i for x, i in zip(p, e, strict=True)) for e in own]
            for p in points
        ]

    back = inverse(monomials(own, CURVED))
    ahead = monomials(exponents(corners, degree), degree)
    table = [
        [sum(x * y for x, y in zip(row, column, strict=True)) for column in zip(*back, strict=True)]
        for row in ahead
    ]
    return whole(table)


# --- rows: power, segment, share in 32nds, and each joint's low and high ---


def gram(rows, times, unit, order):  # whole numbers over 240 unit^(2 order - 1)
    starts = [sum(times[:k]) for k in range(len(times))]
    at = [(starts[k] * SHARES + share * times[k], p) for p, k, share in rows]
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

    return [[entry(*sorted((a, b), key=lambda x: x[0])) for b in at] for a in at]


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

    def __init__(self, problem, order, duration, kept, limits):
        self.order, points = order, [problem["waypoints"][int(k)] for k in kept]
        moving = [j for j in range(len(points[0])) if len({x[j] for x in problem["waypoints"]}) > 1]
        unit = duration or Fraction(1)
        A, V = (problem["limits"][name] for name in ("acceleration", "velocity"))
        units = problem.get("joint_units") or ["rad"]
        self.weights = [
            1 / min(map(abs, A[j])) ** 2 if len(set(units)) > 1 else Fraction(1) for j in moving
        ]
        self.K = len(points) - 1
        self.rows = [(order - 1, k, SHARES) for k in range(self.K)]
        self.rows += [(order - 1 - d, self.K - 1, SHARES) for d in range(1, order)]
        sides = [[[x[j] - points[0][j]] * 2 for j in moving] for x in points[1:]]
        sides += [[[Fraction(0)] * 2 for _ in moving]] * (order - 1)
        self.equations = len(sides)
        for of, segment, share in limits:
            table = {1: V, 2: A}[int(of)]
            self.rows.append((order - 1 - int(of), int(segment), int(share * SHARES)))
            sides.append([[x * unit ** int(of) for x in table[j]] for j in moving])
        self.divisor = lcm(*(x.denominator for row in sides for pair in row for x in pair))
        self.sides = [[[int(x * self.divisor) for x in pair] for pair in row] for row in sides]
        self.floats = [
            [float(Fraction(pair[0], self.divisor)) for pair in row]
            for row in self.sides[: self.equations]
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

    def smallest(self, corners, degree, costates, divisor, claim):
        """The least Bernstein coefficient of Σ w (2 y·c - y'Gy), as a fraction of the claim.

        `costates` has for each point a table of whole numbers, over the divisor.
        """
        points, unit = self.times(corners, degree)
        matrix, under = to_bernstein(len(corners), degree)
        unit *= SHARES
        scale = 240 * unit ** (2 * self.order - 1)
        values = []
        for times, table in zip(points, costates, strict=True):
            used = [i for i, row in enumerate(table) if any(row)]
            own = gram([self.rows[i] for i in used], times, unit, self.order)
            total = Fraction(0)
            for j, weight in enumerate(self.weights):
                y = [table[i][j] for i in used]
                gain = sum(v * self.sides[i][j][v < 0] for v, i in zip(y, used, strict=True))
                square = sum(
                    a * sum(map(int.__mul__, row, y)) for a, row in zip(y, own, strict=True)
                )
                total += weight * (
                    Fraction(2 * gain, divisor * self.divisor)
                    - Fraction(square, divisor**2 * scale)
                )
            values.append(floor(total / claim * DIGITS))
        lows = (sum(map(int.__mul__, row, values)) - sum(map(abs, row)) for row in matrix)
        return Fraction(min(lows), under * DIGITS)

    def free(self, corners, claim):  # from the equations alone
        centre = [sum(c) / len(corners) for c in zip(*corners, strict=True)]
        y = self.best(centre)
        bits = 2**COSTATE_BITS
        fixed = [[int(v * bits) for v in row] for row in y]
        degree = 2 * self.order - 1
        count = len(exponents(len(corners), degree))
        # the best multiple of y, in floating point: (y·c)/(largest y'Gy)
        for factor in self.multiples(corners, fixed, bits):
            table = [[int(v * factor) for v in row] for row in fixed]
            low = self.smallest(corners, degree, [table] * count, bits, claim)
            if low >= 1:
                return low
        degree += 2 * CURVED
        weights, under = interpolation(len(corners), degree)
        nodes = []
        for e in exponents(len(corners), CURVED):
            at = [
                sum(i * c[k] for i, c in zip(e, corners, strict=True)) / CURVED
                for k in range(self.K)
            ]
            nodes.append(self.best([max(t, CENTRE * m) for t, m in zip(at, centre, strict=True)]))
        nodes = [[[int(v * bits) for v in row] for row in y] for y in nodes]
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
        return max(low, self.smallest(corners, degree, between, under * bits, claim))

    def multiples(self, corners, y, bits):
        degree = 2 * self.order - 1
        points, unit = self.times(corners, degree)
        matrix, under = to_bernstein(len(corners), degree)
        unit *= SHARES
        scale = 240 * unit ** (2 * self.order - 1)
        squares = []
        for times in points:
            own = gram(self.rows[: self.equations], times, unit, self.order)
            squares.append(
                sum(
                    float(w)
                    * float(
                        Fraction(
                            sum(
                                y[i][j] * y[k][j] * own[i][k]
                                for i in range(len(own))
                                for k in range(len(own))
                            ),
                            bits**2 * scale,
                        )
                    )
                    for j, w in enumerate(self.weights)
                )
            )
        largest = max(
            sum(a * b for a, b in zip(row, squares, strict=True)) / under for row in matrix
        )
        gain = sum(
            float(w) * y[i][j] / bits * self.floats[i][j]
            for j, w in enumerate(self.weights)
            for i in range(self.equations)
        )
        yield Fraction(gain / largest) if largest > 0 else Fraction(0)

    def linear(self, corners, costates, claim):  # costates at the corners, linear in between
        bits = 2**COSTATE_BITS
        fixed = [[[int(v * bits) for v in row] for row in y] for y in costates]
        degree = 2 * self.order + 1
        between = [
            [
                [
                    sum(i * y[r][j] for i, y in zip(e, fixed, strict=True))
                    for j in range(len(self.weights))
                ]
                for r in range(len(self.rows))
            ]
            for e in exponents(len(corners), degree)
        ]
        return self.smallest(corners, degree, between, bits * degree, claim)


def proved(problem, claim, proof):
    """The lower bound that a proof gives, rounded down; at most what is claimed.

    Every simplex is compared with the claim; the least ratio counts.
    """
    order, duration = int(proof["order"][0]), Fraction(proof["duration"][0])
    front = Front(problem, order, duration, proof["kept"], proof["limits"])
    unit = (duration or 1) ** (2 * order - 1)
    goal = Fraction(claim) * unit
    entries = {}
    for leaf, corner, row, joint, value in proof["costates"]:
        entries.setdefault(int(leaf), []).append((int(corner), int(row), int(joint), value))
    K = front.K
    waiting = [[[Fraction(i == k) for k in range(K)] for i in range(K)]]
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
            for corner, row, joint, value in entries.get(leaf, []):
                empty[corner][row][joint] = Fraction(value)
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
