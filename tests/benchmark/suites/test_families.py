"""Random families: the same numbers everywhere, and what each family promises; degenerate kinds."""

from itertools import islice, pairwise
from zlib import crc32

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from trajopt import InvalidInput, Problem, UnknownName
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.edges import stream as made_edges

MANY = range(60)


@pytest.fixture(scope="module")
def drawn():
    return {f: [families.draw(f, i) for i in MANY] for f in families.FAMILIES}


@pytest.fixture(scope="module")
def edges():
    return {p.name.removeprefix("edges-"): p for p in made_edges()}


def every(drawn):
    return [p for some in drawn.values() for p in some]


# --- the same numbers everywhere ---


def test_a_family_and_an_index_mean_one_problem(drawn):
    for family, some in drawn.items():
        assert families.draw(family, 7).digest() == some[7].digest()
    digests = {p.digest() for p in every(drawn)}
    assert len(digests) == len(every(drawn))
    assert len({p.name for p in every(drawn)}) == len(digests)


def test_numbers_recorded_once_are_still_the_numbers(drawn):
    """A change detector, no more: if it fails, undo the change or raise `families.VERSION`."""
    assert families.VERSION == 1
    first = {family: some[0].digest()[:16] for family, some in drawn.items()}
    assert first == RECORDED


RECORDED = {
    "smooth": "4e90bbbd187c23eb",
    "zigzag": "add31bb34b6cd262",
    "collinear": "f4190d4b4e7472a0",
    "tiny": "80529fda4ec62515",
    "huge": "8ff2f52df1d35b58",
    "unequal": "d4fd1f94ee5c60c7",
}


def test_scalar_arithmetic_gives_the_same_bits():
    """A cubic by Python's floats, one at a time, is the cubic by arrays to the last bit."""
    problem = families.draw("smooth", 3, joints=1, waypoints=5)
    rng = np.random.default_rng([1, crc32(b"smooth"), 3])
    for sizes in (12, 12, 2):
        rng.integers(sizes)
    control = [-np.pi + 2 * np.pi * rng.random() for _ in range(4)]
    for row, position in enumerate(problem.waypoints[:, 0]):
        s = row / 4
        points = control
        while len(points) > 1:
            points = [a * (1 - s) + b * s for a, b in pairwise(points)]
        assert points == [position]


class Plain:
    """A generator without `uniform` and other distributions."""

    make = staticmethod(np.random.default_rng)

    def __init__(self, seed):
        generator = self.make(seed)
        self.random = generator.random
        self.integers = generator.integers
        self.choice = generator.choice


@pytest.mark.parametrize("family", families.FAMILIES)
def test_only_uniform_numbers_and_integers_are_drawn(monkeypatch, family):
    """Other distributions differ in their last bit between machines."""
    problem = families.draw(family, 5)
    monkeypatch.setattr(np.random, "default_rng", Plain)
    assert families.draw(family, 5).digest() == problem.digest()


# --- sizes ---


def test_sizes_cover_what_is_promised(drawn):
    assert {p.joints for p in every(drawn)} == set(range(1, 13))
    assert {len(p.waypoints) for p in every(drawn)} == set(families.WAYPOINTS)
    assert (min(families.WAYPOINTS), max(families.WAYPOINTS)) == (2, 50)
    for some in drawn.values():
        assert 0.3 < np.mean([p.has("jerk") for p in some]) < 0.7
        assert not any(p.has("position") for p in some)


@pytest.mark.parametrize("family", families.FAMILIES)
def test_sizes_and_jerk_can_be_chosen(family):
    for index in range(5):
        p = families.draw(family, index, joints=3, waypoints=7, jerk=True)
        assert p.waypoints.shape == (7, 3)
        assert p.has("jerk")
        assert p.name == f"random-{family}-j3-w7-jerk-{index:02}"
        plain = families.draw(family, index, joints=3, waypoints=7, jerk=False)
        assert plain.digest() == p.without("jerk").digest()


@pytest.mark.parametrize(
    ("index", "sizes", "word"),
    [(-1, {}, "index"), (0, {"joints": 0}, "joints"), (0, {"waypoints": 1}, "waypoints")],
)
def test_sizes_that_make_no_problem_are_refused(index, sizes, word):
    with pytest.raises(InvalidInput, match=f"^{word} is"):
        families.draw("smooth", index, **sizes)


def test_an_unknown_family_says_which_there_are():
    with pytest.raises(UnknownName, match="did you mean 'zigzag'"):
        families.draw("zig-zag", 0)


def test_the_stream_goes_through_the_families_by_turns_without_end():
    names = [p.name.split("-")[1] for p in islice(families.stream(), 15)]
    assert names == (list(families.FAMILIES) * 3)[:15]
    assert [p.name for p in islice(families.stream("tiny"), 3)] == [
        families.draw("tiny", i).name for i in range(3)
    ]


# --- what each family promises ---


def test_every_segment_moves_every_joint(drawn):
    for problem in every(drawn):
        assert problem.displacements.any(axis=1).all()
        assert problem.moving.all()


def test_a_cubic_turns_back_twice_at_most(drawn):
    for problem in drawn["smooth"]:
        signs = np.sign(problem.displacements)
        turns = np.diff(signs, axis=0) != 0
        assert (turns.sum(axis=0) <= 2).all()
        # inside the hull of its control points
        assert np.abs(problem.waypoints).max() <= np.pi
        # fourth differences of a cubic vanish
        if problem.segments >= 4:
            differences = np.diff(problem.waypoints, 4, axis=0)
            assert np.abs(differences).max() < 1e-13


def test_zigzag_turns_back_everywhere(drawn):
    for problem in drawn["zigzag"]:
        h = problem.displacements
        assert (h[1:] * h[:-1] < 0).all()
        assert np.abs(h).min() > 0.2 - 1e-9
        assert np.abs(h).max() < 1.5 + 1e-9


def test_near_collinear_is_near_and_not_collinear(drawn):
    for problem in drawn["collinear"]:
        way = problem.waypoints - problem.waypoints[0]
        whole = way[-1]
        along = way @ whole / (whole @ whole)
        off = np.abs(way - np.outer(along, whole)).max()
        assert off < 0.03 * np.sqrt(problem.joints)
        if problem.joints > 1 and problem.segments > 1:
            assert off > 1e-8


@pytest.mark.parametrize(
    ("family", "smallest", "largest"), [("tiny", 1.6e-9, 1.6), ("huge", 0.2, 1.5e4)]
)
def test_tiny_and_huge_segments_are_among_ordinary_ones(drawn, family, smallest, largest):
    sizes = [np.abs(problem.displacements).max(axis=1) for problem in drawn[family]]
    if family == "tiny":
        assert all(own.min() < 1.6e-3 for own in sizes)
    together = np.concatenate(sizes)
    assert smallest / 10 < together.min() < smallest * 10
    assert largest / 1.5 < together.max() <= largest
    ordinary = (together > 0.2) & (together < 1.6)
    assert ordinary.mean() > 0.2


@pytest.mark.parametrize("family", families.FAMILIES)
@pytest.mark.parametrize(("limit", "low", "high"), [("velocity", 0.5, 5), ("acceleration", 1, 20)])
def test_limits_are_unequal_in_their_family_and_moderate_elsewhere(drawn, family, limit, low, high):
    if family == "unequal":
        low = 1e-3
        high = 1e3
    pairs = np.vstack([getattr(problem.limits, limit) for problem in drawn[family]])
    upper = pairs[:, 1]
    assert low <= upper.min() < 1.5 * low
    assert high / 1.5 < upper.max() <= high


def test_one_joint_in_four_is_asymmetric(drawn):
    pairs = np.vstack([problem.limits.velocity for problem in every(drawn)])
    ratio = -pairs[:, 0] / pairs[:, 1]
    assert 0.2 < np.mean(ratio != 1) < 0.3
    assert ratio.min() > 1 / 3 - 1e-12
    assert ratio.max() < 3 + 1e-12


def test_jerk_is_1_to_1000_times_acceleration(drawn):
    ratios = []
    for problem in every(drawn):
        if problem.has("jerk"):
            jerk = problem.limits.jerk
            assert (jerk.sum(axis=1) == 0).all()
            tighter = np.abs(problem.limits.acceleration).min(axis=1)
            ratios.append(jerk[:, 1] / tighter)
    ratio = np.concatenate(ratios)
    assert 1 - 1e-12 <= ratio.min() < 2
    assert 500 < ratio.max() <= 1000 * (1 + 1e-12)


# --- degenerate problems ---


def test_edges_have_their_own_names_and_are_no_files(edges):
    assert len(edges) == len({p.digest() for p in edges.values()}) >= 20
    assert not {p.name for p in edges.values()} & set(suite.problem_files())
    assert all(p.source.startswith("trajopt.benchmark.suites.edges, ") for p in edges.values())
    small = {name: p for name, p in edges.items() if "dense" not in name}
    assert sum(p.joints > 6 or len(p.waypoints) > 9 for p in small.values()) == 2
    assert len(edges) == len(small) + 12


@pytest.mark.parametrize(
    ("name", "duration"),
    [
        # Rest to rest over d with v = 1, a = 2: d/v + v/a.
        ("two-waypoints", 1.5),
        ("one-joint-two-waypoints", 1.5),
        ("straight", 3.5),  # all joints in proportion: one motion over 3 rad
        ("repeated-all-but-last", 1.5),
        ("out-and-back", 3.0),  # passing the turn at speed w costs w²/(2v) more than resting there
    ],
)
def test_optima_known_in_closed_form(edges, name, duration):
    found = Exact(starts=2).solve(edges[name]).trajectory
    assert found.duration == pytest.approx(duration, rel=1e-7)


def test_files_written_from_them_are_read_back_the_same(edges, drawn, tmp_path):
    file = tmp_path / "p.toml"
    for problem in [*edges.values(), *(some[1] for some in drawn.values())]:
        file.write_text(problem.to_toml(), encoding="utf-8")
        again = Problem.from_toml(file)
        assert (again.digest(), again.name) == (problem.digest(), problem.name)
