"""Do the relations of docs/mathematics.md, section 10, hold on thousands of random problems?

    python tests/soak.py relations                   # 2000 problems, half an hour on a core
    python tests/soak.py relations --quick           # 20 problems

A problem's rows go to `relations.csv` in `--output` as soon as they are known; running again does
only what is missing. The table counts violations by kind, each beyond its own tolerance. What could
not be checked (no answer, an exception, no time left) is a row of a kind "failed: …".
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from baselines.lower_bound.bound import prove
from baselines.ruckig_ import section
from baselines.topp_ra import along
from experiments.common.kept import Rows, apart, kept
from soaks import moving_ends
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.arrays import Array
from trajopt.judging import verification as judged
from trajopt.planners.registry import named

Mask = NDArray[np.bool_]
Check = tuple[str, float, float]  # kind, relative excess, tolerance
Checks = Iterator[Check]
State = tuple[Array, Array, Array]  # position, velocity, acceleration
Symmetry = tuple[str, float, Problem]  # kind, factor that restores the duration, problem
Found = tuple[Trajectory | None, float]  # trajectory and certified duration, s (NaN without one)

SPECS = (
    "exact:starts=4",
    "exact-jerk:starts=2",
    "spline353-nlp:starts=2",
    "unoptimised",
    "pso:fitness=scaled,iterations=40",
    "collocation",
    "toppra:gridpoints=300",
    "ruckig-search:evaluations=600",
    "ruckig-stop",
)
PLANNERS = dict(named(spec) for spec in SPECS)
INVARIANT = ("ruckig-stop", "spline353-nlp")  # planners that obey the symmetries
RELAXED = 1e-6  # relative; with exact limits, rounding can lead Ruckig to a longer branch
THEOREM = 1e-6  # relative; tolerance of solvers
SECTIONS = 1e-5  # relative; effect of dividing the states by 1 + 1e-6
GRID = 5e-2  # relative; effect of 300 gridpoints
STIFF = 1e5  # jerk over acceleration, 1/s
LONG = 0.1  # share of the largest displacement
TIMEOUT_S = 300.0  # for one problem


def drawn(seed: int) -> Problem:
    """Return a random problem; its jerk is limited if `seed` is odd.

    Most have 1 to 3 joints and 2 to 5 waypoints, one in 25 has any size.
    """
    rng = np.random.default_rng([8, seed])
    joints = None
    waypoints = None
    if seed % 25:
        joints = rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])
        waypoints = rng.choice([2, 3, 4, 5], p=[0.2, 0.4, 0.25, 0.15])
    problem = random_problem(seed, joints=joints, waypoints=waypoints, jerk=seed % 2 == 1)
    if seed % 3:
        return problem
    # Every third problem's jerk limits are asymmetric.
    jerk = problem.limits.jerk * [1.0, 0.6]
    limits = replace(problem.limits, jerk=jerk)
    return replace(problem, limits=limits)


@lru_cache(maxsize=64)
def answer(name: str, problem: Problem) -> Found:
    solution = PLANNERS[name].solve(problem)
    return certified(problem, solution.trajectory)


def certified(problem: Problem, trajectory: Trajectory | None) -> Found:
    if trajectory is None:
        return None, np.nan
    certificate = verify(problem, trajectory)
    return trajectory, certificate.certified_duration or np.nan


def duration(name: str, problem: Problem) -> float:
    """Return a planner's certified duration, s; NaN without one."""
    return answer(name, problem)[1]


def above(own: float, other: float) -> float:
    """Return the relative excess of a duration over another."""
    return own / other - 1


def relations(problem: Problem, seed: int) -> Checks:
    """Yield every check of a problem: its name and its relative error."""
    optimum = "exact"
    if problem.has("jerk"):
        optimum = "exact-jerk"
    able = [name for name, planner in PLANNERS.items() if not planner.unsupported(problem)]
    yield from ordered(problem, optimum, able)
    # One of the four symmetries, on every second problem.
    symmetries = alike(problem, seed)
    turn = seed // 2 % (2 * len(symmetries))
    if turn < len(symmetries):
        invariant = [name for name in able if name in (optimum, *INVARIANT)]
        yield from unchanged(problem, symmetries[turn], invariant)
    if problem.has("jerk"):
        yield from jerky(problem, seed)
    else:
        yield from free(problem, able, seed)
    if seed // 2 % 2:
        yield from dense(problem, optimum, seed)
    yield from moving(optimum, seed)
    yield from narrowed(problem, optimum, seed)
    yield from asked(problem, optimum, seed)


def ordered(problem: Problem, optimum: str, able: list[str]) -> Checks:
    """Yield the relative excess of an optimum over a planner that must not be faster than it."""
    pairs = [(optimum, name) for name in able if not name.startswith("exact")]
    pairs += [("spline353-nlp", name) for name in able if name in ("unoptimised", "pso")]
    pairs.append(("ruckig-search", "ruckig-stop"))
    for low, high in pairs:
        shorter = duration(low, problem)
        longer = duration(high, problem)
        yield f"{low} <= {high}", above(shorter, longer), THEOREM


def unchanged(problem: Problem, symmetry: Symmetry, names: list[str]) -> Checks:
    """Yield the relative difference of the minimum times of equivalent problems."""
    kind, factor, other = symmetry
    for name in names:
        own = duration(name, problem)
        undone = factor * duration(name, other)
        change = above(undone, own)
        yield f"{kind} {name}", abs(change), THEOREM


def alike(problem: Problem, seed: int) -> list[Symmetry]:
    """Yield equivalent problems: their minimum time, times a factor, is this problem's."""
    q = problem.waypoints
    v = problem.limits.velocity
    a = problem.limits.acceleration
    j = problem.limits.jerk
    # V c, A c², J c³ divide the duration by c.
    c = 3.7
    scaled = Limits(c * v, c**2 * a, c**3 * j)
    rng = np.random.default_rng(seed)
    order = rng.permutation(problem.joints)
    permuted = Limits(v[order], a[order], j[order])
    # Every other joint mirrored: its limits change sides.
    even = np.arange(problem.joints) % 2 == 0
    signs = 1 - 2 * even
    mirrored = Limits(_sides_changed(v, even), _sides_changed(a, even), _sides_changed(j, even))
    # Backwards in time velocity and jerk change signs.
    every = np.ones_like(even)
    reversed_ = Limits(_sides_changed(v, every), a, _sides_changed(j, every))
    return [
        ("scaling", c, Problem(q, scaled)),
        ("permuting", 1.0, Problem(q[:, order], permuted)),
        ("mirroring", 1.0, Problem(q * signs, mirrored)),
        ("reversing", 1.0, Problem(q[::-1], reversed_)),
    ]


def _sides_changed(limits: Array, joints: Mask) -> Array:
    """Return limits `(joints, 2)` of these joints with their sides and signs changed."""
    changed = -limits[:, ::-1]
    return np.where(joints[:, None], changed, limits)


def free(problem: Problem, able: list[str], seed: int) -> Checks:
    """Yield checks of the optimum: by IPOPT, by paths timed anew, and by a proved bound."""
    trajectory, exact = answer("exact", problem)
    if trajectory is not None:
        change = abs(above(retimed(problem, trajectory), trajectory.duration))
        yield "TOPP-RA along exact = exact", change, RELAXED + THEOREM
        yield "exact needs no dilation", above(exact, trajectory.duration), RELAXED + THEOREM
        yield "Ruckig by segments = exact", by_segments(problem, trajectory), SECTIONS
    for name in able:
        if name in ("exact-jerk", "toppra", "pso"):
            continue
        trajectory, own = answer(name, problem)
        if trajectory is None:
            continue
        again = along(problem, trajectory, gridpoints=300)
        _, shorter = certified(problem, again.trajectory)
        yield f"TOPP-RA along {name} <= {name}", above(shorter, own), GRID
    if seed % 10 == 0:
        bound = prove(problem, time_limit=5.0)
        yield "proved bound <= exact", above(bound.lower_bound, exact), THEOREM


def moving(optimum: str, seed: int) -> Checks:
    """Yield checks of motions that begin or end in motion, on problems of their own.

    With two waypoints Ruckig finds the optimum. Backwards in time the optimum takes as long. A
    solved problem is cut at a waypoint, or within a segment, in the motion's state there; both
    parts together take as long as the whole.
    """
    jerk = optimum == "exact-jerk"
    pair = moving_ends.drawn(seed, jerk=jerk)
    change = above(duration(optimum, pair), duration("ruckig-stop", pair))
    yield f"{optimum} = ruckig-stop, in motion", abs(change), THEOREM
    whole = moving_ends.drawn(seed, waypoints=3 + seed // 2 % 3, jerk=jerk)
    motion, own = answer(optimum, whole)
    route = whole.route.reversed()
    limits = whole.limits  # symmetric
    backwards = Problem(route.waypoints, limits, demands=route.demands)
    yield f"reversing {optimum}, in motion", abs(above(duration(optimum, backwards), own)), THEOREM
    if motion is None or (jerk and seed % 4 != 1):
        return
    times = motion.waypoint_times
    for cut in times[1:-1]:
        yield f"{optimum} in two parts, in motion", in_two(optimum, whole, cut), THEOREM
    shares = np.random.default_rng([53, seed]).uniform(0.02, 0.98, whole.segments)
    for cut in times[:-1] + shares * np.diff(times):
        yield f"{optimum} cut within a segment", in_two(optimum, whole, cut), THEOREM


def in_two(optimum: str, whole: Problem, cut: float) -> float:
    """Return the relative difference of the whole's minimum time and its two parts' sum."""
    motion, own = answer(optimum, whole)
    assert motion is not None
    parts = moving_ends.halves(whole, motion, cut)
    return abs(above(sum(duration(optimum, part) for part in parts), own))


def narrowed(problem: Problem, optimum: str, seed: int) -> Checks:
    """Yield checks of limits per segment: tighter ones never shorten, wider ones never lengthen."""
    rng = np.random.default_rng([52, seed])
    shape = (problem.segments, problem.joints, 1)
    known = problem.limits
    velocity, acceleration, jerk = (
        pairs * rng.uniform(0.3, 1.0, shape)
        for pairs in (known.velocity, known.acceleration, known.jerk)
    )
    own = replace(problem, limits=Limits(velocity, acceleration, jerk))
    widest = replace(problem, limits=own.limits.in_all_segments(tightest=False))
    slowed = duration(optimum, own)
    yield f"{optimum} <= with narrower segments", above(duration(optimum, widest), slowed), THEOREM
    key = ("velocity", "acceleration")[seed % 2]
    segment = int(rng.integers(problem.segments))
    joint = int(rng.integers(problem.joints))
    raised = replace(problem, limits=own.limits.widened(key, joint, 0.2, segment))
    kind = f"{optimum} with a raised segment <= without"
    yield kind, above(duration(optimum, raised), slowed), THEOREM


def asked(problem: Problem, optimum: str, seed: int) -> Checks:
    """Yield checks of demands: least times, closed motions, waits and tolerances.

    Least times that the optimum already keeps change nothing. A closed motion takes as long from
    another of its waypoints. A motion with a wait takes as long as its two parts from rest to rest
    and the wait. A wider tolerance never lengthens the optimum.
    """
    rng = np.random.default_rng([50, seed])
    points = problem.waypoints

    def with_(waypoints: Array = points, **demands: Any) -> float:
        return duration(optimum, replace(problem, waypoints=waypoints, demands=demands))

    motion, own = answer(optimum, problem)
    if motion is not None:
        least = np.diff(motion.waypoint_times) * rng.uniform(0, 0.9, problem.segments)
        kind = f"{optimum}: least times that it keeps"
        yield kind, abs(above(with_(least_times=least), own)), THEOREM

    turns = int(rng.integers(1, len(points)))
    loops = [np.vstack([turned, turned[:1]]) for turned in (points, np.roll(points, -turns, 0))]
    first, second = (with_(loop, closed=True) for loop in loops)
    yield f"{optimum}: a loop from another waypoint", abs(above(first, second)), THEOREM

    if problem.segments == 1:
        return
    at = int(rng.integers(1, problem.segments))
    wait = np.zeros(len(points))
    wait[at] = own * rng.uniform(0.01, 1)
    parts = sum(with_(rows) for rows in (points[: at + 1], points[at:]))
    change = above(with_(dwell=wait), parts + wait[at])
    yield f"{optimum}: a wait = two parts and its length", abs(change), THEOREM

    r = 10.0 ** rng.uniform(-4, -0.7) * problem.largest_displacements
    narrow, wide = (with_(tolerance=k * r) for k in (1.0, 1.5))
    yield f"{optimum} within tolerance <= exactly", above(narrow, own), THEOREM
    yield f"{optimum} within a wider tolerance <= a narrower", above(wide, narrow), THEOREM


def dense(problem: Problem, optimum: str, seed: int) -> Checks:
    """Yield how much the optimum changes if waypoints on an optimal motion are added."""
    trajectory, own = answer(optimum, problem)
    if trajectory is None:
        return
    motion = judged.certified(problem, trajectory)
    if motion is None:
        return
    denser, passed = with_added(problem, motion, seed)
    _, again = certified(denser, passed)
    yield f"judge: {optimum}'s motion, waypoints added", abs(above(again, own)), THEOREM
    yield f"{optimum}: waypoints added", abs(above(duration(optimum, denser), own)), THEOREM
    if seed % 10 == 3:
        bound = prove(denser, time_limit=5.0)
        yield "proved bound, waypoints added <= optimum", above(bound.lower_bound, own), THEOREM


def with_added(problem: Problem, motion: Trajectory, seed: int) -> tuple[Problem, Trajectory]:
    """Return the problem with up to eight more waypoints on a motion, and that motion.

    They lie within one of its longer segments, or beside rest at its start or end, 1e-9 to 1e-2 of
    the segment's displacement apart, or about that.
    """
    rng = np.random.default_rng([41, seed])
    share = 10.0 ** rng.uniform(-9, -2) * np.arange(1, rng.integers(2, 10))
    sizes = np.abs(problem.displacements / problem.largest_displacements).max(axis=1)
    segment = int(rng.choice(np.flatnonzero(sizes > LONG)))
    # beside rest the displacement grows with the cube of the time, or its square
    early = 0.5 * share ** (1 / 3 if problem.has("jerk") else 1 / 2)
    within = rng.uniform(0.1, 0.9) + share
    ends = {0: early, problem.segments - 1: 1 - early}
    shares = ends.get(segment, within) if rng.random() < 0.5 else within
    start, end = motion.waypoint_times[segment : segment + 2]
    added = np.sort(start + (end - start) * shares)
    every = np.insert(motion.waypoint_times, segment + 1, added)
    waypoints = np.insert(problem.waypoints, segment + 1, motion(added), axis=0)
    denser = replace(problem, waypoints=waypoints)
    return denser, replace(motion, waypoint_times=every)


def retimed(problem: Problem, trajectory: Trajectory) -> float:
    """Return TOPP-RA's duration along a trajectory's path, limits relaxed, s; NaN without one."""
    wider = replace(problem, limits=relaxed(problem.limits, RELAXED))
    found = along(wider, trajectory).trajectory
    return np.nan if found is None else found.duration


def jerky(problem: Problem, seed: int) -> Checks:
    """Yield checks under jerk limits: stiff ones approach none, and Ruckig agrees."""
    exact = duration("exact", problem.without("jerk"))
    trajectory, own = answer("exact-jerk", problem)
    yield "exact <= exact-jerk", above(exact, own), THEOREM
    if seed % 10 == 1:
        jerk = STIFF * problem.limits.acceleration
        limits = replace(problem.limits, jerk=jerk)
        stiff = duration("exact-jerk", replace(problem, limits=limits))
        # In every segment acceleration may change sign, over at most (1 + 10^0.5)/STIFF seconds.
        slack = 5 * problem.segments / STIFF / exact
        yield "exact-jerk -> exact", above(stiff, exact), slack
        yield "exact <= exact-jerk (stiff)", above(exact, stiff), THEOREM
    symmetric = seed % 3 != 0
    if symmetric and trajectory is not None:
        yield "Ruckig by segments = exact-jerk", by_segments(problem, trajectory), SECTIONS
    if symmetric and problem.segments == 1:
        change = above(own, duration("ruckig-stop", problem))
        yield "exact-jerk = ruckig-stop (2 waypoints)", abs(change), THEOREM


def by_segments(problem: Problem, trajectory: Trajectory) -> float:
    """Return the largest difference from Ruckig's segment times, relative to the duration.

    Limits are wider by 1e-6, or by 1e-9. In a segment of 1e-6 s the rounding of the states exceeds
    exact limits, and Ruckig then takes a much longer motion.
    """
    times = trajectory.waypoint_times
    velocities = trajectory(times, 1)
    accelerations = np.zeros_like(velocities)
    if problem.has("jerk"):
        accelerations = trajectory(times, 2)
    states = [*zip(problem.waypoints, velocities, accelerations, strict=True)]
    apart = []
    for wider in (RELAXED, 1e-9):
        ruckig = _section_times(relaxed(problem.limits, wider), states)
        apart.append(np.abs(ruckig - np.diff(times)))
    nearest = np.min(apart, axis=0)
    return float(nearest.max() / times[-1])


def relaxed(limits: Limits, wider: float) -> Limits:
    """Return limits of velocity, acceleration and jerk that are wider by this share."""
    factor = 1 + wider
    return replace(
        limits,
        velocity=factor * limits.velocity,
        acceleration=factor * limits.acceleration,
        jerk=factor * limits.jerk,
    )


def _section_times(limits: Limits, states: Iterable[State]) -> Array:
    """Return Ruckig's duration from each state to the next, s."""
    times = []
    for start, end in itertools.pairwise(states):
        duration, _ = section(limits, start, end)
        times.append(duration)
    return np.array(times)


def checked(seed: int) -> Rows:
    """Return the rows of one problem's checks; an exception is a row too."""
    problem = drawn(seed)
    rows = []
    try:
        for kind, excess, tolerance in relations(problem, seed):
            text = kind
            if problem.has("jerk"):
                text = f"{kind} (jerk)"
            if not np.isfinite(excess):
                text = f"failed: {text}"
            rows.append((text, excess, tolerance))
    except Exception as error:
        rows += failed(error)
    return pd.DataFrame(rows, columns=["kind", "excess", "tolerance"])


def failed(error: BaseException) -> list[Check]:
    """Return the row of a problem whose checks did not end."""
    return [(f"failed: {error!r}", np.inf, 0.0)]


def lost(error: BaseException) -> Rows:
    """Return the rows of a problem whose process died or hung."""
    return pd.DataFrame(failed(error), columns=["kind", "excess", "tolerance"])


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per check: how often made, how often beyond tolerance, the worst, and where."""
    checks = rows.fillna({"excess": np.inf})
    kinds = checks["kind"]
    excess = checks["excess"]
    beyond = excess > checks["tolerance"]
    highest = excess.groupby(kinds).idxmax()
    worst = checks.loc[highest].set_index("kind")
    columns = {
        "checked": kinds.value_counts(),
        "violations": beyond.groupby(kinds).sum(),
        "worst": worst["excess"],
        "problem": worst["problem"],
    }
    return pd.DataFrame(columns)


def main(
    problems: int = 2000,
    jobs: int = 1,
    output: Path = Path("results/relations"),
    quick: bool = False,
) -> None:
    """Check the relations on every problem, 20 at most if `quick`, and print the table."""
    if quick:
        problems = min(problems, 20)
    cells = {(seed,): partial(checked, seed) for seed in range(problems)}
    # Forking loaded solvers is not safe.
    compute = partial(apart, lost=lost, workers=jobs, timeout=TIMEOUT_S, start="spawn")
    summary = table(kept(output / "relations.csv", ["problem"], cells, compute))
    print(summary.to_string(float_format="{:.1e}".format))
