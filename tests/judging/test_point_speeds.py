"""The kernel's chords of tools and links, in exact fractions: against closed forms and floats."""

from __future__ import annotations

from fractions import Fraction
from math import cos, pi, sin

import numpy as np
import pytest

from baselines.lower_bound.dual_check import BoundProof
from baselines.lower_bound.planner import Prove
from soaks import arms
from trajopt import Limits, Problem
from trajopt.core.chain import LinkChain
from trajopt.judging import check_proof, proved_bounds

# A corner of 90 degrees between two links of 1 m, straight, and folded.
CORNERS = [[0.0, pi / 2], [0.0, 0.0], [pi / 2, -pi]]


def two_links(waypoints=CORNERS, **asked):
    origins = np.tile(np.eye(4), (2, 1, 1))
    origins[1, 0, 3] = 1.0
    tool = np.eye(4)
    tool[0, 3] = 1.0
    chain = LinkChain(origins, np.tile([0.0, 0.0, 1.0], (2, 1)), np.zeros(2, dtype=bool), tool)
    demands = {"tolerance": asked.pop("tolerance")} if "tolerance" in asked else {}
    return Problem(waypoints, Limits([9, 9], [9, 9], **asked), chain=chain, demands=demands)


def chords(problem):
    numbers = range(len(problem.waypoints))
    return [float(x) for x in check_proof.chord_times(proved_bounds.stated(problem), numbers)]


@pytest.mark.parametrize("x", [0.0, 1e-9, 0.7, -1.3, 3.0, -6.25, 20.0, 1e5])
def test_a_sine_and_a_cosine_lie_between_their_ends(x):
    sine, cosine = check_proof.sine_and_cosine(Fraction(x))
    for (low, high), near in ((sine, sin(x)), (cosine, cos(x))):
        assert 0 <= high - low < Fraction(1, 2**90)
        assert float(low) == pytest.approx(near, abs=2e-16)
    squares = [max(a**2, b**2) for a, b in (sine, cosine)]
    least = [min(a**2, b**2) for a, b in (sine, cosine)]
    assert sum(least) <= 1 <= sum(squares)


def test_an_angle_beyond_all_digits_is_told_nothing_of():
    for low, high in check_proof.sine_and_cosine(Fraction(1e300)):
        assert (low, high) == (-1, 1)


def test_chords_are_those_of_a_triangle():
    """From (1, 1) to (2, 0), and to (0, 0): √2 m and 2 m, at half a metre a second."""
    assert chords(two_links(tool_speed=0.5)) == pytest.approx([2 * 2**0.5, 4.0], rel=1e-15)
    assert chords(two_links(tool_speed=[0.5, np.inf])) == pytest.approx([2 * 2**0.5, 0.0])
    loose = two_links(tool_speed=0.5, tolerance=[[0, 0], [0.1, 0], [0, 0]])
    assert chords(loose) == [0.0, 0.0]


def test_a_way_that_rounding_makes_counts_as_none():
    """The last turn of a whole circle leads back; in floats 2π is none."""
    circle = two_links([[0.0, 0.5], [2 * pi, 0.5], [0.0, 0.0]], tool_speed=0.5)
    first, _ = chords(circle)
    assert first == 0


@pytest.mark.parametrize("seed", range(3))
def test_random_arms_have_the_places_of_the_toolkit(seed):
    rng = np.random.default_rng(seed)
    chain = arms.drawn_chain(rng, int(rng.integers(1, 8)))
    waypoints = rng.uniform(-2, 2, (3, chain.joints))
    ones = np.ones(chain.joints)
    problem = Problem(waypoints, Limits(ones, ones, tool_speed=0.3), chain=chain)
    places = chain.forward(waypoints)[:, :3, 3]
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert chords(problem) == pytest.approx(ways / 0.3, rel=1e-12)


def test_the_planner_and_the_kernel_prove_the_same():
    problem = two_links(tool_speed=0.5)
    found = Prove().solve(problem)
    again = Prove().stored_bound(problem, found.stats)
    assert again == pytest.approx(found.lower_bound, rel=1e-9)
    proof = vars(BoundProof.stored(found.stats))
    assert proved_bounds.proved_bound(problem, proof) == again
    assert again >= (4 + 2 * 2**0.5) * (1 - 2e-4)
    # the same steps prove less where the tool may be faster
    assert proved_bounds.proved_bound(two_links(tool_speed=0.6), proof) < again * 5 / 6 * 1.001


def test_ways_of_a_tool_join_the_limits_of_the_joints():
    """The chord of the first segment and the joints' time of the second one, in one proof."""
    problem = two_links(tool_speed=[0.5, np.inf])
    found = Prove().solve(problem)
    proof = vars(BoundProof.stored(found.stats))
    (chord, _), free = chords(problem), Prove().solve(two_links())
    # from any velocity at the corner joint 2 goes 180 degrees and rests: at 9 rad/s, 9 rad/s²
    second = pi / 9
    bound = proved_bounds.proved_bound(problem, proof)
    assert bound >= (chord + second) * (1 - 2e-4) > free.lower_bound
    for faster in (0.505, 0.6):
        less = proved_bounds.proved_bound(two_links(tool_speed=[faster, np.inf]), proof)
        assert less < bound - 0.9 * chord * (1 - 0.5 / faster)


def test_waypoints_that_rounding_may_miss_have_no_ways_of_their_own():
    """Between the two others the way is straight; the bound counts it, the search does not."""
    dense = np.linspace([0.0, 0.0], [1e-3, 1e-3], 4)
    problem = two_links([*dense, [1.0, 1.0]], tool_speed=0.5)
    said = proved_bounds.stated(problem)
    kept = check_proof.counted_problem(said, {})
    assert len(kept.least_times) < problem.segments
    straight = check_proof.chord_times(said, [0, 3, 4])
    assert sum(kept.least_times) <= sum(straight) * (1 + Fraction(1, 10**9))
    left_out = list(problem.limits.others.values())
    assert not Prove().tightened(problem.without("tool_speed"), left_out).demands
