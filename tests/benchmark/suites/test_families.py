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
    """Python's floats, one at a time, are what IEEE 754 says; arrays must not differ from them."""
    problem = families.draw("smooth", 3, joints=2, waypoints=5)
    rng = np.random.default_rng([1, crc32(b"smooth"), 3])
    rng.integers(12), rng.integers(12), rng.integers(2)
    c = [[-np.pi + (np.pi - -np.pi) * rng.random() for _ in range(2)] for _ in range(4)]
    for k in range(5):
        s, rows = k / 4, c
        while len(rows) > 1:
            rows = [
                [a * (1 - s) + b * s for a, b in zip(p, q, strict=True)] for p, q in pairwise(rows)
            ]
        assert rows[0] == problem.waypoints[k].tolist()


def test_nothing_is_drawn_but_uniform_numbers_and_integers(monkeypatch):
    """Other distributions, and `uniform`, are not the same to the last bit on every machine."""
    real = np.random.default_rng

    class Plain:
        def __init__(self, seed):
            rng = real(seed)
            self.random, self.integers, self.choice = rng.random, rng.integers, rng.choice

    digests = [families.draw(f, 5).digest() for f in families.FAMILIES]
    monkeypatch.setattr(np.random, "default_rng", Plain)
    assert [families.draw(f, 5).digest() for f in families.FAMILIES] == digests


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
    for p in every(drawn):
        assert p.displacements.any(axis=1).all()
        assert p.moving.all()


def test_a_cubic_turns_back_twice_at_most(drawn):
    for p in drawn["smooth"]:
        signs = np.sign(p.displacements)
        assert ((np.diff(signs, axis=0) != 0).sum(axis=0) <= 2).all()
        assert np.abs(p.waypoints).max() <= np.pi  # inside the hull of its control points
        if p.segments >= 4:  # fourth differences of a cubic vanish
            assert np.abs(np.diff(p.waypoints, 4, axis=0)).max() < 1e-13


def test_zigzag_turns_back_everywhere(drawn):
    for p in drawn["zigzag"]:
        assert (p.displacements[1:] * p.displacements[:-1] < 0).all()
        sizes = np.abs(p.displacements)
        assert ((sizes > 0.2 - 1e-9) & (sizes < 1.5 + 1e-9)).all()


def test_near_collinear_is_near_and_not_collinear(drawn):
    for p in drawn["collinear"]:
        a, b = p.waypoints[0], p.waypoints[-1]
        along = (p.waypoints - a) @ (b - a) / ((b - a) @ (b - a))
        off = np.abs(p.waypoints - a - along[:, None] * (b - a)).max()
        assert off < 0.03 * np.sqrt(p.joints)
        if p.joints > 1 and len(p.waypoints) > 2:
            assert off > 1e-8


def test_tiny_and_huge_segments_are_among_ordinary_ones(drawn):
    sizes = {f: [np.abs(p.displacements).max(axis=1) for p in drawn[f]] for f in ("tiny", "huge")}
    assert all(s.min() < 1.6e-3 for s in sizes["tiny"])
    assert min(s.min() for s in sizes["tiny"]) < 1.6e-9
    assert max(s.max() for s in sizes["huge"]) > 1e4
    assert max(s.max() for s in sizes["huge"]) <= 1.5e4
    for some in sizes.values():
        assert np.mean([0.2 < x < 1.6 for s in some for x in s]) > 0.2


def test_limits_are_unequal_in_their_family_and_moderate_elsewhere(drawn):
    for family, some in drawn.items():
        for name, low, high in (("velocity", 0.5, 5), ("acceleration", 1, 20)):
            upper = np.concatenate([getattr(p.limits, name)[:, 1] for p in some])
            low, high = (1e-3, 1e3) if family == "unequal" else (low, high)
            assert low <= upper.min() < 1.5 * low
            assert high / 1.5 < upper.max() <= high


def test_one_joint_in_four_is_asymmetric(drawn):
    pairs = np.vstack([p.limits.velocity for p in every(drawn)])
    ratio = -pairs[:, 0] / pairs[:, 1]
    assert 0.2 < np.mean(ratio != 1) < 0.3
    assert ratio.min() > 1 / 3 - 1e-12
    assert ratio.max() < 3 + 1e-12


def test_jerk_is_1_to_1000_times_acceleration(drawn):
    limited = [p.limits for p in every(drawn) if p.has("jerk")]
    ratio = np.concatenate([x.jerk[:, 1] / np.abs(x.acceleration).min(axis=1) for x in limited])
    assert 1 - 1e-12 <= ratio.min() < 2
    assert 500 < ratio.max() <= 1000 * (1 + 1e-12)
    assert all((x.jerk.sum(axis=1) == 0).all() for x in limited)


# --- degenerate problems ---


def test_edges_have_their_own_names_and_are_no_files(edges):
    assert len(edges) == len({p.digest() for p in edges.values()}) >= 20
    assert not {p.name for p in edges.values()} & set(suite.problem_files())
    assert all(p.source.startswith("trajopt.benchmark.suites.edges, ") for p in edges.values())
    assert sum(p.joints > 6 or len(p.waypoints) > 9 for p in edges.values()) == 2


PROMISES = {
    "two-waypoints": lambda p: len(p.waypoints) == 2,
    "one-joint-two-waypoints": lambda p: p.waypoints.shape == (2, 1),
    "twelve-joints": lambda p: p.joints == 12 and len(np.unique(p.waypoints, axis=1).T) == 12,
    "fifty-waypoints": lambda p: len(p.waypoints) == 50 and p.displacements.any(axis=1).all(),
    "repeated-first": lambda p: not p.displacements[0].any() and p.displacements[1:].any(),
    "repeated-last": lambda p: not p.displacements[-1].any() and p.displacements[:-1].any(),
    "repeated-all-but-last": lambda p: p.displacements.any(axis=1).tolist() == [0, 0, 0, 1],
    "out-and-back": lambda p: (p.waypoints[0] == p.waypoints[2]).all(),
    "palindrome": lambda p: (p.waypoints == p.waypoints[::-1]).all(),
    "path-twice": lambda p: (p.waypoints[:5] == p.waypoints[4:]).all(),
    "one-of-six-moves": lambda p: p.joints == 6 and p.moving.sum() == 1,
    "one-segment-each": lambda p: (p.displacements != 0).sum(axis=0).tolist() == [1, 1],
    "twins": lambda p: (p.waypoints[:, 0] == p.waypoints[:, 1]).all(),
    "mirrored": lambda p: (p.waypoints[:, 0] == -p.waypoints[:, 1]).all(),
    "straight": lambda p: (p.displacements == p.displacements[0]).all(),
    "zigzag": lambda p: (p.displacements[1:] == -p.displacements[:-1]).all(),
    "tiny": lambda p: 0 < np.abs(p.displacements).max() <= 1.1e-9,
    "huge": lambda p: np.abs(p.displacements).max() >= 1e4,
    "tiny-beside-huge": lambda p: 9e3 < np.divide(*p.displacements[::-1, 0]) / 1e9 < 1.1e4,
    "one-ulp": lambda p: p.displacements[1, 0] == np.spacing(1.0),
    "far-from-zero": lambda p: p.waypoints.min() > 9e5 and np.abs(p.displacements).max() < 2,
    "million-to-one": lambda p: p.limits.velocity[1, 1] == 1e6 * p.limits.velocity[0, 1],
    "slow": lambda p: p.limits.velocity.max() == p.limits.acceleration.max() == 1e-6,
    "fast": lambda p: p.limits.velocity.max() == p.limits.acceleration.max() == 1e6,
    # Reaching velocity v takes at least v²/(2a), and as much again to stop.
    "velocity-never-reached": lambda p: reach(p).min() > np.abs(p.displacements).sum(),
    "velocity-always-reached": lambda p: reach(p).max() < 1e-5 * np.abs(p.displacements).min(),
    "asymmetric": lambda p: np.allclose(np.divide(*p.limits.velocity.T), -0.01),
    "jerk-soft": lambda p: (p.limits.jerk[:, 1] < p.limits.acceleration[:, 1]).all(),
    "jerk-stiff": lambda p: (p.limits.jerk[:, 1] >= 1e5 * p.limits.acceleration[:, 1]).all(),
    "jerk-one-joint": lambda p: np.isfinite(p.limits.jerk).tolist() == [[1, 1], [0, 0]],
    "jerk-asymmetric": lambda p: (p.limits.jerk[:, 1] == -10 * p.limits.jerk[:, 0]).all(),
    "jerk-one-side": lambda p: np.isfinite(p.limits.jerk).tolist() == [[1, 0], [1, 0]],
    "jerk-at-rest": lambda p: (np.isfinite(p.limits.jerk[:, 1]) == ~p.moving).all(),
    "at-position-limit": lambda p: (np.stack([p.waypoints.min(0), p.waypoints.max(0)], 1)
                                    == p.limits.position).all(),
    "corridor": lambda p: (np.ptp(p.limits.position, axis=1) - np.ptp(p.waypoints, 0) < 3e-6).all(),
    "position-one-side": lambda p: np.isfinite(p.limits.position).tolist() == [[0, 1], [0, 0]],
    "jerk-and-position": lambda p: p.has("jerk") and p.has("position"),
}  # fmt: skip


def reach(p):
    return p.limits.velocity[:, 1] ** 2 / p.limits.acceleration[:, 1]


def test_each_kind_is_what_its_name_says(edges):
    assert edges.keys() == PROMISES.keys()
    for name, promise in PROMISES.items():
        assert promise(edges[name]), name


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
