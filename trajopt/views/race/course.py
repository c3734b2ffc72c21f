"""What a race shows: sampled motions, the use of every limit, link frames, and the best view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.core.arrays import Array
from trajopt.core.chain import LinkChain
from trajopt.core.demand import DEMANDS
from trajopt.core.limits import Limit
from trajopt.core.limits.joint_limit import JointLimit
from trajopt.core.numerals import rounded_down
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.explain.active_limits import share_at_limits
from trajopt.views import table_cells
from trajopt.views.figures.shown_motion import ShownMotion
from trajopt.views.figures.style import BLACK, CURVES, places

TICK_S = 1e-4  # of times
STEP = 1e-4  # of positions, rad (m)
EVENLY = 160  # samples of a motion, beside those where something happens
MAX_BREAKS = 150  # more are not sampled one by one
_BESIDE_RTOL = 1e-9  # of the time before a break, relative to the duration
_BROKEN = 1 + 1e-3  # use of a limit above which it is said to be broken
_RESTING = 1e-6  # share of the velocity limits below which an arm stands at a waypoint
_ELEVATION = 0.3  # rad, from which the arm is seen
_AZIMUTHS = np.deg2rad(np.arange(0, 360, 15))
_BORDER = 0.06  # of the picture's larger side
_SMALL = 1e-3  # m: shorter links have no corner of their own


class Goal(NamedTuple):
    """What durations are compared with.

    Attributes:
        duration: s.
        name: In a sentence, behind "above".
        said: A sentence about it, which says what is proved.
    """

    duration: float
    name: str
    said: str


def goal(problem: Problem, motions: Sequence[ShownMotion]) -> Goal:
    """Return the best known motion's duration where one is recorded, else the shortest of these."""
    record = records.find(problem)
    if record is not None and record.closed:
        bound = rounded_down(record.lower_bound, ".4f")
        said = f"No motion takes less than {bound} s: that is proved."
        return Goal(record.duration, "the optimum", said)
    if record is not None:
        said = f"The best known motion takes {record.duration:.4f} s; nobody proved it to be best."
        return Goal(record.duration, "the best known", said)
    within = [motion for motion in motions if most_used(problem, motion.trajectory) <= _BROKEN]
    shortest = min(within or motions, key=lambda motion: motion.trajectory.duration)
    duration = shortest.trajectory.duration
    said = f"The shortest of these within the limits takes {duration:.4f} s."
    return Goal(duration, "the shortest here", said if within else "All of these break a limit.")


def most_used(problem: Problem, motion: Trajectory) -> float:
    """Return the largest use of a limit that is a ratio, 1 at the limit."""
    kinds = problem.limits.kinds.values()
    return max(limit.worst(motion).value for limit in kinds if limit.is_ratio)


def why(problem: Problem, shown: ShownMotion) -> str:
    """Say how long a motion is at a limit, whether it was slowed down, and where it stops.

    Of a motion that breaks a limit only that is said.
    """
    motion = shown.trajectory
    most = most_used(problem, motion)
    if most > _BROKEN:
        return f"It breaks a limit: it uses {100 * most:.0f}\N{NO-BREAK SPACE}% of it."
    share = 100 * share_at_limits(problem, motion)
    used = f"A joint is at a limit {share:.0f}\N{NO-BREAK SPACE}% of the time."
    if table_cells.dilation(shown.slowed) != table_cells.MISSING:
        used = f"Slowed down {shown.slowed:.3g} times: as planned it breaks a limit. {used}"
    inner = motion.waypoint_times[1:-1]
    fastest = problem.limits.in_all_segments(tightest=False).velocity.max(axis=1)
    stops = int((np.abs(motion(inner, 1)) < _RESTING * fastest).all(axis=1).sum())
    if not stops:
        return used
    return f"{used} It stops at {stops} of {len(inner)} waypoints on the way."


def colour(motion: ShownMotion, motions: Sequence[ShownMotion]) -> str:
    """Return a motion's colour, as in every figure; black is the page's own ink."""
    colour = CURVES[places([each.planner for each in motions])[motion.planner] % len(CURVES)]
    return "currentColor" if colour == BLACK else colour


def data(problem: Problem, motions: Sequence[ShownMotion], goal: Goal) -> dict[str, Any]:
    """Return what the script needs, ready for JSON; joints count from 0.

    Times, positions and uses are written as differences of neighbours, in whole steps: that is
    short, since most differences are small.
    """
    chain = catalogue.chain(problem)
    limits = list(_shown(problem, motions[0].trajectory))
    runs = [_run(motion, limits) for motion in motions]
    sampled = [
        np.array(problem.waypoints),
        *(motion.trajectory(_even(motion)) for motion in motions),
    ]
    return {
        "names": list(problem.joint_labels),
        "waypoints": problem.waypoints,
        "chain": None if chain is None else _links(chain, np.concatenate(sampled), problem),
        "kinds": [
            {
                "name": limit.name(),
                "ratio": limit.is_ratio,
                "joints": [-1 if joint is None else joint for joint in joints],
            }
            for limit, joints in limits
        ],
        **_checked(problem, [limit for limit, _ in limits]),
        "tick": TICK_S,
        "step": STEP,
        "goal": {"duration": goal.duration, "name": goal.name},
        "motions": runs,
    }


def _shown(problem: Problem, motion: Trajectory) -> Iterator[tuple[Limit, list[int | None]]]:
    """Yield the limits that have a use, and the joints that they bound."""
    for limit in problem.limits.kinds.values():
        joints = list(limit.along(motion, np.zeros(1)))
        if joints:
            yield limit, joints


def _checked(problem: Problem, limits: Sequence[Limit]) -> dict[str, Any]:
    """Return what a page needs to check somebody's motion, and what it cannot check.

    The page checks limits of single joints that are the same in all segments, continuity, and rest
    at both ends.
    """
    simple: list[dict[str, Any]] = []
    known = set()
    for kind, limit in enumerate(limits):
        if isinstance(limit, JointLimit) and limit.segments is None:
            known.add(limit.key)
            simple.append(
                {"kind": kind, "order": limit.order, "ratio": limit.is_ratio, "pairs": limit.pairs}
            )
    kinds = problem.limits.kinds.items()
    left_out = [f"{limit.name()} limits" for key, limit in kinds if key not in known]
    return {
        "problem": problem.name,
        "bounds": simple,
        "smooth": max(limit.smooth for limit in problem.limits.kinds.values()),
        "left_out": [*left_out, *(DEMANDS[key].name for key in problem.demands)],
        "units": [problem.unit(joint) for joint in range(problem.joints)],
    }


def _even(motion: ShownMotion) -> Array:
    return np.linspace(0.0, motion.trajectory.duration, EVENLY)


def _run(motion: ShownMotion, limits: Sequence[tuple[Limit, list[int | None]]]) -> dict[str, Any]:
    trajectory = motion.trajectory
    times = sample_times(trajectory, [limit for limit, _ in limits])
    uses = []
    for limit, joints in limits:
        along = limit.along(trajectory, times)
        for joint in joints:
            # a place in a range is 1/2 in its middle, which uses nothing of it
            share = along[joint] if limit.is_ratio else 2 * along[joint] - 1
            uses.append(np.round(100 * share))
    return {
        "name": motion.name,
        "duration": trajectory.duration,
        "passed": trajectory.waypoint_times,
        "t": _differences(np.round(times / TICK_S)),
        "q": [_differences(row) for row in np.round(trajectory(times) / STEP).T],
        "u": [_differences(np.clip(use, 0, 999)) for use in uses],
    }


def sample_times(motion: Trajectory, limits: Sequence[Limit]) -> Array:
    """Return times, s, between which a page may draw positions and uses as straight lines.

    They are evenly spaced. Both sides of each break are added, since a use may jump there, and the
    waypoints, and the time of each limit's worst use.
    """
    edges = motion.waypoint_times
    if len(motion.breaks) <= MAX_BREAKS:
        edges = np.concatenate([motion.breaks, edges])
    before = edges - _BESIDE_RTOL * motion.duration
    worst = [limit.worst(motion).time for limit in limits]
    even = np.linspace(0.0, motion.duration, EVENLY)
    return np.unique(np.clip(np.concatenate([even, edges, before, worst]), 0, motion.duration))


def _differences(values: Array) -> list[int]:
    return np.diff(values, prepend=0.0).astype(int).tolist()


def _links(chain: LinkChain, postures: Array, problem: Problem) -> dict[str, Any]:
    """Return link frames, and the view from the side on which the waypoints are farthest apart."""
    corners = [_corner(*joint) for joint in zip(chain.origins, chain.axes, strict=True)]
    found = points(chain, postures)
    at_waypoints = points(chain, problem.waypoints)
    view = max(map(_view, _AZIMUTHS), key=lambda axes: _shown_travel(at_waypoints @ axes.T))
    ground = min(0.0, float(found[..., 2].min()))
    seen = np.append(found.reshape(-1, 3), [[0, 0, ground]], axis=0) @ view.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    border = _BORDER * (high - low).max()
    return {
        "origins": np.round(chain.origins[:, :3].reshape(-1, 12), 7),
        "corners": [None if corner is None else np.round(corner, 5) for corner in corners],
        "axes": np.round(chain.axes, 7),
        "slides": chain.slides,
        "tool": np.round(chain.tool[:3].ravel(), 7),
        "ground": round(ground, 4),
        "view": np.round(view, 6),
        "box": np.round([*(low - border), *(high + border)], 4),
    }


def points(chain: LinkChain, postures: Array) -> Array:
    """Return joints, tool and corners of an arm, m, `(postures, 2 joints + 1, 3)`."""
    frames = chain.frames(postures)
    before = np.concatenate([np.broadcast_to(np.eye(4), frames[:, :1].shape), frames], axis=1)
    found = [frames[..., :3, 3]]
    for joint, (origin, axis) in enumerate(zip(chain.origins, chain.axes, strict=True)):
        corner = np.append(np.zeros(3) if (place := _corner(origin, axis)) is None else place, 1.0)
        found.append((before[:, joint] @ corner)[:, None, :3])
    return np.concatenate(found, axis=1)


def _corner(origin: Array, axis: Array) -> Array | None:
    """Return where a link turns: across the next joint's axis first, then along it; m."""
    along = origin[:3, :3] @ axis
    shift = origin[:3, 3]
    part = (shift @ along) * along
    small = min(np.linalg.norm(part), np.linalg.norm(shift - part)) < _SMALL
    return None if small else shift - part


def _view(azimuth: float) -> Array:
    """Return the directions to the right and down of a picture, `(2, 3)`, seen from outside."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    ce, se = np.cos(_ELEVATION), np.sin(_ELEVATION)
    return np.array([[-s, c, 0.0], [c * se, s * se, -ce]])


def _shown_travel(seen: Array) -> tuple[bool, float]:
    """Return whether the arm reaches to the right, and how far it is seen to move."""
    moved = np.linalg.norm(np.diff(seen, axis=0), axis=-1).sum()
    return bool(seen[..., 0].mean() > 0), float(moved)
