"""The paper's equations as printed, each beside its right form, on random postures.

Whatever an equation says is equal is computed on both sides, from eq. 1 and Table 1 alone: a right
equation leaves rounding. Lengths are in m. The equations were read from a copy by machine.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from trajopt import Problem
from trajopt.core.arrays import Array
from trajopt.planners import spline353
from trajopt.planners.kinematics import Robot
from trajopt.planners.swarm.issa import chaotic_map

POSTURES = 1000
Errors = Callable[[Any], Any]


class Equation(NamedTuple):
    """An equation: by how much it is wrong as printed, and in its right form.

    Attributes:
        key: Its key in `data/reference/claims.csv`.
        printed: Left side minus right side, as printed.
        right: The same of the right form.
        words: The right form, or why none is needed.
    """

    key: str
    printed: Errors
    right: Errors
    words: str


def symbols(robot: Robot, q: Array) -> SimpleNamespace:
    """Return what the paper's equations name, at postures `(n, 6)` rad.

    `px`, `py`, `pz` is the place of the hand, `wx`, `wy`, `wz` that of the wrist centre.
    """
    named: dict[str, Array] = {}
    for i, angle in enumerate(q.T, start=1):
        named |= {f"q{i}": angle, f"c{i}": np.cos(angle), f"s{i}": np.sin(angle)}
    named |= {"c23": np.cos(q[:, 1] + q[:, 2]), "s23": np.sin(q[:, 1] + q[:, 2])}
    named |= {f"a{i}": robot.a[i] for i in (1, 2, 3)}
    named |= {f"d{i}": robot.d[i - 1] for i in (2, 3, 4, 6)}
    pose = robot.forward(q)
    wrist = pose[:, :3, 3] - robot.d[5] * pose[:, :3, 2]
    for row, axis in enumerate("xyz"):
        named |= {f"{name}{axis}": pose[:, row, i] for i, name in enumerate("noap")}
        named[f"w{axis}"] = wrist[:, row]
    return SimpleNamespace(**named)


def _turn(v: Any) -> Any:
    """`c4 c5 c6 − s4 s6`, in n."""
    return v.c4 * v.c5 * v.c6 - v.s4 * v.s6


def _back(v: Any) -> Any:
    """`−c4 c5 s6 − s4 c6`, in o."""
    return -v.c4 * v.c5 * v.s6 - v.s4 * v.c6


def _bend(v: Any) -> Any:
    """`c23 c4 s5 + s23 c5`, in a."""
    return v.c23 * v.c4 * v.s5 + v.s23 * v.c5


def _ahead(v: Any) -> Any:
    """`a1 + a2 c2 + a3 c23 − d4 s23`: along the arm's plane."""
    return v.a1 + v.a2 * v.c2 + v.a3 * v.c23 - v.d4 * v.s23


def _printed_py(v: Any) -> Any:
    inner = v.c1 * v.s4 * v.s5 - v.c5 * v.s1 * v.s23
    inner += -v.c2 * v.c3 * v.c4 * v.s1 * v.s5 + v.c4 * v.s1 * v.s2 * v.s3 * v.s5
    links = v.a3 * v.c2 * v.s1 + v.a2 * v.c2 * v.s2 + v.a1 * v.s1
    return v.d6 * inner - v.d4 * v.s1 * v.s23 + v.d3 * v.c1 + links - v.py


def _right_py(v: Any) -> Any:
    inner = v.c1 * v.s4 * v.s5 - v.c5 * v.s1 * v.s23 - v.c23 * v.c4 * v.s1 * v.s5
    links = v.a3 * v.c23 * v.s1 + v.a2 * v.c2 * v.s1 + v.a1 * v.s1
    return v.d6 * inner - v.d4 * v.s1 * v.s23 + (v.d2 + v.d3) * v.c1 + links - v.py


def _px(v: Any) -> Any:
    inner = -v.s5 * (v.s1 * v.s4 + v.c1 * v.c4 * v.c23) - v.c1 * v.c5 * v.s23
    links = v.a1 * v.c1 + v.a2 * v.c1 * v.c2 + v.a3 * v.c1 * v.c23
    return v.d6 * inner - v.d4 * v.c1 * v.s23 - (v.d3 + v.d2) * v.s1 + links - v.px


def _pz(v: Any) -> Any:
    wrist = v.d6 * (v.c4 * v.s5 * v.s23 - v.c5 * v.c23)
    return wrist - v.d4 * v.c23 - v.a3 * v.s23 - v.a2 * v.s2 - v.pz


def _at(place: str) -> dict[str, Errors]:
    """Return eq. 5 to 15 where (x, y, z) is the hand's place `p`, or the wrist centre `w`."""

    def x(v: Any) -> Any:
        return getattr(v, f"{place}x")

    def y(v: Any) -> Any:
        return getattr(v, f"{place}y")

    def z(v: Any) -> Any:
        return getattr(v, f"{place}z")

    def along(v: Any) -> Any:
        return v.c1 * x(v) + v.s1 * y(v)

    def eq5(v: Any) -> Any:
        return -v.s1 * x(v) + v.c1 * y(v) - v.d3

    def eq6(v: Any) -> Any:
        """The nearer of its two solutions, less θ1."""
        root = np.sqrt(np.maximum(x(v) ** 2 + y(v) ** 2 - v.d3**2, 0))
        both = [np.arctan2(y(v), x(v)) - np.arctan2(v.d3, sign * root) - v.q1 for sign in (1, -1)]
        return np.min([np.abs(np.sin(own / 2)) for own in both], axis=0)

    def eq7(v: Any) -> Any:
        down = v.a3 * v.s23 + v.d4 * v.c23 + v.a2 * v.s2
        return np.stack([along(v) - _ahead(v), -z(v) - down])

    def k(v: Any, over: Any) -> Any:
        """Eq. 8's k, its numerator divided by `over`, less a3 c3 − d4 s3."""
        squares = x(v) ** 2 + y(v) ** 2 + z(v) ** 2 + v.a1**2
        lengths = v.a2**2 + v.a3**2 + v.d3**2 + v.d4**2
        given = (squares - lengths - 2 * v.a1 * along(v)) / over
        return given - (v.a3 * v.c3 - v.d4 * v.s3)

    def eq11(v: Any) -> Any:
        return v.c23 * along(v) - v.s23 * z(v) - v.a1 * v.c23 - v.a2 * v.c3 - v.a3

    def eq12(v: Any) -> Any:
        return -v.s23 * along(v) - v.c23 * z(v) + v.a1 * v.s23 + v.a2 * v.s3 - v.d4

    def eq14(v: Any) -> Any:
        ahead = along(v) - v.a1
        sine = (-v.a3 - v.a2 * v.c3) * z(v) + ahead * (v.a2 * v.s3 - v.d4)
        return sine / (z(v) ** 2 + ahead**2) - v.s23

    def eq15(v: Any) -> Any:
        ahead = along(v) - v.a1
        cosine = (-v.d4 + v.a2 * v.s3) * z(v) - ahead * (-v.a2 * v.c3 - v.a3)
        return cosine / (z(v) ** 2 + ahead**2) - v.c23

    return {
        "eq5": eq5,
        "eq6": eq6,
        "eq7": eq7,
        "eq8": lambda v: k(v, 2 * v.a1**2),
        "eq8-right": lambda v: k(v, 2 * v.a2),
        "eq11": eq11,
        "eq12": eq12,
        "eq14": eq14,
        "eq15": eq15,
    }


def _eq16(v: Any) -> Any:
    return v.ax * v.c1 * v.c23 + v.ay * v.c23 * v.s1 - v.az * v.s23 + v.c4 * v.s5


def _eq17(v: Any) -> Any:
    return -v.ax * v.s1 + v.ay * v.c1 - v.s4 * v.s5


def _eq18(v: Any, signs: tuple[int, ...]) -> Any:
    """The sine of half the angle from θ4, for the nearest of these signs of s5."""
    sine = -v.ax * v.s1 + v.ay * v.c1
    cosine = -v.ax * v.c1 * v.c23 - v.ay * v.c23 * v.s1 + v.az * v.s23
    apart = [np.arctan2(sign * sine, sign * cosine) - v.q4 for sign in signs]
    return np.min([np.abs(np.sin(own / 2)) for own in apart], axis=0)


def _eq20(v: Any) -> Any:
    ahead = v.ax * (v.s1 * v.s4 + v.c1 * v.c4 * v.c23)
    across = v.ay * (v.s1 * v.c23 * v.c4 - v.c1 * v.s4)
    return ahead + across - v.az * v.s23 * v.c4 + v.s5


def _eq21(v: Any) -> Any:
    return -v.ax * v.c1 * v.s23 - v.ay * v.s1 * v.s23 - v.az * v.c23 - v.c5


def _eq24(v: Any) -> Any:
    ahead = -v.nx * (v.c1 * v.c23 * v.s4 - v.s1 * v.c4)
    across = -v.ny * (v.s1 * v.c23 * v.s4 + v.c1 * v.c4)
    return ahead + across + v.nz * v.s23 * v.s4 - v.s6


def _eq25(v: Any) -> Any:
    ahead = (v.c1 * v.c23 * v.c4 + v.s1 * v.s4) * v.c5 - v.c1 * v.s23 * v.s5
    across = (v.s1 * v.c23 * v.c4 - v.c1 * v.s4) * v.c5 - v.s1 * v.s23 * v.s5
    down = v.s23 * v.c4 * v.c5 + v.c23 * v.s5
    return v.nx * ahead + v.ny * across - v.nz * down - v.c6


_HAND = _at("p")
_WRIST = _at("w")
# What is right of an equation: it is about the wrist, or needs no change.
CENTRE = "p is the wrist centre, p − d6 a"
HOLDS = "as printed"


def _wrist(key: str) -> Equation:
    return Equation(key, _HAND[key], _WRIST[key], CENTRE)


def _holds(key: str, error: Errors) -> Equation:
    return Equation(key, error, error, HOLDS)


KINEMATICS = (
    _holds(
        "eq3-nx",
        lambda v: (
            v.c1 * (v.c23 * _turn(v) - v.s23 * v.s5 * v.c6)
            + v.s1 * (v.s4 * v.c5 * v.c6 + v.c4 * v.s6)
            - v.nx
        ),
    ),
    _holds(
        "eq3-ny",
        lambda v: (
            v.s1 * (v.c23 * _turn(v) - v.s23 * v.s5 * v.c6)
            - v.c1 * (v.s4 * v.c5 * v.c6 + v.c4 * v.s6)
            - v.ny
        ),
    ),
    Equation(
        "eq3-nz",
        lambda v: -v.s23 * _turn(v) - v.s23 * v.s5 * v.c6 - v.nz,
        lambda v: -v.s23 * _turn(v) - v.c23 * v.s5 * v.c6 - v.nz,
        "−s23 (c4 c5 c6 − s4 s6) − c23 s5 c6",
    ),
    _holds(
        "eq3-ox",
        lambda v: (
            v.c1 * (v.c23 * _back(v) + v.s23 * v.s5 * v.s6)
            + v.s1 * (v.c4 * v.c6 - v.s4 * v.c5 * v.s6)
            - v.ox
        ),
    ),
    Equation(
        "eq3-oy",
        lambda v: (
            v.s1 * (v.c23 * _back(v) + v.s23 * v.s5 * v.s6)
            - v.c1 * (v.c4 * v.c6 - v.s4 * v.c5 * v.c6)
            - v.oy
        ),
        lambda v: (
            v.s1 * (v.c23 * _back(v) + v.s23 * v.s5 * v.s6)
            - v.c1 * (v.c4 * v.c6 - v.s4 * v.c5 * v.s6)
            - v.oy
        ),
        "s1 [c23 (−c4 c5 s6 − s4 c6) + s23 s5 s6] − c1 (c4 c6 − s4 c5 s6)",
    ),
    _holds("eq3-oz", lambda v: -v.s23 * _back(v) + v.c23 * v.s5 * v.s6 - v.oz),
    Equation(
        "eq3-ax",
        lambda v: -v.c1 * _bend(v) - v.c1 * v.s4 * v.s5 - v.ax,
        lambda v: -v.c1 * _bend(v) - v.s1 * v.s4 * v.s5 - v.ax,
        "−c1 (c23 c4 s5 + s23 c5) − s1 s4 s5",
    ),
    Equation(
        "eq3-ay",
        lambda v: -v.s1 * _bend(v) - v.c1 * v.s4 * v.s5 - v.ay,
        lambda v: -v.s1 * _bend(v) + v.c1 * v.s4 * v.s5 - v.ay,
        "−s1 (c23 c4 s5 + s23 c5) + c1 s4 s5",
    ),
    _holds("eq3-az", lambda v: v.s23 * v.c4 * v.s5 - v.c23 * v.c5 - v.az),
    _holds("eq3-px", _px),
    Equation("eq3-py", _printed_py, _right_py, "a3 c23 s1 + a2 c2 s1 for a3 c2 s1 + a2 c2 s2"),
    _holds("eq3-pz", _pz),
    _wrist("eq5"),
    _wrist("eq6"),
    _wrist("eq7"),
    Equation("eq8", _HAND["eq8"], _WRIST["eq8-right"], f"over 2 a2; {CENTRE}"),
    _wrist("eq11"),
    _wrist("eq12"),
    _wrist("eq14"),
    _wrist("eq15"),
    _holds("eq16", _eq16),
    _holds("eq17", _eq17),
    Equation(
        "eq18",
        lambda v: _eq18(v, (1,)),
        lambda v: _eq18(v, (1, -1)),
        "two solutions, θ4 and θ4 + π with −θ5: eight in all, not four",
    ),
    _holds("eq20", _eq20),
    _holds("eq21", _eq21),
    _holds("eq24", _eq24),
    _holds("eq25", _eq25),
)


def _velocities(quintic: Array, t: Array, printed: bool) -> tuple[Array, Array]:
    """Return velocity and acceleration of eq. 28, with its cubic terms as printed or right."""
    p5, p4, p3, p2, p1, _ = quintic
    power = 1 if printed else 0
    v = 5 * p5 * t**4 + 4 * p4 * t**3 + 3 * p3 * t ** (2 + power) + 2 * p2 * t + p1
    cubic = 9 * p3 * t**2 if printed else 6 * p3 * t
    return v, 20 * p5 * t**3 + 12 * p4 * t**2 + cubic + 2 * p2


def _eq28(problem: Problem) -> tuple[float, float]:
    """By how much eq. 28 misses the derivatives of the quintic of 2 s, rad/s or rad/s²."""
    steps = np.diff(problem.waypoints, axis=0).T
    quintics = spline353.coefficients(steps, np.full_like(steps, 2.0))[1]
    t = np.linspace(0, 2, 201)
    missed = []
    for printed in (True, False):
        largest = 0.0
        for quintic in quintics:
            for order, own in enumerate(_velocities(quintic, t, printed), start=1):
                true = np.polyval(np.polyder(quintic, order), t)
                largest = max(largest, float(np.abs(own - true).max()))
        missed.append(largest)
    return missed[0], missed[1]


def _eq33(t1: float, t2: float, t3: float) -> Array:
    """Return the matrix A of eq. 33."""

    def ends(t: float, degree: int) -> Array:
        """Rows of position, velocity and acceleration at the end of a piece, falling powers."""
        powers = np.eye(degree + 1)
        return np.array(
            [[np.polyval(np.polyder(p, order), t) for p in powers] for order in range(3)]
        )

    matrix = np.zeros((14, 14))
    matrix[0:3, 0:4] = ends(t1, 3)
    matrix[3:6, 4:10] = ends(t2, 5)
    matrix[6:9, 10:14] = ends(t3, 3)
    matrix[[0, 1, 2], [9, 8, 7]] = [-1, -1, -2]
    matrix[[3, 4, 5], [13, 12, 11]] = [-1, -1, -2]
    matrix[[9, 10, 11, 12, 13], [3, 2, 1, 13, 9]] = 1
    return matrix


def _eq31(problem: Problem) -> tuple[float, float]:
    """By how much the curve of eq. 30, 31 and 33 misses the four points, rad."""
    missed = []
    x = problem.waypoints
    free = [None] * 6
    printed = [*free, 0, None, None, 1, None, None, 2, 3]
    right = [*free, 3, None, None, 0, None, None, 2, 1]
    for order in (printed, right):
        values = [np.zeros(problem.joints) if i is None else x[i] for i in order]
        a = np.linalg.solve(_eq33(2.0, 2.0, 2.0), values)
        passed = [a[3], a[9], a[13], [2.0**3, 2.0**2, 2.0, 1.0] @ a[10:14]]
        missed.append(float(np.abs(passed - x).max()))
    return missed[0], missed[1]


def lyapunov(a: float, reading: Any, steps: int = 2000, runs: int = 32) -> float:
    """Return the largest Lyapunov exponent of eq. 43's map, per step: above 0 it is chaotic."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(size=(2, runs))
    offset = np.full((2, runs), 1e-9) / np.sqrt(2)
    total = np.zeros(runs)
    for step in range(steps):
        u, w = chaotic_map(x + offset[0], y + offset[1], a, reading)
        x, y = chaotic_map(x, y, a, reading)
        offset = np.array([u - x, w - y])
        size = np.maximum(np.hypot(*offset), 1e-18)
        offset *= 1e-9 / size
        if step >= steps // 10:
            total += np.log(size / 1e-9)
    return float(np.median(total) / (steps - steps // 10))


def _eq43() -> tuple[float, float]:
    """Share of 25 values of a for which orbits run together, as printed and as intended, %."""
    values = np.linspace(0.02, 0.98, 25)
    printed, right = (
        100.0 * np.mean([lyapunov(a, reading, 400, 16) < -0.01 for a in values])
        for reading in ("printed", "intended")
    )
    return float(printed), float(right)


def _eq50() -> tuple[float, float]:
    """Share of 1000 iterations whose b1 is not in [0, 1], %."""
    t = np.arange(1, 1001, dtype=float)
    with np.errstate(over="ignore"):
        both = [(1000 - t / 1000) ** t, ((1000 - t) / 1000) ** t]
    printed, right = (100 * np.mean(~((own >= 0) & (own <= 1))) for own in both)
    return float(printed), float(right)


def checks(robot: Robot, problem: Problem, postures: int = POSTURES) -> pd.DataFrame:
    """Return every equation with its largest error, as printed and in its right form.

    Args:
        robot: The robot of Table 1.
        problem: The problem of Tables 2 and 3.
        postures: How many random postures; angles from −180 to 180 degrees.
    """
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (postures, 6))
    v = symbols(robot, q)
    rows = [
        {
            "key": own.key,
            "as printed": float(np.abs(own.printed(v)).max()),
            "right form": float(np.abs(own.right(v)).max()),
            "right": own.words,
        }
        for own in KINEMATICS
    ]
    others = {
        "eq28": (
            _eq28(problem),
            "3 a3 (t − t1)² in the velocity, 6 a3 (t − t1) in the acceleration",
        ),
        "eq31": (_eq31(problem), "[0 × 6, X4, 0, 0, X1, 0, 0, X3, X2], and eq. 30 is a = A⁻¹ θ"),
        "eq43": (
            _eq43(),
            "sin(π (4 a x (1 − x) + (1 − a) sin(π y))), and the same of y without a square",
        ),
        "eq50": (_eq50(), "((t_max − t) / t_max)^t"),
    }
    for key, ((printed, right), words) in others.items():
        rows.append({"key": key, "as printed": printed, "right form": right, "right": words})
    return pd.DataFrame(rows)
