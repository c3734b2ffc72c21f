"""Check a record's lower bound in exact fractions: python check_proof.py < RECORD.json"""

import json
import sys
from fractions import Fraction

import numpy as np

exact = np.vectorize(Fraction, otypes=[object])
most = np.vectorize(lambda c, low, high: max(c * low, c * high), otypes=[object])  # of c z
said = json.load(sys.stdin)
proof = {name: exact(rows) if rows else [] for name, rows in said["proof"].items()}
unit, *size = abs(proof["units"])
size, U = np.reshape(size, (-1, 1)), abs(proof["cutoff"][0]) / unit
x = exact(said["problem"]["waypoints"])
x = x[[True, *(x[1:] != x[:-1]).any(axis=1)]].T  # (joints, waypoints), repeated ones once
moving = (x != x[:, :1]).any(axis=1)
x, K = x[moving] / size, x.shape[1] - 1
limits = (exact(said["problem"]["limits"][name]) for name in ("velocity", "acceleration"))
V, A = (pairs[moving] / size * unit**order for order, pairs in enumerate(limits, start=1))
R = U / (1 / A - 1 / A[:, ::-1])  # the velocity reached between rest and rest within U
V = np.clip(V, R[:, :1], R[:, 1:])
t = np.max([most(h, *1 / V[j]) for j, h in enumerate(np.diff(x))], axis=0)  # t ≤ T ≤ U
y = np.zeros(1 + 2 * K + len(proof["tangents"]) + len(proof["cuts"]), dtype=object)
for row, multiplier in proof["multipliers"]:
    y[int(row)] += max(multiplier, 0)
# ΣT + Σ y (row - its bound) as c·T + c·S + c·Q + c·v - b, with S = 1/T and Q = T²
below, above, *others = y[1 : 2 * K : 2], y[2 : 2 * K + 1 : 2], *y[2 * K + 1 :]
T, S, Q = 1 + y[0] + below - above * (t + U), below * t * U, above  # secants, on [t, U]
b, v = y[0] * U + sum(below * (t + U) - above * t * U), np.zeros(x.shape, dtype=object)
for k, at in proof["tangents"]:
    weight = others.pop(0)  # of S ≥ 2/at - T/at²
    T[int(k)], S[int(k)], b = T[int(k)] - weight, S[int(k)] - weight * at**2, b - 2 * weight * at
for k, j, count in np.array(proof["cuts"], dtype=int):  # any q and λ, section 5b with p = 0
    cells, proof["cells"] = np.split(proof["cells"], [count])
    weight, (start, *_, q, slope, costate) = others.pop(0), cells.T
    width = np.diff([*start, 1])
    if min(k, j) < 0 or start[0] != 0 or min(width) <= 0:
        sys.exit("no proof: cells that do not divide a segment")
    end, turning = q + slope * width, slope + costate[0]
    twice = end * most(end, *A[j]) - q * most(q, *A[j])
    area = np.where(slope == 0, most(q, *A[j]) * width, twice / (2 * slope + (slope == 0)))
    T[k] -= weight * sum(area)
    S[k] += weight * costate[0] * (x[j, k + 1] - x[j, k])
    b += weight * sum([*most(turning, *V[j]) * width, *most(q[1:] - end[:-1], *V[j])])
    v[j, k : k + 2] += weight * np.array([-q[0], end[-1]])
sides = [(T, t, U), (S, 1 / U, 1 / t), (Q, t**2, U**2), *zip(v[:, 1:-1], *V.T, strict=True)]
proved = min(-b - sum(sum(most(-c, low, high)) for c, low, high in sides), U) * unit
print(f"no motion is briefer than {float(proved):.9f} s; recorded: {said['lower_bound']:.9f} s")
sys.exit(proved < Fraction(said["lower_bound"]))
