"""The verifier: every violation, just above and just below its tolerance, where no sample falls.

The plain motion is the quintic from rest to rest, `10 s³ − 15 s⁴ + 6 s⁵`; violations are added to
it as bumps `ε sᵐ (1 − s)ⁿ` inside one piece, whose peaks and end slopes are known.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines.exact.jerk import ExactJerk
from experiments.known_optima import one_way
from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging import repair, verification
from trajopt.judging.certificate import Tolerance
from trajopt.judging.verification import certified, verify
from trajopt.planners import spline353

reproducible = settings(deadline=None, derandomize=True, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
INF = np.inf
WAYPOINTS = np.array([[0.0, 0.3, 0.5], [0.4, 0.3, -0.2], [0.9, 0.3, -0.4], [0.5, 0.3, 0.1]])
WAITING = WAYPOINTS[[0, 1, 1, 3]]  # and the spike comes while it waits
LONG = 1e3  # s from waypoint to waypoint: the plain motion is slow, and no limit is near
SHORT = 1e-7  # s


def quintic_motion(waypoints, segment_time, cuts=()) -> Trajectory:
    """From rest to rest, segment by segment; every segment is cut at the same shares of it."""
    return _quintic_motion(tuple(map(tuple, waypoints)), segment_time, cuts)


@cache
def _quintic_motion(waypoints, segment_time, cuts) -> Trajectory:
    shares = np.array([0.0, *cuts, 1.0])
    blend = np.poly1d([6, -15, 10, 0, 0, 0])
    columns = []
    breaks = [0.0]
    for k, h in enumerate(np.diff(waypoints, axis=0)):
        for low, high in pairwise(shares):
            s = np.poly1d(
                [1 / segment_time, low]
            )  # a polynomial of the time since the piece's start
            piece = np.zeros(6)
            coefficients = blend(s).coeffs
            piece[6 - len(coefficients) :] = coefficients
            columns.append(np.outer(piece, h) + np.outer([0, 0, 0, 0, 0, 1], waypoints[k]))
            breaks.append((k + high) * segment_time)
    times = np.arange(len(waypoints)) * segment_time
    return Trajectory(breaks, np.stack(columns, axis=1), times)


def bumped(trajectory: Trajectory, piece: int, joint: int, bump) -> Trajectory:
    """The trajectory with a polynomial of `s` in `[0, 1]` added to one joint in one piece."""
    length = np.diff(trajectory.breaks)[piece]
    steps = np.arange(len(bump) - 1.0, -1.0, -1.0)
    added = np.array(bump) / length**steps
    rows = max(len(added), len(trajectory.coefficients))
    coefficients = np.zeros((rows, *trajectory.coefficients.shape[1:]))
    coefficients[rows - len(trajectory.coefficients) :] = trajectory.coefficients
    coefficients[rows - len(added) :, piece, joint] += added
    return Trajectory(trajectory.breaks, coefficients, trajectory.waypoint_times)


def hump(m: int, n: int) -> np.ndarray:
    """`sᵐ (1 − s)ⁿ`."""
    return np.poly([0.0] * m + [1.0] * n) * (-1) ** n


def extremes(bump, order: int) -> tuple[float, float]:
    """The least and greatest value of a derivative on `[0, 1]`, by NumPy's roots."""
    return _extremes(tuple(bump), order)


@cache
def _extremes(bump, order: int) -> tuple[float, float]:
    p = np.polyder(np.poly1d(bump), order)
    points = np.clip(np.r_[np.roots(p.deriv().coeffs).real, 0, 1], 0, 1)
    return p(points).min(), p(points).max()


@cache
def with_spike() -> tuple[Trajectory, int]:
    """A wait of 1000 s, in its midst a piece of 1e-7 s; the number of that piece."""
    share = 0.371
    trajectory = quintic_motion(WAITING, LONG, (share, share + SHORT / LONG))
    piece = 4
    differences = np.diff(trajectory.breaks)
    assert differences[piece] == pytest.approx(SHORT, rel=1e-4)
    return trajectory, piece


ROOMY = {"velocity": 1e9, "acceleration": 1e18, "jerk": 1e27}
POWER = {"velocity": 1, "acceleration": 2, "jerk": 3}
SIDES = {
    "symmetric, up": ((-1.0, 1.0), 1),
    "symmetric, down": ((-1.0, 1.0), -1),
    "tighter above": ((-50.0, 1.0), 1),
    "tighter below": ((-1.0, 50.0), -1),
    "much tighter below": ((-1e-2, 1.0), -1),
}


@pytest.mark.parametrize("beyond", [0.5e-6, 2e-6, 0.1, 3.0])
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("kind", POWER)
def test_a_spike_of_a_tenth_of_a_microsecond_in_fifty_minutes(kind, joint, side, beyond):
    (low, high), sign = SIDES[side]
    order = POWER[kind]
    trajectory, piece = with_spike()
    length = np.diff(trajectory.breaks)[piece]
    bump = sign * hump(4, 4)
    values = np.array(extremes(bump, order))
    reach = values / length**order
    limit, unit, other = (high, reach[1], reach[0]) if sign > 0 else (low, reach[0], reach[1])
    if low == -high:
        unit = np.copysign(np.abs(reach).max(), limit)
    bump = bump * limit / unit * (1 + beyond)
    other *= limit / unit * (1 + beyond) * 2  # only the side that is asked for shall count
    if low != -high:
        low, high = (min(low, other), high) if sign > 0 else (low, max(high, other))
    limits = {k: np.tile([-x, x], (3, 1)) for k, x in ROOMY.items()}
    limits[kind][joint] = low, high
    problem = Problem(WAITING, Limits(**limits))
    certificate = verify(problem, bumped(trajectory, piece, joint, bump))
    found = getattr(certificate, kind)
    assert found.value == pytest.approx(1 + beyond, rel=1e-9)
    assert found.joint == joint
    assert trajectory.breaks[piece] <= found.time <= trajectory.breaks[piece + 1]
    assert certificate.dilation == pytest.approx((1 + beyond) ** (1 / order), rel=1e-9)
    assert certificate.valid
    assert certificate.feasible == (beyond < 1e-6)
    expected = 3 * LONG * (1 + beyond) ** (1 / order)
    assert certificate.certified_duration == pytest.approx(expected, rel=1e-9)


def test_jerk_that_is_not_limited_is_not_judged():
    trajectory, piece = with_spike()
    steep = bumped(trajectory, piece, 0, hump(4, 4) * 1e-12)
    problem = Problem(WAITING, Limits([1e9] * 3, [1e18] * 3))
    assert verify(problem, steep).jerk is None
    assert verify(problem, steep).feasible


ROOM = Limits([9.0] * 3, [9.0] * 3)


def jerk_limited(joints=(0, 1, 2)) -> Limits:
    # No stiffer: a break's time is rounded, here to 16 ε · 12 s = 4e-14 s, in which acceleration
    # may change by J times that. At 9e9 rad/s³ that is 4e-4 rad/s², more than the jumps tried here.
    return Limits([9.0] * 3, [9.0] * 3, [9e4 if j in joints else INF for j in range(3)])


def within(position, waypoints=WAITING) -> Problem:
    return Problem(waypoints, Limits([1e9] * 3, [1e18] * 3, position=position))


# The largest displacement of each joint that waits, rad; the second never moves: that of all.
LARGEST = {0: 0.4, 1: 0.7, 2: 0.7}


@pytest.mark.parametrize("times", [-1e5, 0.4, 2.0, 1e5])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("one_sided", [False, True])
def test_a_spike_beyond_a_position_limit(joint, side, times, one_sided):
    beyond = times * 1e-8 * LARGEST[joint]
    trajectory, piece = with_spike()
    position = [[-INF, INF], [-INF, INF], [-INF, INF]]
    position[joint] = [-1.0, 1.0]
    if one_sided:
        position[joint][0 if side > 0 else 1] = -side * INF
    height = side * (1 + beyond) - WAITING[1, joint]
    problem = within(position)
    spiked = bumped(trajectory, piece, joint, hump(3, 3) * 64 * height)
    certificate = verify(problem, spiked)
    assert certificate.position.value == pytest.approx(beyond, abs=1e-10)
    assert certificate.position.joint == joint
    assert trajectory.breaks[piece] < certificate.position.time < trajectory.breaks[piece + 1]
    assert certificate.valid == certificate.feasible == (times < 1)
    if times > 1:
        (flaw,) = certificate.flaws
        assert f"joint {joint + 1} at " in flaw
        assert "leaves its position limits" in flaw
        assert certificate.certified_duration is None
    elif times > 0:
        pushed = certified(problem, spiked)
        top = trajectory.breaks[piece] + SHORT / 2
        expected = 1 + 0.9 * beyond
        assert side * spiked(top)[joint] > expected
        assert abs(pushed(top)[joint]) == pytest.approx(1, abs=1e-10)
        assert abs(pushed(top)[joint]) <= 1 + 1e-14


def test_without_position_limits_none_is_judged():
    assert verify(Problem(WAYPOINTS, ROOM), quintic_motion(WAYPOINTS, 4.0)).position is None


def test_positions_between_infinite_limits_are_far_inside():
    problem = within([[-INF, INF], [0.3 - 1e-3, INF], [-INF, INF]], WAYPOINTS)
    worst = verify(problem, quintic_motion(WAYPOINTS, 4.0)).position
    expected = (1, pytest.approx(-1e-3))
    assert (worst.joint, worst.value) == expected


# The smallest displacement of each joint in WAYPOINTS, rad; the second never moves.
MOST = {0: 0.5, 1: 0.7, 2: 0.7}


@pytest.mark.parametrize("size", [1e-6, 1.0, 50.0])
@pytest.mark.parametrize("times", [0.4, -0.4, 2, -2, 1e5])
@pytest.mark.parametrize("row", range(4))
@pytest.mark.parametrize("joint", range(3))
def test_a_missed_waypoint(row, joint, times, size):
    """The tolerance is relative to the largest displacement; a smaller miss is repaired."""
    waypoints = WAYPOINTS * size
    miss = times * 1e-6 * MOST[joint] * size
    moved = waypoints.copy()
    moved[row, joint] += miss
    problem = Problem(waypoints, Limits([900.0] * 3, [900.0] * 3))
    certificate = verify(problem, quintic_motion(moved, 4.0, (0.5,)))
    assert certificate.waypoint.value == pytest.approx(abs(miss), rel=1e-6)
    expected = (joint, row * 4.0)
    assert (certificate.waypoint.joint, certificate.waypoint.time) == expected
    assert certificate.valid == (abs(times) < 1)
    if certificate.valid:
        repaired = certified(problem, quintic_motion(moved, 4.0, (0.5,)))
        misses = repaired(repaired.waypoint_times) - waypoints
        assert np.abs(misses).max() <= 1e-15 * size
    else:
        assert f"joint {joint + 1} at {row * 4} s: misses the waypoint" in certificate.flaws[0]
        # A robot that waits elsewhere jumps too, if it cannot get there in a microsecond.
        if row in (0, 3) and abs(miss) > 1e-6 * 900:
            assert "position jumps" in certificate.flaws[1]


def test_the_price_of_a_missed_waypoint():
    """A quintic that falls short by e is repaired by 3σ² − 2σ³: 1.5 e/T faster."""
    h = 1.0
    e = 0.9e-8
    T = 2.0
    limits = Limits([15 / 8 * h / T], [1e9])
    problem = Problem([[0.0], [h]], limits)
    short = quintic_motion(np.array([[0.0], [h - e]]), T)
    certificate = verify(problem, short)
    # In the middle, where the quintic is fastest, so is the blend.
    peak = 15 / 8 * (h - e) / T + 1.5 * e / T
    expected = peak / (15 / 8 * h / T)
    assert certificate.velocity.value == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("at", [0, 1])
def test_the_price_of_a_jump(at):
    """A velocity jump δ is repaired over ρ by δ ρ (x³ − x²): 4 δ/ρ at its break."""
    delta = 1e-9
    motion = quintic_motion(WAYPOINTS, 4.0, (0.25,))
    length = np.diff(motion.breaks)[at]
    jumping = bumped(motion, at, 0, delta * hump(1, 2) * length)
    repaired = certified(Problem(WAYPOINTS, ROOM), jumping)
    curvature = repaired(motion.breaks[at], 2) - motion(motion.breaks[at], 2)
    # The bump's own curvature is −4 δ/length; its repair dies out over the rest of the segment.
    room = (4.0, 3.0)[at]
    expected = 4 * delta / room - 4 * delta / length
    assert curvature[0] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("late", [1e-9, 1e-3])
def test_a_waypoint_passed_at_another_time(late):
    """At a speed of 1 rad/s, the miss is the lateness."""
    limits = Limits([9.0], [9.0])
    problem = Problem([[0.0], [1.0], [2.0]], limits)
    line = Trajectory([0, 2], [[[1.0]], [[0.0]]], [0, 1 + late, 2])
    assert verify(problem, line).waypoint.value == pytest.approx(late, rel=1e-6)
    missed = [flaw for flaw in verify(problem, line).flaws if "misses" in flaw]
    assert len(missed) == (late > 1e-6)
    assert "velocity jumps" in verify(problem, line).flaws[-1]  # it never rests


def test_waypoints_in_the_wrong_order_are_missed():
    motion = quintic_motion(WAYPOINTS[[0, 2, 1, 3]], 4.0)
    assert not verify(Problem(WAYPOINTS, ROOM), motion).valid


def test_what_passes_elsewhere_is_not_nearly_feasible():
    """It keeps every limit without dilation, but it is no motion of this problem."""
    certificate = verify(Problem(WAYPOINTS, ROOM), quintic_motion(WAYPOINTS[[0, 2, 1, 3]], 4.0))
    assert certificate.dilation < 1
    assert not certificate.nearly_feasible
    assert not certificate.feasible


@pytest.mark.parametrize("duration", [0.5, 1e6])
def test_rounding_of_times_and_coordinates_is_allowed(duration):
    """A break is off by 16 units in its last place: a derivative by that times the next limit."""
    far = Problem([[1e3], [1e3 + 1]], Limits([2.0], [3.0], jerk=[5.0]))
    none = Tolerance(0.0, 0.0, 0.0, 0.0, 0.0)
    allowed = verification._allowed(far, duration, none)
    late = 16 * np.finfo(float).eps * duration
    position, velocity, acceleration = np.concatenate(allowed.jumps)
    assert velocity == pytest.approx(late * 3)
    assert acceleration == pytest.approx(late * 5)
    assert position == pytest.approx(late * 2 + far.rounding[0])
    assert allowed.waypoint == allowed.position_limit == far.rounding
    assert allowed.blur == 4 * far.rounding


CUTS = (0.25, 0.5, 0.75)  # unit pieces of a segment of 4 s
PLACES = {"start": 0, "a waypoint": 4, "between waypoints": 6, "the last piece": 11}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("times", [0.5, 2.0, 1e5])
@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("A", [1e3, 0.1])
def test_a_velocity_jump(place, times, joint, sign, A):
    """`ε s (1 − s)²` starts at slope ε and ends at rest.

    Tolerance: a millionth of what the joint can reach, min(V, sqrt(A h)), or what the acceleration
    limit bridges in a microsecond.
    """
    limits = Limits([9, [-4, 9], [-1e6, 1e6]], [A] * 3)
    reached = min([9, 4, 1e6][joint], (A * MOST[joint]) ** 0.5)
    jump = sign * times * 1e-6 * max(reached, A)
    piece = PLACES[place]
    motion = bumped(quintic_motion(WAYPOINTS, 4.0, CUTS), piece, joint, jump * hump(1, 2))
    certificate = verify(Problem(WAYPOINTS, limits), motion)
    assert certificate.valid == (times < 1)
    worst = certificate.continuity
    assert (worst.joint, worst.time, worst.order) == (joint, piece, 1)
    assert worst.value == pytest.approx(abs(jump), rel=1e-6)
    if times > 1:
        (flaw,) = certificate.flaws
        assert flaw.startswith(f"joint {joint + 1} at {piece} s: velocity jumps by")
        assert certificate.certified_duration is None
        assert not certificate.feasible


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_not_resting_at_the_end(times):
    motion = quintic_motion(WAYPOINTS, 4.0, CUTS)
    allowed = 1e-6 * 9  # the acceleration limit, for a microsecond
    bump = times * allowed * hump(2, 1)
    certificate = verify(Problem(WAYPOINTS, ROOM), bumped(motion, 11, 2, bump))
    assert certificate.valid == (times < 1)
    worst = certificate.continuity
    assert (worst.joint, worst.time, worst.order) == (2, 12.0, 1)


@pytest.mark.parametrize("limited", [(0, 1, 2), (1,), ()])
@pytest.mark.parametrize("times", [0.5, 2.0, 1e5])
@pytest.mark.parametrize("place", [*PLACES, "end"])
@pytest.mark.parametrize("joint", [0, 1])
def test_an_acceleration_jump_counts_where_jerk_is_limited(place, joint, times, limited):
    """`ε s² (1 − s)³ / 2` starts at acceleration ε; mirrored, it ends there.

    Tolerance: what the jerk limit bridges in a microsecond.
    """
    limits = jerk_limited(limited) if limited else ROOM
    size = times * 9e-2
    bump = hump(3, 2) if place == "end" else hump(2, 3)
    piece, time = (11, 12) if place == "end" else (PLACES[place], PLACES[place])
    motion = bumped(quintic_motion(WAYPOINTS, 4.0, CUTS), piece, joint, size / 2 * bump)
    certificate = verify(Problem(WAYPOINTS, limits), motion)
    counts = joint in limited
    assert certificate.valid == (times < 1 or not counts)
    if counts:
        worst = certificate.continuity
        assert (worst.joint, worst.time, worst.order) == (joint, time, 2)
        assert worst.value == pytest.approx(size, rel=1e-6)
    if not certificate.valid:
        (flaw,) = certificate.flaws
        assert flaw.startswith(f"joint {joint + 1} at {time} s: acceleration jumps by")


def test_one_sided_jerk_limits_forbid_acceleration_jumps_too():
    limits = Limits([9.0] * 3, [9.0] * 3, [[-INF, 9e4], [-INF, INF], [-INF, INF]])
    motion = quintic_motion(WAYPOINTS, 4.0, CUTS)
    problem = Problem(WAYPOINTS, limits)
    assert verify(problem, motion).valid
    assert not verify(problem, bumped(motion, 5, 0, 0.1 * hump(2, 3))).valid
    assert verify(problem, bumped(motion, 5, 1, 0.1 * hump(2, 3))).valid


@pytest.mark.parametrize("times", [0.4, 2.0, 1e4])
@pytest.mark.parametrize("size", [1.0, 50.0])
@pytest.mark.parametrize("joint", range(3))
def test_a_position_jump_between_waypoints(times, joint, size):
    waypoints = WAYPOINTS * size
    V = 9.0
    jump = times * 1e-6 * V * size  # more than a millionth of the largest displacement
    motion = bumped(quintic_motion(waypoints, 4.0, CUTS), 6, joint, [jump])
    limits = Limits([V * size] * 3, [900.0] * 3)
    certificate = verify(Problem(waypoints, limits), motion)
    assert certificate.valid == (times < 1)
    worst = certificate.continuity
    assert (worst.joint, worst.order) == (joint, 0)
    assert worst.time in (6.0, 7.0)
    assert worst.value == pytest.approx(jump, rel=1e-6)


def test_every_flaw_is_told_at_once():
    motion = quintic_motion(WAYPOINTS, 4.0, CUTS)
    for bump, piece, joint in [
        (hump(1, 2), 2, 0),
        (hump(2, 3) * 50, 5, 1),
        ([1e-3], 9, 2),
        (hump(3, 3) * 640, 6, 1),
    ]:
        motion = bumped(motion, piece, joint, bump)
    limits = Limits([9.0] * 3, [9.0] * 3, [9e4] * 3, [[-9, 9], [-9, 9], [-9, 9]])
    moved = WAYPOINTS + np.array([[0, 0, 0], [0, 1e-3, 0], [0, 0, 0], [0, 0, 0]])
    certificate = verify(Problem(moved, limits), motion)
    flaws = " | ".join(certificate.flaws)
    for words in (
        "joint 2 at 6.5 s: leaves its position limits by 1.3 rad",
        "joint 2 at 4 s: misses the waypoint by 0.001 rad",
        "joint 3 at 9 s: position jumps by 0.001 rad",
        "joint 1 at 2 s: velocity jumps by 1 rad/s",
        "joint 2 at 5 s: acceleration jumps by 100 rad/s²",
    ):
        assert words in flaws


@pytest.mark.parametrize("T", [0.25, 1.0, 4.0])
def test_the_quintics_peaks_are_known(T):
    """15/8 h/T in the middle, 10/√3 h/T² beside it, 60 h/T³ at the ends."""
    limits = Limits([1.0, 1.5], [2.0, 3.0], [5.0, 6.0])
    problem = Problem([[0.0, 0.0], [1.0, -2.0]], limits)
    certificate = verify(problem, quintic_motion(problem.waypoints, T))
    expected = 2 * 15 / 8 / T / 1.5
    assert certificate.velocity.value == pytest.approx(expected, rel=1e-12)
    assert certificate.velocity.time == pytest.approx(T / 2)
    expected = 2 * 10 / 3**0.5 / T**2 / 3
    assert certificate.acceleration.value == pytest.approx(expected, rel=1e-12)
    beside = [T * (0.5 - 12**-0.5), T * (0.5 + 12**-0.5)]
    found = min(abs(certificate.acceleration.time - t) for t in beside)
    assert found < 1e-6 * T
    # The first and the last instant: one of them is no less than the other.
    expected = 2 * 60 / T**3 / 6
    assert certificate.jerk.value == pytest.approx(expected, rel=1e-12)
    found = min(certificate.jerk.time, T - certificate.jerk.time)
    assert found < 1e-6 * T
    worst = max(2.5 / T, (20 / 3**1.5) ** 0.5 / T, 20 ** (1 / 3) / T)
    assert certificate.dilation == pytest.approx(worst, rel=1e-12)
    assert certificate.feasible == (worst <= 1)
    expected = max(1, worst) * T
    assert certificate.certified_duration == pytest.approx(expected, rel=1e-12)


def random_pieces(seed: int, degree: int, joints: int):
    """Any piecewise polynomial at all: jumping, off its waypoints, pieces from 1e-4 to 10 s."""
    rng = np.random.default_rng(seed)
    pieces = int(rng.integers(1, 9))
    lengths = 10.0 ** rng.uniform(-4, 1, pieces)
    steps = np.arange(degree, -1, -1)
    powers = steps[:, None]
    coefficients = rng.normal(size=(degree + 1, pieces, joints))
    coefficients *= (rng.random(coefficients.shape) > 0.2) * (lengths**-powers)[..., None]
    breaks = np.r_[0.0, np.cumsum(lengths)]
    trajectory = Trajectory(breaks, coefficients, breaks[[0, -1]])

    def pairs(low=0.3, high=3.0):
        drawn = rng.uniform(low, high, joints)
        return np.stack([-rng.uniform(low, high, joints), drawn], axis=1)

    limits = Limits(pairs(), pairs(), pairs(), pairs(20, 30))
    return Problem(np.vstack([np.zeros(joints), np.ones(joints)]), limits), trajectory


def worst_by_numpy(trajectory: Trajectory, order: int, measure) -> tuple[float, int]:
    """The worst of a measure of a derivative, and its joint, from `numpy.roots` piece by piece."""
    lengths = np.diff(trajectory.breaks)
    worst = []
    for joint in range(trajectory.joints):
        for piece, length in enumerate(lengths):
            polynomial = np.poly1d(trajectory.coefficients[:, piece, joint])
            p = np.polyder(polynomial, order)
            steps = np.arange(p.order, -1.0, -1.0)
            unit = np.poly1d(p.coeffs * length**steps)
            points = np.clip(np.r_[np.roots(unit.deriv().coeffs).real, 0, 1], 0, 1)
            worst += [(measure(value, joint), joint) for value in unit(points)]
    return max(worst)


@reproducible
@given(seeds, st.integers(1, 8), st.integers(1, 7))
def test_peaks_are_those_that_numpys_roots_give(seed, degree, joints):
    problem, trajectory = random_pieces(seed, degree, joints)
    certificate = verify(problem, trajectory)
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        pairs = getattr(problem.limits, name)
        found = getattr(certificate, name)
        value, joint = worst_by_numpy(
            trajectory, order, lambda x, j, pairs=pairs: max(x / pairs[j, 0], x / pairs[j, 1])
        )
        assert found.value == pytest.approx(value, rel=1e-9)
        assert found.joint == joint or value == 0
    pairs = problem.limits.position
    value, joint = worst_by_numpy(trajectory, 0, lambda x, j: max(x - pairs[j, 1], pairs[j, 0] - x))
    assert certificate.position.value == pytest.approx(value, rel=1e-9, abs=1e-9)
    assert certificate.position.joint == joint


@reproducible
@given(seeds, st.integers(2, 8), st.integers(1, 4))
def test_the_worst_is_where_it_is_said_to_be(seed, degree, joints):
    problem, trajectory = random_pieces(seed, degree, joints)
    certificate = verify(problem, trajectory)
    found = certificate.velocity
    low, high = problem.limits.velocity[found.joint]
    values = []
    for piece in range(len(trajectory.breaks) - 1):
        start, stop = trajectory.breaks[piece : piece + 2]
        if start <= found.time <= stop:
            own = np.polyder(trajectory.coefficients[:, piece, found.joint])
            values += [np.polyval(own, found.time - start)]
    worst = max(max(value / high, value / low) for value in values)
    assert worst == pytest.approx(found.value, rel=1e-6)


@reproducible
@given(seeds, st.floats(1e-3, 1e3))
def test_dilating_by_k_divides_the_dilation_by_k(seed, factor):
    problem, trajectory = random_pieces(seed, 5, 3)
    before = verify(problem, trajectory)
    after = verify(problem, trajectory.dilated(factor))
    assert after.duration == pytest.approx(before.duration * factor, rel=1e-12)
    assert after.dilation == pytest.approx(before.dilation / factor, rel=1e-9)
    expected = before.velocity.value / factor
    assert after.velocity.value == pytest.approx(expected, rel=1e-9)
    expected = before.acceleration.value / factor**2
    assert after.acceleration.value == pytest.approx(expected)
    expected = before.jerk.value / factor**3
    assert after.jerk.value == pytest.approx(expected)


@reproducible
@given(seeds, st.floats(1e-2, 1e2))
def test_faster_limits_and_a_faster_motion_are_the_same_thing(seed, c):
    problem, trajectory = random_pieces(seed, 5, 3)
    old = problem.limits
    limits = Limits(old.velocity * c, old.acceleration * c**2, old.jerk * c**3, old.position)
    before = verify(problem, trajectory)
    after = verify(Problem(problem.waypoints, limits), trajectory.dilated(1 / c))
    assert after.dilation == pytest.approx(before.dilation, rel=1e-9)
    assert after.position.value == pytest.approx(before.position.value, rel=1e-9)
    assert after.velocity.joint == before.velocity.joint
    assert after.duration == pytest.approx(before.duration / c, rel=1e-12)


@reproducible
@given(seeds)
def test_the_certified_trajectory_is_feasible(seed):
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 6))
    waypoints = rng.uniform(-2, 2, (4, joints))
    limits = Limits(*(10.0 ** rng.uniform(-1, 1, joints) for _ in range(3)))
    problem = Problem(waypoints, limits)
    drawn = rng.uniform(-1, 1, 3)
    trajectory = spline353.trajectory(problem, 10.0**drawn)
    first = verify(problem, trajectory)
    assert first.valid
    again = verify(problem, trajectory.dilated(max(1.0, first.dilation)))
    assert again.feasible
    assert again.duration == pytest.approx(first.certified_duration, rel=1e-12)
    if first.dilation > 1:
        assert again.dilation == pytest.approx(1.0, rel=1e-8)
        slightly_faster = trajectory.dilated(first.dilation * (1 - 1e-5))
        assert not verify(problem, slightly_faster).feasible


@reproducible
@given(seeds)
def test_permuting_joints_changes_only_their_numbers(seed):
    problem, trajectory = random_pieces(seed, 4, 5)
    order = np.random.default_rng(seed).permutation(5)
    old = problem.limits
    limits = Limits(
        old.velocity[order], old.acceleration[order], old.jerk[order], old.position[order]
    )
    permuted = Problem(problem.waypoints[:, order], limits)
    moved = Trajectory(
        trajectory.breaks, trajectory.coefficients[..., order], trajectory.waypoint_times
    )
    before = verify(problem, trajectory)
    after = verify(permuted, moved)
    for kind in ("velocity", "acceleration", "jerk", "position", "waypoint"):
        one = getattr(before, kind)
        other = getattr(after, kind)
        assert other.value == one.value
        assert order[other.joint] == one.joint
    assert after.dilation == before.dilation


@pytest.mark.parametrize("pieces", [1, 257, 1000])
def test_the_worst_of_many_that_tie_is_still_the_worst(pieces):
    """All pieces have one bound, and only one of them is worse than all others."""
    rng = np.random.default_rng(0)
    degree = 5
    drawn = rng.normal(size=(degree + 1, 1, 1))
    coefficients = np.repeat(drawn, pieces, axis=1)
    coefficients = np.repeat(coefficients, 2, axis=2)
    special = pieces * 2 // 3
    coefficients[:, special, 1] *= 1 + 1e-9
    steps = np.arange(pieces + 1.0)
    trajectory = Trajectory(steps, coefficients, [0, pieces])
    limits = Limits([1.0] * 2, [1.0] * 2)
    certificate = verify(Problem([[0, 0], [1, 1]], limits), trajectory)
    for order, worst in enumerate((certificate.velocity, certificate.acceleration), start=1):
        greatest = np.abs(extremes(coefficients[:, special, 1], order)).max()
        assert worst.value == pytest.approx(greatest, rel=1e-12)
        assert worst.joint == 1
        assert special <= worst.time <= special + 1


def test_a_trajectory_that_stands_still_has_no_use_and_misses():
    zeros = np.zeros((1, 1, 3))
    times = np.linspace(0, 1, 4)
    still = Trajectory([0, 1], zeros + WAYPOINTS[0], times)
    certificate = verify(Problem(WAYPOINTS, ROOM), still)
    assert certificate.dilation == 0
    assert not certificate.valid
    assert certificate.waypoint.value == pytest.approx(0.9)


@pytest.mark.parametrize("joints", [1, 2, 4])
def test_another_number_of_joints(joints):
    zeros = np.zeros((2, 1, joints))
    times = np.linspace(0, 1, 4)
    wrong = Trajectory([0, 1], zeros, times)
    with pytest.raises(InvalidTrajectory, match=f"{joints} joints; the problem has 3"):
        verify(Problem(WAYPOINTS, ROOM), wrong)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_another_number_of_waypoints(count):
    zeros = np.zeros((2, 1, 3))
    times = np.linspace(0, 1, count)
    wrong = Trajectory([0, 1], zeros, times)
    with pytest.raises(InvalidTrajectory, match=f"{count} waypoint times; the problem has 4"):
        verify(Problem(WAYPOINTS, ROOM), wrong)


def test_tolerances_can_be_chosen():
    problem = Problem(WAYPOINTS, ROOM)
    moved = WAYPOINTS.copy()
    moved[1, 2] += 1e-5
    motion = quintic_motion(moved, 4.0)
    assert not verify(problem, motion).valid
    loose = Tolerance(position=1e-4)
    assert verify(problem, motion, loose).valid
    assert verify(problem, motion, loose).tolerance == loose
    jumping = bumped(quintic_motion(WAYPOINTS, 4.0), 1, 0, 1e-3 * hump(1, 2))
    assert not verify(problem, jumping).valid
    assert verify(problem, jumping, Tolerance(jump=1e-3)).valid
    fast = quintic_motion(WAYPOINTS, 0.7 * 15 / 8 / 9 / 1.001)  # 1.001 times the limit
    problem = Problem(WAYPOINTS, Limits([9.0] * 3, [1e6] * 3))
    assert verify(problem, fast, Tolerance(limit=1.0001e-3)).feasible
    assert not verify(problem, fast, Tolerance(limit=0.9999e-3)).feasible


def test_what_goes_into_json():
    limits = Limits([1.0] * 3, [1.0] * 3, [1.0] * 3, [[-5, 5]] * 3)
    motion = quintic_motion(WAYPOINTS, 4.0)
    certificate = verify(Problem(WAYPOINTS, limits), motion)
    table = certificate.as_dict()
    assert list(table) == [
        *("feasible", "dilation", "velocity", "acceleration", "jerk"),
        *("position", "waypoint", "continuity"),
    ]
    assert table["velocity"]["joint"] == 3  # from 1: the third moves most, 0.7 rad at first
    expected = 0.7 * 15 / 8 / 4
    assert table["velocity"]["ratio"] == pytest.approx(expected)
    assert table["position"]["error"] == pytest.approx(0.9 - 5)
    assert "order" in table["continuity"]
    bare = verify(Problem(WAYPOINTS, ROOM), motion).as_dict()
    assert bare["jerk"] is None
    assert bare["position"] is None


@pytest.mark.parametrize("seed", [112, 165])
@pytest.mark.parametrize("dilation", [1.0, 1 + 1e-7])
def test_a_certified_motion_is_certified_when_judged_again(seed: int, dilation: float) -> None:
    """A segment of 1.6e-6 s: dilated by 1e-10, its rounded times once cost 0.6 %."""
    problem = one_way(seed)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    faster = trajectory.dilated(1 / dilation)
    first = verify(problem, faster).certified_duration
    motion = certified(problem, faster)
    assert motion is not None
    assert motion.duration == pytest.approx(first, rel=1e-15)
    assert verify(problem, motion).certified_duration == pytest.approx(first, rel=1e-11)


def test_jumps_late_in_a_long_motion_are_repaired_in_exact_time() -> None:
    """A segment takes 2e-12 s after 1000 s: its breaks are known to a tenth of it.

    The velocity jumps there. The repaired motion must not, and must still pass the waypoints.
    """
    brief = 1.05e-12
    speed = 1e-3
    jump = 1e-7 * speed
    lengths = np.array([1000.0, brief, brief, 1000.0])
    velocity = np.array([speed, speed + jump, speed, speed])
    passed = np.append(0.0, np.cumsum(speed * lengths))
    breaks = np.append(0.0, np.cumsum(lengths))
    columns = np.array([velocity, passed[:-1]])
    trajectory = Trajectory(breaks, columns[..., None], breaks[[0, 1, 3, 4]], lengths)
    problem = Problem(passed[[0, 1, 3, 4], None], Limits([1.0], [1.0]))
    repaired = repair.repaired(problem, trajectory)
    assert repaired is not None
    unit = repaired.pieces(1)[..., 0]
    ends = unit.sum(axis=0)
    np.testing.assert_allclose(ends[:-1], unit[-1, 1:], atol=1e-11 * jump)
    np.testing.assert_allclose([ends[0], ends[2]], speed, rtol=1e-2)


def test_cancelling_terms_hide_no_jump() -> None:
    """Terms that cancel may round a velocity by more than it jumps: it is repaired all the same.

    Chebyshev's polynomial of degree 13 on [0, 1] has values up to 1, coefficients up to 1e9, and
    the same slope at both ends.
    """
    steps = 20
    step = 1e-7
    basis = np.polynomial.Chebyshev.basis(13, [0.0, 1.0])
    shape = basis.convert(kind=np.polynomial.Polynomial).coef[::-1]
    columns = np.repeat(1e-3 * shape[:, None, None], steps, axis=1)
    columns[-2, :, 0] += 1.0 + step * np.arange(steps)
    breaks = np.arange(steps + 1.0)
    motion = Trajectory(breaks, columns, breaks[[0, -1]])
    assert polynomials.evaluation_rounding(motion.pieces(1)).min() > step
    problem = Problem([[0.0], [1.0]], Limits([9.0], [9.0]))
    asked = repair._Asked.of(problem)
    layout = repair._layout(asked, motion, np.array([True, True]))
    assert layout is not None
    jumps = repair._jumps(asked, layout, 1, np.array([0]))
    np.testing.assert_allclose(jumps[1:-1], step, rtol=0.5)
