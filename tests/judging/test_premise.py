"""What positions are known to, found from samples of sensors that are known."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from math import pi, sqrt, tau

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.judging.evidence import evidence
from trajopt.judging.lattice import lattice
from trajopt.judging.log_joint import Log
from trajopt.judging.log_windows import bound, proved
from trajopt.judging.lost_rows import lost_rows
from trajopt.judging.premise import LEAST_HALF, commanded, measured
from trajopt.judging.scatter import scatter

FREE = (-np.inf, np.inf)
LIMITS = [(-2.0, 2.0), (-10.0, 10.0), (-200.0, 200.0)]


def course(rate, length=2.0):
    """A smooth motion: at most 1.57 rad/s, 4.9 rad/s² and 15.5 rad/s³."""
    t = np.arange(round(length * rate) + 1) / rate
    return t, 0.5 * np.sin(pi * t) ** 2


def encoded(rng, rate, bits, decimals, degrees, gear):
    """What an encoder gives and a file prints: the values, the printed unit, the true step."""
    _, q = course(rate)
    step = gear * tau / 2**bits
    read = step * np.round(q / step + rng.uniform()) + rng.uniform(-1, 1)
    unit = pi / 180 if degrees else 1.0
    if decimals is None:
        return read, 1e-15, step
    return unit * np.round(read / unit, decimals), unit * 10.0**-decimals, step


@pytest.mark.parametrize("decimals", [3, 4, 5, 6, 7, 9, None])
@pytest.mark.parametrize("rate", [40, 250, 1000])
def test_the_step_of_an_encoder_is_found_and_no_other(decimals, rate):
    rng = np.random.default_rng([rate, decimals or 17])
    for bits, degrees in product((11, 13, 16, 20), (False, True)):
        gear = float(rng.choice([1.0, 0.81, 1 / 1.37]))
        values, unit, step = encoded(rng, rate, bits, decimals, degrees, gear)
        found = lattice(values, unit)
        if step >= (2.3 if len(values) > 100 else 4) * unit:
            assert found is not None
        if found is not None and step >= 2.3 * unit:
            assert found[0] == pytest.approx(step, rel=1e-3)
            assert np.abs(found[1] - values).max() <= 0.7 * unit + 1e-12


@pytest.mark.parametrize("decimals", [3, 5, 9, None])
def test_values_without_a_step_have_none(decimals):
    _, q = course(500)
    values = q if decimals is None else np.round(q, decimals)
    assert lattice(values, 1e-15 if decimals is None else 10.0**-decimals) is None


@pytest.mark.parametrize("sigma", [1e-5, 1e-3])
@pytest.mark.parametrize("kept", [0.0, 0.8], ids=["white", "coloured"])
def test_the_scatter_is_the_standard_deviation_of_the_noise(sigma, kept):
    rng = np.random.default_rng(4)
    t, q = course(1000, 4.0)
    noise = rng.normal(0, sigma, len(t))
    for row in range(1, len(t)):
        noise[row] = kept * noise[row - 1] + sqrt(1 - kept**2) * noise[row]
    found = scatter(t, q + noise, 1e-9, 3, LIMITS[2])
    # Neighbours of coloured noise differ by less; samples far apart show most of it.
    assert (0.9 if not kept else 0.6) * sigma < found.sigma < 1.2 * sigma


def test_a_smooth_motion_and_one_that_stands_do_not_scatter():
    t, q = course(1000)
    assert scatter(t, q, 1e-9, 3, LIMITS[2]).sigma < 1e-9
    assert scatter(t, np.full(len(t), 0.3), 1e-9, 3, LIMITS[2]) is None


def premise_of(t, x, half, **stated):
    return measured(t, x, np.full(len(t), half), LIMITS, len(t), **stated)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.1, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("bits", [12, 15])
def test_no_position_is_farther_off_than_its_half_width(bits, noise):
    rng = np.random.default_rng([bits, int(100 * noise)])
    t, q = course(500)
    step = tau / 2**bits
    x = np.round(step * np.round((q + rng.normal(0, noise * step, len(t))) / step), 7)
    found = premise_of(t, x, 5e-8)
    assert found.step == pytest.approx(step, rel=1e-3)
    assert (np.abs(found.positions - q) <= found.half).all()
    assert found.known < (1 + 9 * noise) * step + 0.7 * step
    assert found.seen or noise < 0.3
    if noise >= 0.3:
        assert noise * step < found.noise < 1.3 * noise * step + 0.1 * step


def test_what_was_stated_is_not_found():
    t, q = course(500)
    x = np.round(q + np.random.default_rng(1).normal(0, 1e-3, len(t)), 6)
    none = premise_of(t, x, 5e-7, noise=0.0)
    assert none.known == pytest.approx(5e-7)
    assert none.stated == ("noise",)
    both = premise_of(t, x, 5e-7, noise=1e-3, resolution=2e-3)
    quantile = 4.0 + 5e-7  # of 1,001 samples at 1e-3: 4.89
    assert both.known > 1e-3 + quantile * 1e-3
    assert both.step == 2e-3
    assert commanded(t, x, np.full(len(t), 5e-7)).known == 5e-7


def test_floats_of_32_bits_are_known_to_their_spacing():
    t, q = course(500)
    x = (q + 1).astype(np.float32).astype(float)
    found = premise_of(t, x, 1e-17)
    assert found.unit == float(np.spacing(np.float32(1.5)))
    assert (np.abs(found.positions - q - 1) <= found.half).all()


@pytest.mark.parametrize("times", [2, 5])
def test_a_slower_sensor_s_repeats_are_no_samples(times):
    t, q = course(1000)
    held = np.arange(len(t)) // times * times
    x = np.round(q[held], 6)
    found = premise_of(t, x, 5e-7)
    fast = np.isin(t, found.times)[(t > 0.2) & (t < 0.4)]
    assert fast.mean() == pytest.approx(1 / times, abs=0.02)
    assert found.left_out > len(t) * (1 - 1.2 / times)
    assert found.times[-1] == t[-1]  # its last row is there, and wider
    true = np.interp(found.times, t, q)
    assert (np.abs(found.positions - true) <= found.half + 1e-9).all()


def test_times_that_scatter_widen_what_is_fast():
    rng = np.random.default_rng(3)
    t, _ = course(1000, 4.0)
    late = t + rng.normal(0, 1e-4, len(t))
    x = np.round(0.5 * np.sin(pi * late) ** 2, 7)
    found = premise_of(t, x, 5e-8)
    assert found.jitter == pytest.approx(1e-4, rel=0.5)
    assert (np.abs(found.positions - 0.5 * np.sin(pi * t) ** 2) <= found.half).mean() > 0.999
    assert found.half.max() > 1.2 * found.half.min()


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_bound_is_the_best_of_its_windows_and_its_rows_prove_it(order, seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, 24))
    x = np.cumsum(rng.normal(0, 1, 24))
    half = rng.uniform(0, 0.05, 24)
    found = bound(t, x, half, -0.5, 0.7, order)
    rows = list(found.rows)
    assert len(rows) == order + 1
    share = proved(t[rows], x[rows], half[rows], -0.5, 0.7)
    assert isinstance(share, Fraction)
    assert float(share) == pytest.approx(found.share)
    for stride in range(1, 8):
        for first in range(24 - order * stride):
            own = [first + i * stride for i in range(order + 1)]
            assert float(proved(t[own], x[own], half[own], -0.5, 0.7)) <= found.share * (1 + 1e-9)
    wide = half * found.margin * (1 + 1e-6)
    assert bound(t, x, wide, -0.5, 0.7, order).share <= 1 + 1e-5
    if found.margin > 1:
        narrow = half * found.margin * (1 - 1e-3)
        assert bound(t, x, narrow, -0.5, 0.7, order).share > 1


def test_the_mean_of_a_polynomial_s_derivative_is_exact():
    t = np.array([0.0, 0.3, 1.0, 1.6])
    x = 5 * t**3 - t**2 + 4
    assert float(proved(t, x, np.zeros(4), -10.0, 10.0)) == pytest.approx(3.0)  # 30 rad/s³
    assert float(proved(t[:1], np.array([7.0]), np.array([1.0]), -3.0, 3.0)) == pytest.approx(2.0)


@pytest.mark.parametrize("places", [[(300, 1)], [(300, 1), (700, 2)], [(300, 1), (306, 1)]])
def test_rows_that_were_lost_are_found_and_convict_nobody(places):
    t, q = course(1000)
    lost = [row + i for row, count in places for i in range(count)]
    x = np.round(np.delete(q, lost), 6)
    known = premise_of(t[: len(x)], x, 5e-7)
    found, times = lost_rows([known])
    assert sum(own.count for own in found) == len(lost)
    assert times == pytest.approx(np.delete(t, lost))
    log = Log(t[: len(x)], x[:, None], np.full((len(x), 1), 5e-7), decimals=[6])
    told = evidence(log, Limits([2], [10], [200]))
    assert told.verdict == "cannot be told"
    assert told.lost
    broken = evidence(log, Limits([1], [10], [200]))
    assert (broken.verdict, broken.conviction.limit) == ("broken", "velocity")
    assert broken.conviction.at_least == pytest.approx(pi / 2, rel=0.05)


def test_nothing_is_lost_where_a_motion_is_smooth():
    t, q = course(1000)
    assert lost_rows([premise_of(t, np.round(q, 6), 5e-7)])[0] == []


def with_velocities(v, rate=500, decimals=6):
    t, q = course(rate)
    half = np.full((len(t), 1), 0.5 * 10.0**-decimals)
    known = np.round(q, decimals)[:, None], half
    log = Log(t, *known, 0.0, [decimals], np.round(v(t, q), decimals)[:, None], half)
    return evidence(log, Limits([2], [10], [200])).joints[0]


@pytest.mark.parametrize(
    ("velocities", "own"),
    [
        (lambda t, q: pi / 2 * np.sin(2 * pi * t), True),
        (lambda t, q: np.zeros(len(t)), False),
        (lambda t, q: np.diff(q, prepend=0) * 500, False),
        (lambda t, q: np.diff(np.round(q, 6), prepend=0) * 500, False),
        (lambda t, q: pi / 2 * np.sin(2 * pi * (t - 0.005)), False),
        (lambda t, q: pi * np.sin(2 * pi * t), False),
    ],
    ids=["true", "zeros", "differences", "of what is printed", "late", "twice as fast"],
)
def test_velocities_count_if_they_are_evidence_of_their_own(velocities, own):
    counts, own = own, with_velocities(velocities)
    assert bool(len(own.readings.times)) == counts == (own.no_readings == "")
    if counts:
        true = pi / 2 * np.sin(2 * pi * own.readings.times)
        assert (np.abs(own.readings.values - true) <= own.readings.half).all()


@pytest.mark.parametrize("decimals", [4, 6, 9, None])
@pytest.mark.parametrize(("excess", "verdict"), [(0.999, "kept"), (1.2, "broken")])
def test_a_planner_s_motion_has_one_verdict_whatever_its_digits_are(excess, verdict, decimals):
    """Bang-bang over 2 s, at a share of 4 rad/s²."""
    t = np.arange(1001) / 500
    q = excess * np.where(t < 1, 2 * t**2, 4 - 2 * (2 - t) ** 2)
    x = q if decimals is None else np.round(q, decimals)
    half = np.full((len(t), 1), 1e-16 if decimals is None else 0.5 * 10.0**-decimals)
    found = evidence(
        Log(t, x[:, None], half, decimals=[decimals or 16]), Limits([9], [4]), window=0.2
    )
    assert found.verdict == verdict


def test_the_half_width_is_never_below_what_the_program_resolves():
    t, q = course(500)
    assert premise_of(t, q, 1e-17).known >= LEAST_HALF
