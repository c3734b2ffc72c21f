"""A motion within the digits, and the proof that there is none: against closed forms and HiGHS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import linprog

from trajopt.core.limits import Limits
from trajopt.core.limits.peaks import peak, ratio
from trajopt.core.trajectory import Trajectory
from trajopt.judging.check_proof import NoProof
from trajopt.judging.evidence import evidence, passing
from trajopt.judging.log_joint import Log
from trajopt.judging.tube import slope, tube
from trajopt.judging.tube_proof import proved

FREE = (-np.inf, np.inf)
LIMITS = [(-2.0, 2.0), (-10.0, 10.0), (-100.0, 100.0)]


def quintic(h, count=501):
    """A rest-to-rest quintic of 1 s: 1.875 h of velocity, 10/√3 h of acceleration, 60 h of jerk."""
    t = np.linspace(0, 1, count)
    return t, h * (10 * t**3 - 15 * t**4 + 6 * t**5)


def rounded(q, decimals):
    return np.round(q, decimals), np.full(len(q), 0.5 * 10.0**-decimals)


@pytest.mark.parametrize("decimals", [3, 4, 5, 6])
@pytest.mark.parametrize("kinds", [2, 3])
def test_both_numbers_enclose_the_least_use_and_not_the_digits_noise(decimals, kinds):
    t, q = quintic(0.6)
    uses = [1.875 * 0.6 / 2, 10 / np.sqrt(3) * 0.6 / 10, 60 * 0.6 / 100][:kinds]
    found = tube(t, *rounded(q, decimals), LIMITS[:kinds])
    assert found.low <= max(uses) * (1 + 1e-9)  # that motion is within the tube
    assert found.low <= found.high * (1 + 1e-9)
    assert found.high <= 1  # the raw spline: up to 150 times the acceleration limit


@pytest.mark.parametrize("decimals", [3, 5])
def test_a_broken_limit_is_proved_in_rational_numbers(decimals):
    t, q = quintic(0.6)
    own = [(0.3 * low, 0.3 * high) for low, high in LIMITS]
    found = tube(t, *rounded(q, decimals), own)
    least = float(proved(found.proof))
    assert 1 < least <= 1.875 * 0.6 / 0.6
    assert least == pytest.approx(found.low, abs=1e-9)


@pytest.mark.parametrize(
    ("part", "forged"),
    [
        ("half", lambda own: -own),  # known to less than nothing
        ("times", lambda own: own[::-1]),
        ("times", lambda own: np.where(own == own[-1], own[-2], own)),
        ("limits", lambda own: [(low + 10, high + 10) for low, high in own]),  # none below 0
        ("limits", lambda own: own[:2]),
        ("derivatives", lambda own: [(x - 1, mu) for x, mu in own]),  # before the first sample
        ("derivatives", lambda own: own + own[-1:]),
    ],
)
def test_numbers_of_no_tube_prove_nothing(part, forged):
    t, q = quintic(0.6)
    own = [(0.3 * low, 0.3 * high) for low, high in LIMITS]
    proof = tube(t, *rounded(q, 3), own).proof
    points = [(t[:1] if not len(x) else x, np.ones(max(1, len(x)))) for x, _ in proof.derivatives]
    proof = replace(proof, derivatives=points, velocity=None)
    with pytest.raises(NoProof):
        proved(replace(proof, **{part: forged(getattr(proof, part))}))


def test_the_least_acceleration_through_a_tube_is_that_of_the_bang_bang_motion():
    """Through 0 and 1 at rest in 1 s: at least 4 rad/s², from the closed form."""
    t, _ = quintic(1.0)
    q = np.where(t < 0.5, 2 * t**2, 1 - 2 * (1 - t) ** 2)
    found = tube(t, q, np.full(len(t), 1e-6), [FREE, (-4.0, 4.0)])
    assert found.low == pytest.approx(1, abs=1e-3)
    assert found.high == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_the_program_has_the_optimum_that_highs_finds(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.8, 1.2, 25)) * 0.02
    q = np.cumsum(rng.normal(0, 1e-3, 25))
    half = np.full(25, 1e-4)
    found = tube(t, q, half, LIMITS, rounds=1)
    knots = found.knots
    size = len(knots) - 4
    passing = BSpline.design_matrix(t, knots, 3).toarray()
    rows, right = [], []
    for sign in (1, -1):
        rows.append(np.hstack([sign * passing, np.zeros((25, 1))]))
        right.append(half + sign * q)
    for order, (_, high) in enumerate(LIMITS, start=1):
        level = np.array(
            [BSpline(knots, row, 3).derivative(order).c[: size - order] for row in np.eye(size)]
        ).T
        for sign in (1, -1):
            rows.append(np.hstack([sign * level, -high * np.ones((len(level), 1))]))
            right.append(np.zeros(len(level)))
    best = linprog(
        np.append(np.zeros(size), 1),
        A_ub=np.vstack(rows),
        b_ub=np.concatenate(right),
        bounds=(None, None),
    )
    assert found.high == pytest.approx(best.fun, rel=1e-5)


@pytest.mark.parametrize("seed", range(10))
def test_no_numbers_prove_more_than_a_motion_uses(seed):
    """The proof trusts nobody: with forged multipliers it stays below a motion's true use."""
    rng = np.random.default_rng(seed)
    t, q = quintic(0.7, 60)
    true = max(1.875 * 0.7 / 2, 10 / np.sqrt(3) * 0.7 / 10, 60 * 0.7 / 100)
    proof = tube(t, *rounded(q, 4), LIMITS).proof
    noise = rng.normal(0, 10.0 ** rng.uniform(-6, 1), len(proof.multipliers))
    forged = replace(
        proof,
        multipliers=proof.multipliers * (1 + noise) * 10.0 ** rng.uniform(-3, 3),
        derivatives=[(x, rng.normal(0, 1, len(x)) * np.abs(mu)) for x, mu in proof.derivatives],
    )
    assert proved(forged) <= true
    assert proved(replace(proof, limits=[FREE, *LIMITS[1:]])) <= true


@pytest.mark.parametrize("limit", [(-1.0, 2.0), (-2.0, 1.0), (-3.0, 3.0)])
def test_the_least_velocity_is_that_of_the_steepest_pair_of_samples(limit):
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.5, 1.5, 40))
    q = np.cumsum(rng.normal(0, 1, 40))
    half = rng.uniform(0, 0.5, 40)
    low, high = limit
    best = 0.0
    for i in range(40):
        for j in range(i + 1, 40):
            rise = (q[j] - q[i] - half[i] - half[j]) / (t[j] - t[i])
            fall = (q[i] - q[j] - half[i] - half[j]) / (t[j] - t[i])
            best = max(best, rise / high, fall / -low)
    share, start, end = slope(t, q, half, limit)
    assert share == pytest.approx(best)
    assert start < end


# --- several joints: the verdict ---


def log(columns, decimals, dt=0.002, **more):
    """A log of commands: its digits are all that is unknown."""
    q = np.stack([np.round(column, decimals) for column in columns], axis=1)
    half = np.full(q.shape, 0.5 * 10.0**-decimals)
    known = {"decimals": [decimals] * len(columns), "commanded": True, **more}
    return Log(dt * np.arange(len(q)), q, half, **known)


def test_a_lawful_log_is_kept_and_its_motion_stays_within_the_digits():
    _, q = quintic(0.6)
    own = log([q, -q / 2], 4)
    found = evidence(own, Limits([2, 2], [10, 10], [100, 100]))
    assert found.verdict == "kept"
    assert found.at_rest
    assert np.abs(found.motion(own.times) - own.positions).max() <= 5e-5 * (1 + 1e-6)
    for name, used in {"velocity": 0.5625, "acceleration": 0.34641, "jerk": 0.36}.items():
        assert found.limits[name].at_least <= used * (1 + 1e-9)
        assert found.limits[name].at_least <= found.limits[name].uses
    assert found.limits["acceleration"].spline > 5  # what the digits look like
    whole, half = found.limits["velocity"].by_joint
    assert (whole, half) == pytest.approx((0.5625, 0.28125), rel=1e-2)


def test_a_log_that_is_cut_is_judged_all_the_same():
    _, q = quintic(0.6)
    found = evidence(log([q[120:400]], 4), Limits([2], [10]))
    assert (found.verdict, found.at_rest) == ("kept", False)


@pytest.mark.parametrize("limit", [0.5, 0.9])
def test_a_broken_log_is_convicted_with_joint_limit_and_time(limit):
    _, q = quintic(0.6)
    found = evidence(log([q / 3, q], 4), Limits([2, 2 * 0.5625 * limit], [10, 10]))
    assert found.verdict == "broken"
    assert (found.conviction.joint, found.conviction.limit) == (1, "velocity")
    assert 1 / limit * 0.99 < found.conviction.at_least <= 1 / limit
    assert found.conviction.start <= 0.5 <= found.conviction.end
    assert found.as_dict()["conviction"]["joint"] == 2


def test_digits_that_tell_nothing_say_so():
    _, q = quintic(0.6)
    found = evidence(log([q], 1), Limits([2], [10], [100]))
    assert found.verdict == "cannot be told"
    assert found.limits["jerk"].window > 0.1
    short = evidence(log([q], 4), Limits([2], [10], [100]), window=0.03)
    assert short.verdict == "cannot be told"
    assert 0.03 < short.limits["jerk"].window < 0.1


def test_rounded_times_convict_no_innocent_log():
    """A bang-bang motion at exactly its limits, 1/60 s apart, stamps with three decimals."""
    t = np.arange(61) / 60
    q = np.where(t < 0.5, 2 * t**2, 1 - 2 * (1 - t) ** 2)
    stamped = Log(
        np.round(t, 3), np.round(q, 5)[:, None], np.full((61, 1), 5e-6), 5e-4, [5], commanded=True
    )
    limits = Limits([2], [4])
    assert evidence(replace(stamped, time_half_digit=0.0), limits).verdict == "broken"
    assert evidence(stamped, limits).verdict != "broken"
    assert evidence(stamped, Limits([1.6], [4])).verdict == "broken"


@pytest.mark.parametrize("seed", range(3))
def test_noise_convicts_no_innocent_log(seed):
    _, q = quintic(0.6)
    noisy = q + np.random.default_rng(seed).normal(0, 1e-4, len(q))
    sent = log([noisy], 6)
    own = replace(sent, commanded=False)
    lawful, broken = Limits([2], [10]), Limits([0.9], [10])
    assert evidence(sent, lawful).verdict == "broken"  # it was sent with that noise
    for noise in (None, 1e-4):
        assert evidence(own, lawful, noise=noise).verdict == "kept"
        assert evidence(own, broken, noise=noise).verdict == "broken"
    assert evidence(own, lawful, noise=0.0).verdict == "broken"  # as was stated
    (known,) = evidence(own, lawful).joints
    assert 1e-4 < known.known.noise < 1.3e-4
    assert known.known.seen


def test_a_position_beyond_its_limit_is_a_proof():
    _, q = quintic(0.6)
    found = evidence(log([q], 4), Limits([2], [10], position=[[-1, 0.59]]))
    assert found.conviction.limit == "position"
    assert found.conviction.at_least == pytest.approx(0.01, abs=1e-4)
    assert evidence(log([q], 4), Limits([2], [10], position=[[-1, 0.6]])).verdict == "kept"


def test_the_motion_passes_the_waypoints():
    t, q = quintic(0.6)
    times = np.array([0, t[170] + 3e-4, 1])
    s = times
    waypoints = (0.6 * (10 * s**3 - 15 * s**4 + 6 * s**5))[:, None]
    limits = Limits([2], [10], [100])
    found = passing(evidence(log([q], 4), limits), times, waypoints)
    assert found.verdict == "kept"
    assert np.abs(found.motion(times) - waypoints).max() < 1e-6


@pytest.mark.parametrize("samples", [4, 8, 16, 40])
def test_a_pulse_that_is_longer_than_the_window_shows(samples):
    """Twice the acceleration limit, for some samples: the window is longer, or it is convicted."""
    _, q = quintic(0.5)
    t, limit, length = 0.002 * np.arange(len(q)), 4.0, 0.002 * samples
    since = np.clip(t - 0.1, 0, 2 * length)
    pulse = 2 * limit * np.where(since < length, since**2 / 2, length * (since - length / 2))
    pulse -= limit * np.clip(since - length, 0, None) ** 2
    found = evidence(log([q + pulse], 4), Limits([2], [limit]))
    assert found.verdict == "broken" or found.limits["acceleration"].window > length
    assert found.verdict != "kept" or samples < 10


@pytest.mark.parametrize("length", [1e-13, 1e-6, 1e6])
@pytest.mark.parametrize("size", [1e-15, 1.0, 1e9])
@pytest.mark.parametrize("limit", [1e-6, 1.0, 1e12])
def test_samples_of_any_size_get_an_answer(length, size, limit):
    t = np.linspace(0, length, 24)
    q = size * np.array([0, 1, 0, 1] * 6)[:, None]
    found = evidence(Log(t, q, np.full(q.shape, 1e-3 * size)), Limits([limit], [limit], [limit]))
    if found.verdict == "broken":
        assert found.conviction.at_least > 1
        assert found.conviction.at_least <= 2 * size / (t[1] * limit) * 1e30


# --- velocities, position limits between samples, velocities that positions bound ---


def test_what_only_the_velocities_show_is_proved_and_said_to_be_theirs():
    """At 100 Hz and three decimals: 1.3 times the acceleration limit for 40 ms."""
    t = np.arange(0, 1.0001, 0.01)
    a = np.where((t >= 0.48) & (t < 0.52), 13.0, np.where(t < 0.6, 2.0, -2.0))
    v = np.concatenate([[0.0], np.cumsum(a[:-1]) * 0.01])
    q = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2) * 0.01])
    own = log([q], 3, 0.01, velocities=np.round(v, 3)[:, None])
    own = replace(own, velocity_half_digits=np.full((len(t), 1), 5e-4))
    limits = Limits([4], [10])
    found = evidence(own, limits)
    assert (found.verdict, found.by_positions) == ("broken", "cannot be told")
    assert found.conviction.limit == "acceleration"
    assert 1.2 < found.conviction.at_least <= 1.3
    assert found.as_dict()["by_positions"] == "cannot be told"
    lawful = evidence(own, Limits([4], [13.001]))
    assert (lawful.verdict, lawful.by_positions) == ("kept", None)
    noise = np.random.default_rng(1).normal(0, 1, t.shape)
    wrong = replace(own, velocities=own.velocities + 0.1 * noise[:, None])
    assert evidence(wrong, limits).verdict == "cannot be told"  # they are known to less


def test_position_limits_hold_between_samples_too():
    """A parabola turns at 1 rad between samples: beyond 0.9999, within the digits not."""
    t = np.arange(0, 1, 0.02)
    q = 1 - 4 * (t - 0.51) ** 2
    limits = Limits([20], [10], position=[[-5, 0.9999]])
    coarse = evidence(log([q], 3, 0.02), limits)
    assert coarse.verdict == "kept"
    assert coarse.motion(np.linspace(0, 0.98, 20001)).max() <= 0.9999
    t = np.arange(0, 1, 0.01)
    q = 1 - 4 * (t - 0.505) ** 2
    fine = evidence(log([q], 6, 0.01), limits)
    assert fine.verdict == "broken"  # samples are inside, and no lawful motion turns so early
    assert fine.conviction.limit is None


@pytest.mark.parametrize("decimals", [3, 5])
@pytest.mark.parametrize("share", [0.8, 1.2])
def test_a_velocity_that_falls_with_the_position_is_told(share, decimals):
    """At 1 rad/s up to where √(2·6·(2.5 − q)) − 0.3 allows that divided by the share."""
    end = 2.5 - (1 / share + 0.3) ** 2 / 12
    t = np.arange(0, 1.0001, 0.005)
    q = end - 1 + t
    own = {"offset": [0.3], "deceleration": [6.0], "position": [[-2.5, 2.5]]}
    found = evidence(log([q], decimals, 0.005), Limits([2], [50], falling_velocity=own))
    told = found.limits["falling_velocity"]
    assert share * 0.84 < told.at_least <= share * (1 + 1e-9)  # the limit falls within a window
    assert found.verdict == ("kept" if share < 1 else "broken")
    if share > 1:
        assert found.conviction.limit == "falling_velocity"
        assert found.conviction.at_least <= share * (1 + 1e-9)
    else:
        assert told.uses <= 1


def test_nine_times_an_acceleration_needs_three_times_the_time():
    """A quintic over 1 rad in 1 s reaches 10/√3 rad/s²."""
    limits = Limits([100.0], [10 / np.sqrt(3) / 9])
    slower = evidence(log([quintic(1.0)[1]], 6), limits).slower
    assert 0.97 * 3 <= slower.at_least <= 3 * (1 + 1e-9)
    assert slower.at_least <= slower.factor <= 3 * 1.01


@pytest.mark.parametrize("kinds", [2, 3])
def test_a_broken_log_gets_the_shortest_lawful_motion_at_its_own_spacing(kinds):
    """A quintic over h rad in 1 s must take as long as the worst of three closed forms says."""
    h = [0.5, 0.9]
    columns = [quintic(own)[1] for own in h]
    limits = Limits([1, 1], [3, 3], [20, 20] if kinds == 3 else None)
    found = evidence(log(columns, 5), limits)
    worst = [1.875 * 0.9, np.sqrt(10 / np.sqrt(3) * 0.9 / 3), np.cbrt(60 * 0.9 / 20)]
    assert found.verdict == "broken"
    assert [own.joint for own in found.convictions] == [1, 0][: 1 + (kinds == 3)]
    # Within the digits a little less will do; never more than that quintic needs.
    slower = found.slower
    least = max(worst[:2]) if kinds == 2 else max(worst[0], worst[1])
    assert slower.at_least <= slower.factor <= slower.at_least * 1.001
    if found.conviction.limit == "velocity":
        assert slower.at_least >= found.conviction.at_least * (1 - 1e-12)
    assert 0.97 * least <= slower.factor <= max(worst[:kinds]) * 1.001
    passed = slower.motion(slower.factor * 0.002 * np.arange(501))
    assert np.abs(passed - np.stack(columns, axis=1)).max() <= 1e-5 * (1 + 1e-6)
    again = Trajectory(
        slower.motion.breaks, slower.motion.coefficients, [0, slower.motion.duration]
    )
    for order, values in enumerate([limits.velocity, limits.acceleration, limits.jerk], start=1):
        assert peak(again, order, values, ratio).value <= 1 + 1e-6
    assert evidence(log(columns, 5), Limits([3, 3], [30, 30])).slower is None
