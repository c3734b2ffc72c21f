"""Check a record's lower bound in exact fractions: python check_proof.py < RECORD.json

All numbers are fractions. Roots and quotients are rounded to 128 binary places, such that the bound
only gets smaller.
"""

import hashlib
import json
import struct
import sys
from fractions import Fraction
from itertools import pairwise
from math import floor, inf, isqrt, nan

RAISE, LOWER, BRANCH, LEAF = range(4)
LIMITS = ("velocity", "acceleration", "jerk", "position")
ENDS = [[f"{end}_{rate}" for end in ("start", "end")] for rate in ("velocity", "acceleration")]
PLAIN = ("name", "source", "digest", "joint_names", "joint_units", "waypoints", "limits")
DIGITS = 2**128
SAME = Fraction(1, 2**48)  # rounding, relative to a joint's largest coordinate
BRIEF, IN_LINE = 60 * 10**5, Fraction(1, 100)  # docs/mathematics/verification.md, (7.1)
APART = Fraction(1025, 1024)
NONE, HALF, THIRD = Fraction(0), Fraction(1, 2), Fraction(1, 3)


def down(x):  # rounded to 128 binary places
    return Fraction(floor(x * DIGITS), DIGITS)


def up(x):
    return -down(-x)


def most(c, low, high):  # largest c z for z from low to high
    return max(c * low, c * high)


def root(x):  # at most √x
    return Fraction(isqrt(floor(x * DIGITS**2)), DIGITS)


def refuse(reason):
    sys.exit(f"no proof: {reason}")


def whole(x, count):
    if x != floor(x) or not 0 <= x < count:
        refuse(f"{float(x):g} is no number from 0 to {count - 1}")
    return int(x)


def unique(pairs):
    if len(dict(pairs)) < len(pairs):
        refuse("a key stands there twice")
    return dict(pairs)


def shape(table):
    return (len(table), *shape(table[0])) if isinstance(table, list) else ()


def flat(table):
    return [x for row in table for x in flat(row)] if isinstance(table, list) else [table]


def digest(tables):  # SHA-256 of the problem's numbers, as the file has it
    found = hashlib.sha256()
    for name, table in tables:
        found.update(name.encode() + repr(shape(table)).encode())
        row = (nan if x is None else float(x) for x in flat(table))
        found.update(b"".join(struct.pack("<d", x) for x in row))
    return found.hexdigest()


def sided(pairs):  # a missing limit is infinite
    if isinstance(pairs[0][0], list):
        return [sided(own) for own in pairs]
    return [[-inf if x is None else x, inf if y is None else y] for x, y in pairs]


def separate(points, least):  # leave out points that equal the last one up to rounding
    rounding = [SAME * max(map(abs, column)) for column in zip(*points, strict=True)]
    kept, last = [0], points[0]
    for k, point in enumerate(points[1:], start=1):
        steps = zip(point, last, rounding, strict=True)
        if differs := any(abs(x - y) > size for x, y, size in steps):
            last = point
        kept += [k] if differs or least[k - 1] > 0 else []
    return kept


def exact(points, changes):  # leave out points between brief steps in line, see (7.1)
    columns = list(zip(*points, strict=True))
    steps = [[y - x for x, y in zip(a, b, strict=True)] for a, b in pairwise(points)]
    largest = [max(map(abs, column)) for column in zip(*steps, strict=True)]
    largest = [size or max(largest) for size in largest]
    rounding = [SAME * max(map(abs, column)) for column in columns]
    units = [max(size, max(largest) / 1000) for size in largest]
    joints = range(len(columns))
    scaled = [[step[j] / units[j] for j in joints] for step in steps]
    sizes = [max(map(abs, step)) for step in scaled]

    def brief(k):
        cubes = (BRIEF * rounding[j] * largest[j] ** 2 for j in joints)
        return all(abs(h) ** 3 <= cube for h, cube in zip(steps[k], cubes, strict=True))

    def in_line(k):
        blur = 1 / sizes[k - 1] + 1 / sizes[k]
        turned = [abs(scaled[k - 1][j] / sizes[k - 1] - scaled[k][j] / sizes[k]) for j in joints]
        return all(turned[j] <= IN_LINE + blur * rounding[j] / units[j] for j in joints)

    inner = range(1, len(steps))
    spared = {k for k in inner if brief(k - 1) and brief(k) and in_line(k)} - changes
    return [k for k in range(len(points)) if k not in spared]


def loosest(table):  # the widest limits of several segments
    pairs = [list(zip(*each, strict=True)) for each in zip(*table, strict=True)]
    return [
        [None if None in own else most(own) for own, most in zip(each, (min, max), strict=True)]
        for each in pairs
    ]


# --- the problem ---

said = json.load(
    sys.stdin,
    parse_float=lambda digits: Fraction(float(digits)),
    parse_int=Fraction,
    parse_constant=refuse,
    object_pairs_hook=unique,
)
claimed, stats = said["solution"]["lower_bound"], said["solution"]["stats"]
proof = {name.removeprefix("proof_"): table["$array"] for name, table in stats.items()}
points = said["problem"]["waypoints"]
others = {key: x for key, x in said["problem"].items() if key not in PLAIN}
KNOWN = ("closed", "dwell", "given_times", "least_times", "tolerance", *ENDS[0], *ENDS[1])
if others.keys() - set(KNOWN):
    refuse(f"{', '.join(others)}: not all of these are known here")
given = others.get("given_times")  # all segments' times
least = given or others.get("least_times", [NONE] * (len(points) - 1))  # of each segment
waits = others.get("dwell", [NONE] * len(points))  # at each waypoint, at rest
closed = bool(others.get("closed"))  # the motion ends as it begins
if "closed" in others:
    others["closed"] = Fraction(closed)
room = others.get("tolerance", [[NONE] * len(points[0])] * len(points))  # of each waypoint
limits = said["problem"]["limits"]
pairs = [limits.get(name, [[None, None]] * len(points[0])) for name in LIMITS]
tables = [("", points), *(("", sided(own)) for own in pairs)]
rows = [own if len(shape(own)) == 3 else [own] * len(least) for own in pairs]  # by segment
kept = separate(points, least)
room = [
    [min(column) for column in zip(*room[i:k], strict=True)]
    for i, k in pairwise([*kept, len(room)])
]
points = [points[k] for k in kept]
rows = [[own[k - 1] for k in kept[1:]] for own in rows]
least = [sum(least[i:k]) for i, k in pairwise(kept)]
waits = [sum(waits[i:k]) for i, k in pairwise([*kept, len(waits)])]
if "waypoints" in proof:  # it counts these alone
    kept = [whole(k, len(points)) for k in proof["waypoints"]]
    stays = {0, len(points) - 1, *(k for k, wait in enumerate(waits) if wait)}
    if kept != sorted({*kept, *stays}):
        refuse("waypoints that do not rise from the first to the last, through all with a wait")
    points, room = ([table[k] for k in kept] for table in (points, room))
    rows = [[loosest(own[i:k]) for i, k in pairwise(kept)] for own in rows]
    least = [sum(least[i:k]) for i, k in pairwise(kept)]
    waits = [waits[k] for k in kept]
elif not others.keys() & {"dwell", "given_times", "least_times", "tolerance"}:
    changes = {k for k in range(1, len(rows[0])) if any(own[k - 1] != own[k] for own in rows)}
    kept = exact(points, changes)
    points, room = ([table[k] for k in kept] for table in (points, room))
    rows = [[own[k - 1] for k in kept[1:]] for own in rows]
others |= {name: limits[name] for name in limits.keys() - set(LIMITS)}  # a bound may drop one
if digest(tables + sorted(others.items())) != said["problem"]["digest"]:
    refuse("these are another problem's numbers")
rest = [NONE] * len(points[0])
ends = [[others.get(key, rest) for key in keys] for keys in ENDS]  # v, a at the start and the end
states = [[row[j] for keys in ends for row in keys] for j in range(len(rest))]
moving = [j for j in range(len(rest)) if len({x[j] for x in points}) > 1 or any(states[j])]
way = [[b[j] - a[j] for j in moving] for a, b in pairwise(points)]  # segment by segment
K, N = len(way), len(moving)
room = [[row[j] for j in moving] for row in room]
slack = [[r + s for r, s in zip(a, b, strict=True)] for a, b in pairwise(room)]  # of each segment
sizes = [[[[x and abs(x) for x in row[j]] for j in moving] for row in own] for own in rows[:3]]
V, A, J = sizes  # by segment and joint, down and up
positions = [pairs[3][j] for j in moving]
falls = [limits.get("falling_velocity", {j: [None]})[j] for j in moving]  # o, d and the range
falls = [None if None in fall or any(map(any, room)) else fall for fall in falls]


def widest(table, j):  # of all segments
    down_and_up = zip(*(row[j] for row in table), strict=True)
    return [None if None in own else max(own) for own in down_and_up]


# --- a bound in closed form: the longest way of one joint from rest to rest in a given time ---


def farthest(time, j, sign):
    v, a, jerk = (widest(table, j) for table in (V, A, J))
    slowness = 1 / a[0] + 1 / a[1]
    peak = min(v[sign], time / slowness)
    reach = peak * (time - peak * slowness / 2)
    if None in jerk:
        return reach
    v, a, jerk = max(v), max(a), max(jerk)
    half = time / 2
    v = min(v, jerk * half**2 / 4 if half * jerk <= 2 * a else a * (half - a / jerk))
    rise = v / a + a / jerk if v * jerk >= a**2 else 2 * root(v / jerk)
    return min(reach, v * (time - rise))


if not proof:
    total = [sum(x) for x in zip(*way, strict=True)]
    moved = claimed - sum(waits)
    at_rest = not closed and not any(map(any, states))
    alone = at_rest and any(farthest(moved, j, total[j] > 0) <= abs(total[j]) for j in range(N))
    slowest = [
        max(max(abs(h) - r[j], 0) / v[j][h > 0] for j, h in enumerate(x))
        for x, v, r in zip(way, V, slack, strict=True)
    ]
    holds = alone or moved <= sum(map(max, slowest, least))
    print(f"closed form: {float(claimed):.9f} s {'holds' if holds else 'does not hold'}")
    sys.exit(not holds)


# --- the relaxation, in the proof's units; its variables by number ---

unit, *sizes = proof["units"]
if len(sizes) != N or min(unit, *sizes) <= 0 or proof["cutoff"][0] <= 0:
    refuse("units of time and of every joint, and a cut-off")
U = proof["cutoff"][0] / unit
way, room, slack = (
    [[h / sizes[j] for j, h in enumerate(row)] for row in table] for table in (way, room, slack)
)
A = [[[a * unit**2 / sizes[j] for a in row[j]] for j in range(N)] for row in A]
J = [[[x and x * unit**3 / sizes[j] for x in row[j]] for j in range(N)] for row in J]
v0, vK, a0, aK = (
    [row[j] * unit**power / size for j, size in zip(moving, sizes, strict=True)]
    for power, keys in enumerate(ends, start=1)
    for row in keys
)
for j in range(N):  # from the start's velocity to a peak, and from there to the end's
    braking, speeding = widest(A, j)
    gained = (abs(v0[j]) + abs(vK[j])) / min(braking, speeding)
    reached = up((U + gained) / (1 / braking + 1 / speeding))
    for row in V:
        row[j] = [min(v * unit / sizes[j], inf if closed else reached) for v in row[j]]
for fall, size in zip(falls, sizes, strict=True):
    if fall:
        fall[:2] = fall[0] * unit / size, fall[1] * unit**2 / size
jerky = [j for j in range(N) if any(row[j] != [None, None] for row in J)]
free = range(K - 1 + closed)  # waypoints with a state: a closed motion's last one too
inner = [(k, j) for k in free for j in jerky]  # with an acceleration
offset = [(k, j) for k in free for j in range(N) if room[k + 1][j]]  # with a tolerance
overlaps = [all(abs(way[k][j]) <= APART * slack[k][j] for j in range(N)) for k in range(K)]
instants = [k for k in range(K) if overlaps[k] and not least[k]]  # segments of no time
instants = [(k, j, side) for k in instants for j in range(N) for side in range(2)]
M = len(free) * N
S, Q, v, a, before, after = K, 2 * K, 3 * K, 3 * K + M, 3 * K + 2 * M, 3 * K + 3 * M
e, e_before, e_after = after + M, after + 2 * M, after + 3 * M  # offsets; these times S


def near(k, j, side):  # from waypoint k to the end of the range, and to where nothing is allowed
    o, d, *ends = falls[j]
    distance = abs(ends[side] - points[k][moving[j]]) / sizes[j]
    return distance, distance - o**2 / (2 * d)


def allowed(k, j, side):  # highest velocity at waypoint k, between two segments
    both = min(V[k - 1][j][side], V[k % K][j][side])
    if falls[j] is None:
        return both
    o, d, *_ = falls[j]
    return min(both, max(root(2 * d * near(k, j, side)[0]) + 1 / Fraction(DIGITS) - o, NONE))


def wall(k, j, side):  # farthest position in segment k from its start
    sign = 1 if side else -1
    limit = positions[j][side]
    ends = [] if limit is None else [sign * (limit - points[k][moving[j]]) / sizes[j]]
    ends += [max(near(k, j, side)[1], NONE)] if falls[j] else []
    return sign * min(ends) if ends else refuse("λ changes without a position limit")


def root_box():
    low, high = [NONE] * before, [NONE] * before  # times, velocities, accelerations
    for k, row in enumerate(way):
        ways = [(max(abs(h) - slack[k][j], NONE), V[k][j][h > 0]) for j, h in enumerate(row)]
        shortest = [down(h / v) for h, v in ways]
        low[k] = max(least[k] / unit, *shortest)
        high[k] = least[k] / unit if given else U
    for k, j in ((k, j) for k in free for j in range(N)):
        low[v + k * N + j], high[v + k * N + j] = -allowed(k + 1, j, 0), allowed(k + 1, j, 1)
        if j in jerky:
            braking, speeding = map(min, A[k][j], A[(k + 1) % K][j])
            low[a + k * N + j], high[a + k * N + j] = -braking, speeding
        if waits[k + 1] and not closed:  # at rest
            for x in (v + k * N + j, a + k * N + j):
                low[x] = high[x] = NONE
    return low, high


def sides(x, low, high):  # bounds of any variable, from those of the box
    if x < S or v <= x < before:
        return low[x], high[x]
    if x < Q:
        return (down(1 / high[x - S]), up(1 / low[x - S])) if low[x - S] > 0 else (-inf, inf)
    if x < v:
        return low[x - Q] ** 2, high[x - Q] ** 2
    place = (x - before) % M
    k = (place // N + (after <= x < e or x >= e_after)) % K
    if x >= e:
        r = room[place // N + 1][place % N]
        if x < e_before:
            return -r, r
        if low[k] <= 0:
            return -inf, inf
        return -r * up(1 / low[k]), r * up(1 / low[k])
    corners = [y * t for y in (low[a + place], high[a + place]) for t in (low[k], high[k])]
    return min(corners), max(corners)


# --- rows: coefficients by variable, and the upper bound of their sum ---


def value(f, s):
    return f[0] + s * (f[1] + s * f[2])


def weighed(f, width, weights):  # at least ∫ (up f⁺ + down f⁻) of f₀ + f₁ s + f₂ s²
    f0, f1, f2 = f
    roots = []
    vertex = -f1 / (2 * f2) if f2 else 0
    if f2 and f1**2 > 4 * f2 * f0:
        half = root(f1**2 / 4 - f2 * f0) / f2
        roots = [vertex - half, vertex + half]
    elif f1 and not f2:
        roots = [-f0 / f1]
    borders = sorted([0, width, *(down(s) for s in roots if 0 < down(s) < width)])
    total = 0
    for begin, end in pairwise(borders):
        gained = [s * (f0 + s * (f1 * HALF + s * f2 * THIRD)) for s in (begin, end)]
        gained = gained[1] - gained[0]
        sign = 1 if gained >= 0 else -1
        places = [begin, end, *([vertex] if begin < vertex < end else [])]
        depth = max(0, *(-sign * value(f, s) for s in places))  # largest value of the other sign
        total += most(gained, -weights[0], weights[1]) + sum(weights) * depth * (end - begin)
    return total


def jumps(functions, widths, weights):
    ends = [value(f, w) for f, w in zip(functions, widths, strict=True)]
    return sum(
        most(f[0] - end, -weights[0], weights[1])
        for f, end in zip(functions[1:], ends[:-1], strict=True)
    )


def cut(k, j, cells):  # the row of p, q and λ: section 5b of the mathematics
    starts, *_, slopes, rates = zip(*cells, strict=True)
    widths = [end - start for start, end in pairwise([*starts, Fraction(1)])]
    if starts[0] != 0 or min(widths) <= 0:
        refuse("cells that do not divide a segment")
    p, q = [list(cell[1:4]) for cell in cells], [[*cell[4:6], NONE] for cell in cells]
    jerk = J[k][j]
    if jerk == [None, None] and any(any(f) for f in p):
        refuse("p without a jerk limit")
    for f, width in zip(p, widths, strict=True):  # p without the sign of a free jerk
        vertex = min(max(-f[1] / (2 * f[2]), 0), width) if f[2] else 0
        values = [value(f, s) for s in (0, vertex, width)]
        if None in jerk and jerk != [None, None]:
            f[0] -= min(0, *values) if jerk[0] is None else max(0, *values)
    jerk = [x or 0 for x in jerk]
    bends = [[f[1] + g[0], 2 * f[2] + g[1], NONE] for f, g in zip(p, q, strict=True)]
    turns = [[g[1] + s, rate, NONE] for g, s, rate in zip(q, slopes, rates, strict=True)]
    ends = [s + rate * width for s, rate, width in zip(slopes, rates, widths, strict=True)]
    changes = [later - end for end, later in zip(ends, slopes[1:], strict=False)]
    distance = sum(change * wall(k, j, change > 0) for change in changes if change)
    row = {k: -jumps(p, widths, A[k][j]), Q + k: 0}
    bound = jumps(q, widths, V[k][j])
    for turn, width in zip(turns, widths, strict=True):  # λ changes at a rate
        start, rate, _ = turn
        side = rate > 0
        if rate and falls[j] and start * rate >= 0 and near(k, j, side)[1] > 0:
            o, d, *_ = falls[j]  # μ v + λ' x is at most d T μ²/(2 λ') + λ' S (end − start) − o μ
            start, rate, turn[:] = abs(start), abs(rate), [NONE] * 3
            end = start + rate * width
            row[k] -= d * width * (start**2 + start * end + end**2) * THIRD / (2 * rate)
            distance += rate * width * near(k, j, side)[0]
            bound -= o * width * (start + end) * HALF
        elif rate:
            distance += rate * width * wall(k, j, side)
    row[S + k] = ends[-1] * way[k][j] - distance
    for f, bend, turn, width in zip(p, bends, turns, widths, strict=True):
        row[Q + k] -= weighed(f, width, jerk)
        row[k] -= weighed(bend, width, A[k][j])
        bound += weighed(turn, width, V[k][j])
    if k > 0 or closed:
        place = (k - 1) % K * N + j
        row[v + place], row[after + place] = -q[0][0], -p[0][0]
        row[e_after + place] = -slopes[0]
    else:
        bound += q[0][0] * v0[j]
        row[k] -= p[0][0] * a0[j]
    if k < K - 1 or closed:
        place = k * N + j
        row[v + place], row[before + place] = value(q[-1], widths[-1]), value(p[-1], widths[-1])
        row[e_before + place] = ends[-1]
    else:
        bound -= value(q[-1], widths[-1]) * vK[j]
        row[k] += value(p[-1], widths[-1]) * aK[j]
    return row, bound


def ramp(k, j, side):  # a₁ − a₀ ≤ J T
    if J[k][j][side] is None:
        refuse("a ramp without a jerk limit")
    sign = 1 if side else -1
    row = {k: -J[k][j][side]}
    if k > 0 or closed:
        row[a + (k - 1) % K * N + j] = -sign
    if k < K - 1 or closed:
        row[a + k * N + j] = sign
    return row, sign * (a0[j] * (k == 0) - aK[j] * (k == K - 1))


def corner(i, low, high):  # α between the products of a and T at the box's corners
    later, i = divmod(i, 4 * len(inner))
    (k, j), i = inner[i // 4], i % 4
    place = k * N + j
    sign = -1 if i < 2 else 1
    time = (k + later) % K
    x, t = (high if i in (1, 2) else low)[a + place], (high if i in (1, 3) else low)[time]
    row = {(after if later else before) + place: sign, time: -sign * x, a + place: -sign * t}
    return row, -sign * x * t


def near_corner(i, low, high):  # an offset times S likewise
    later, i = divmod(i, 4 * len(offset))
    (k, j), i = offset[i // 4], i % 4
    place, inverse = k * N + j, S + (k + later) % K
    sign = -1 if i < 2 else 1
    x, t = (sides(y, low, high)[i in own] for y, own in ((e + place, (1, 2)), (inverse, (1, 3))))
    product = (e_after if later else e_before) + place
    return {product: sign, inverse: -sign * x, e + place: -sign * t}, -sign * x * t


def passed(k, j, side):  # h + p₁ − p₀ ≤ V T, where a segment may take no time
    sign = 1 if side else -1
    row = {k: -V[k][j][side]}
    for own, changes in ((k - 1, -sign), (k, sign)):
        if own % K in free and (own >= 0 or closed):
            row[e + own % K * N + j] = changes
    return row, -sign * way[k][j]


squares = [(whole(k, K), t) for k, t in proof.get("square_tangents", [])]
others = [({(k := whole(at, K)): -1, S + k: -(t**2)}, -2 * t) for at, t in proof["tangents"]]
for k, j, side in proof.get("ramps", []):
    others.append(ramp(whole(k, K), whole(j, N), whole(side, 2)))
if any(t <= 0 for _, t in [*squares, *proof["tangents"]]):
    refuse("a tangent at 0 or below")
used = 0
cells = [[*cell, NONE] for cell in proof["cells"]]
for cell, rate in proof.get("rates", []):
    cells[whole(cell, len(cells))][-1] = rate
for k, j, count in proof["cuts"]:
    last = used + whole(count, len(cells) - used + 1)
    others.append(cut(whole(k, K), whole(j, N), cells[used:last]))
    used = last


def row(i, low, high):
    if i == 0:
        return dict.fromkeys(range(K), 1), U
    if i <= 2 * K:
        k, of_square = divmod(i - 1, 2)
        added, product = low[k] + high[k], low[k] * high[k]
        return ({k: -added, Q + k: 1}, -product) if of_square else ({k: 1, S + k: product}, added)
    i -= 1 + 2 * K
    if i < 8 * len(inner):
        return corner(i, low, high)
    i -= 8 * len(inner)
    if i < 8 * len(offset):
        return near_corner(i, low, high)
    i -= 8 * len(offset)
    if i < len(instants):
        return passed(*instants[i])
    i -= len(instants)
    if i < len(squares):  # (h − T) (T − t)² / T ≥ 0
        k, t = squares[i]
        h = high[k]
        return {Q + k: 1, k: -h - 2 * t, S + k: -h * t**2}, -2 * h * t - t**2
    return others[i - len(squares)]


# --- the tree of boxes ---


def is_empty(low, high):
    return any(x > y for x, y in zip(low, high, strict=True))


def bound(objective, low, high, multipliers):  # any multipliers y ≥ 0 of the rows give one
    coefficients, constant = dict(objective), 0
    for i, y in multipliers:
        own, largest = row(i, low, high)
        if y > 0 and not any(c and sides(x, low, high)[1] == inf for x, c in own.items()):
            for x, c in own.items():
                coefficients[x] = coefficients.get(x, 0) + y * c
            constant -= y * largest
    terms = ((c, sides(x, low, high)) for x, c in coefficients.items() if c)
    return constant + sum(min(c * least, c * largest) for c, (least, largest) in terms)


def raised(low, x, at):
    return [max(side, down(at)) if i == x else side for i, side in enumerate(low)]


def lowered(high, x, at):
    return [min(side, up(at)) if i == x else side for i, side in enumerate(high)]


total = dict.fromkeys(range(K), 1)
rows = 1 + 2 * K + 8 * (len(inner) + len(offset)) + len(instants) + len(squares) + len(others)
boxes, proved, used = [root_box()], U, 0
if is_empty(*boxes[0]):
    refuse("a cut-off below what a segment takes")
for kind, x, at, count in proof["steps"]:
    if not boxes:
        refuse("a step after the last leaf")
    low, high = boxes.pop()
    last = used + whole(count, len(proof["multipliers"]) - used + 1)
    own = [(whole(i, rows), y) for i, y in proof["multipliers"][used:last]]
    used = last
    x = whole(x, before)
    if S <= x < v or kind not in (RAISE, LOWER, BRANCH, LEAF):
        refuse("a step of an unknown kind or variable")
    if is_empty(low, high):
        boxes += [] if kind == LEAF else [(low, high)] * (1 + (kind == BRANCH))
    elif kind == LEAF:
        proved = min(proved, bound(total, low, high, own))
    elif kind == BRANCH:  # the lower part comes first
        boxes += [(raised(low, x, at), high), (low, lowered(high, x, at))]
    elif kind == RAISE:
        least = bound({x: 1}, low, high, own)
        boxes.append((raised(low, x, min(least, at) if at else least), high))
    else:
        largest = -bound({x: -1}, low, high, own)
        boxes.append((low, lowered(high, x, max(largest, at) if at else largest)))
if boxes:
    refuse("a branch without a leaf")
proved = max(proved * unit, NONE) + sum(waits)
print(f"no motion is briefer than {float(proved):.9f} s; recorded: {float(claimed):.9f} s")
sys.exit(proved < claimed)
