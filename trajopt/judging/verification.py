"""The exact judge: true peaks from polynomial roots, every miss, and the certified duration.

Nothing is sampled (docs/mathematics.md, sections 2 and 9). A trajectory whose misses and jumps are
within tolerance is repaired exactly, and the repaired one is judged. Every limit of the problem
computes its own worst use (`trajopt.core.limits`); this module names no kind of limit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from trajopt.core import dwell, polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import InvalidInput, InvalidTrajectory, WrongType, shown
from trajopt.core.limits import KINDS, Use
from trajopt.core.limits.limit import where
from trajopt.core.problem import Problem, check_problem
from trajopt.core.rounding import KEPT_RTOL, of_states
from trajopt.core.trajectory import EPS, Trajectory
from trajopt.judging.certificate import NEARLY_FEASIBLE_RTOL, Certificate, Tolerance, Worst
from trajopt.judging.passing import within_tolerance
from trajopt.judging.repair import by_joint, is_by_joint, is_repairable, repaired

_JUDGED = (
    *(*END_STATES, "least_times", "given_times", "least_duration", "duration"),
    *("dwell", "closed", "tolerance"),
)
GIVEN_RTOL = 1e-9  # a smaller difference from a segment's given time, relative, is rounding
BREAK_TIME_RTOL = 16 * EPS  # the rounding of a break's time, relative to the duration
# A smaller excess after the dilation of another limit, relative, is due to bounds of the use.
_AGAIN_RTOL = 1e-7
# Limits whose excess a dilation mends, whatever it is: they add no flaw.
MENDED = frozenset({"velocity", "acceleration", "jerk"})


def verify(
    problem: Problem,
    trajectory: Trajectory,
    tolerance: Tolerance | None = None,
    *,
    unjudged: Collection[str] = (),
    at_rest: bool = True,
) -> Certificate:
    """Judge a trajectory exactly against a problem.

    Args:
        problem: Of as many joints and waypoints as the trajectory has.
        trajectory: The motion.
        tolerance: The largest misses and jumps that are repaired.
        unjudged: Keys of limits that are not judged.
        at_rest: False for a motion that was cut out of a longer one: its ends may move. Then only
            its exact peaks are judged, without repair.

    Raises:
        WrongType: It is no `Trajectory`, or the first argument no `Problem`.
        InvalidTrajectory: The motion has another number of joints or waypoints than the problem.
    """
    check_sizes(problem, trajectory)
    own = _counted(problem)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        certificate, judged = _judged(
            own, trajectory, tolerance or Tolerance(), unjudged, at_rest=at_rest
        )
    slower = at_rest and certificate.valid and certificate.dilation > 1
    is_own = slower and not problem.route.dilatable
    return replace(
        certificate,
        motion=judged if is_own else None,
        judged=None if certificate.repair else judged,
    )


def flaws(problem: Problem, trajectory: Trajectory) -> tuple[str, ...]:
    """Return the flaws that `verify` finds: none if it certifies the motion.

    Where a dilation mends every limit, no peak adds a flaw. Then neither the peaks nor the repaired
    motion are computed: that takes a third of `verify`'s time. Nor is it judged whether these
    overflow.

    Args:
        problem: Of as many joints and waypoints as the trajectory has.
        trajectory: The motion.

    Raises:
        WrongType, InvalidTrajectory: As `verify` does.
    """
    mended = MENDED if problem.route.dilatable else frozenset[str]()
    if "dwell" in problem.demands or problem.limits.kinds.keys() - mended:
        return verify(problem, trajectory, unjudged=mended).flaws
    check_sizes(problem, trajectory)
    own = within_tolerance(_counted(problem), trajectory)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        allowed = _allowed(own, trajectory.duration, Tolerance())
        _, _, found = _missed(own, trajectory, allowed)
        found += _no_time(_least_times(own, trajectory))
        if not found and not is_repairable(own, trajectory):
            found.append(_NOT_REPAIRED)
        return (*found, *_other_times(own, trajectory))


def broken(problem: Problem, certificate: Certificate) -> list[str]:
    """Return the kinds of limits that a judged motion breaks as claimed, by their keys.

    An excess that is due to rounding and tolerances of solvers does not count.
    """
    allowed = _allowed(_counted(problem), certificate.duration, certificate.tolerance)
    found = []
    for key, use in certificate.uses.items():
        limit = problem.limits.kinds[key]
        within = limit.keeps(use, NEARLY_FEASIBLE_RTOL)
        if not within or limit.flaw(use, allowed.position_limit, problem):
            found.append(key)
    return found


def certified(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """Return the trajectory that has the certified duration; None where the given one has a flaw.

    Misses and jumps within tolerance are repaired. If it then breaks a limit it is dilated. Where
    the route begins or ends in motion, it is instead the fastest of the slower motions that
    `judging.slower` finds.
    """
    return verify(problem, trajectory).certified_motion


def hand_over(
    problem: Problem, motion: Trajectory, state: Sequence[Array]
) -> tuple[list[Worst], list[str]]:
    """Return the jumps where a motion takes over from another one, and a flaw for each too large.

    Args:
        problem: Of the motion's joints; its limits say which derivatives may jump.
        motion: The motion that takes over, at its time 0.
        state: Position, velocity and acceleration of the motion before at that time, SI units.

    Returns:
        The largest jump of each of them, and sentences about those that `verify` would not repair.
    """
    allowed = _allowed(problem, motion.duration, Tolerance())
    jumps, flaws = [], []
    for order, (before, own) in enumerate(zip(state, allowed.jumps, strict=True)):
        size = np.abs(motion(0.0, order) - before)
        finite = np.where(np.isfinite(own), own, np.finfo(float).max)
        worst, excess = worst_of(size[None], finite, np.zeros(1), order)
        jumps.append(worst)
        if excess > 1:
            flaws.append(_say(problem, worst, f"{_JUMP_WORDS[order][:-3]} at the hand-over by"))
    return jumps, flaws


def _counted(problem: Problem) -> Problem:
    """Return the problem whose segments between equal waypoints have the next segment's limits.

    Such a segment takes no time, and its own limits have no effect (`Problem.merged`). With a
    tolerance, waypoints that differ may be passed at one instant; these limits do count.
    """
    if problem.limits.segments is None:
        return problem
    merged, index = problem.merged()
    if merged is problem:
        return problem
    (moving,) = np.nonzero(np.diff(index))
    numbers = moving[np.minimum(index[:-1], len(moving) - 1)]
    return replace(problem, limits=problem.limits.of_segments(numbers))


def _together(
    problem: Problem, motion: Trajectory, dilation: float, unjudged: Collection[str]
) -> tuple[float, list[str]]:
    """Return the least dilation from this one on that brings a motion within all its limits.

    A limit that a slower motion may break again is judged anew after the dilation that the others
    need. A larger one keeps those. The second value says why there is none.
    """
    again = [
        limit
        for key, limit in problem.limits.kinds.items()
        if key not in unjudged and not limit.monotone
    ]
    before = 0.0
    while again and 1 < dilation != before:
        before = dilation
        for limit in again:
            slower = motion.dilated(dilation)
            use = limit.worst(slower)
            if not limit.keeps(use, _AGAIN_RTOL):
                dilation *= limit.dilation(use, slower)
                if np.isinf(dilation):
                    return dilation, [limit.hopeless(use, slower, problem)]
    return dilation, []


def check_sizes(problem: Problem, trajectory: Trajectory) -> None:
    check_problem(problem)
    for key in problem.demands:
        if key not in _JUDGED:
            raise InvalidInput(
                key, "this left out: it is not judged yet", value=problem.demands[key]
            )
    if not isinstance(trajectory, Trajectory):
        raise WrongType(
            f"expected a trajopt.Trajectory, got {shown(trajectory)}: `judge` takes SciPy's "
            "splines, and Trajectory.from_ppoly(spline, waypoint_times) makes one"
        )
    if fits(problem, trajectory):
        return
    if trajectory.joints != problem.joints:
        raise InvalidTrajectory(f"{trajectory.joints} joints; the problem has {problem.joints}")
    given = len(trajectory.waypoint_times)
    needed = len(problem.waypoints)
    raise InvalidTrajectory(
        f"{given} waypoint times; the problem has {needed} waypoints: give waypoint_times, "
        "or let `judge` find them"
    )


def fits(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether a motion has as many joints and waypoints as a problem."""
    count = len(trajectory.waypoint_times)
    return trajectory.joints == problem.joints and count == len(problem.waypoints)


def _judged(
    problem: Problem,
    trajectory: Trajectory,
    tolerance: Tolerance,
    unjudged: Collection[str] = (),
    *,
    at_rest: bool = True,
    begins: float | None = None,
) -> tuple[Certificate, Trajectory]:
    """Return the certificate, and the trajectory that was judged: repaired, if possible.

    Where the route cannot be dilated, it is the motion that has the certified duration. Of a motion
    that is judged joint by joint it is the given one. Times in flaws are counted from `begins`, s,
    earlier than the trajectory's start, for a part of a motion.
    """
    is_part, begins = begins is not None, begins or 0.0
    problem = within_tolerance(problem, trajectory)
    if at_rest and "dwell" in problem.demands:
        return _judged_in_parts(problem, trajectory, tolerance, unjudged)
    allowed = _allowed(problem, trajectory.duration, tolerance)
    waypoint, continuity, flaws = _missed(problem, trajectory, allowed, begins, at_rest=at_rest)
    judged, repair, ratios = trajectory, None, None
    is_repaired = False
    if at_rest and not flaws and not is_part and _is_separate(problem, trajectory, unjudged):
        ratios = _by_joint(problem, trajectory, unjudged)
        is_repaired = ratios is not None
        repair = partial(repaired, problem, trajectory) if is_repaired else None
    elif at_rest and not flaws:
        made = repaired(problem, trajectory)
        is_repaired = made is not None
        judged = made or trajectory
    uses = {}
    dilation = 0.0
    overflowing = False
    for key, limit in problem.limits.kinds.items():
        if key in unjudged:
            continue
        if ratios is not None and limit.is_ratio:
            use = ratios[key]
        else:
            use = problem.limits.worst(key, judged if limit.is_ratio else trajectory)
        uses[key] = use
        needed = limit.dilation(use, judged)
        dilation = float(np.maximum(dilation, needed))  # NaN stays NaN
        later = use._replace(time=use.time + begins)
        flaw = limit.flaw(later, allowed.position_limit, problem)
        if not flaw and limit.is_ratio and np.isfinite(use.value) and np.isinf(needed):
            flaw = limit.hopeless(later, judged, problem)
        if flaw:
            flaws.insert(0, flaw)
        elif not np.isfinite(needed * judged.duration):
            overflowing = True
    least = _least_times(problem, trajectory) if at_rest else None
    if least is not None:
        dilation = max(dilation, least.value)
    if not flaws:
        dilation, hopeless = _together(problem, judged, dilation, unjudged)
        flaws += hopeless
    flaws += _no_time(least, begins)
    if at_rest and not flaws and not is_repaired:
        flaws.append(_NOT_REPAIRED)
    if overflowing:
        flaws.append("its peaks are not finite numbers")
    if at_rest:
        flaws += _other_times(problem, trajectory, begins)
    rounded = None
    if not problem.route.dilatable and at_rest and not flaws:
        if dilation > 1 + KEPT_RTOL:
            rounded = _missed_as_returned(problem, trajectory, unjudged)
        if rounded is not None:
            judged, repair = trajectory, None
            uses = {key: problem.limits.worst(key, judged) for key in uses}
        if dilation <= 1 + KEPT_RTOL or rounded is not None:
            dilation = 1.0
        else:
            from trajopt.judging.slower import slower  # late: it needs parts of SciPy

            if repair:
                judged, repair = repair() or trajectory, None
            if _is_timed(problem):
                found = _rounded_outwards(problem, judged, dilation)
            else:
                found = slower(problem, judged, lambda own: keeping(problem, own, unjudged))
            if found is None:
                flaws.append(_not_slower(problem, uses, judged))
            else:
                dilation, judged = found
    certificate = Certificate(
        duration=trajectory.duration,
        dilation=dilation,
        uses=uses,
        waypoint=waypoint,
        continuity=continuity,
        flaws=tuple(flaws),
        tolerance=tolerance,
        least_times=least,
        rounded=rounded,
        repair=repair,
    )
    return certificate, judged


def _is_separate(problem: Problem, trajectory: Trajectory, unjudged: Collection[str]) -> bool:
    """Return whether a motion is judged joint by joint: it is long, and no limit couples them.

    Nor does a limit need the whole motion for its dilation, which is a power of its worst use.
    """
    limits = [limit for key, limit in problem.limits.kinds.items() if key not in unjudged]
    by_use = all(limit.degree is not None for limit in limits if limit.is_ratio)
    alone = all(limit.separate and limit.monotone for limit in limits)
    return by_use and alone and is_by_joint(problem, trajectory)


def _by_joint(
    problem: Problem, trajectory: Trajectory, unjudged: Collection[str]
) -> dict[str, Use] | None:
    """Return the worst uses that are ratios by the repaired motion, of which one joint is held.

    Where the uses of several joints are equal, the earliest counts.

    Args:
        problem: Its limits are of each joint by itself.
        trajectory: The motion, without flaws so far.
        unjudged: Keys of limits that are not judged.

    Returns:
        The uses by key; None where the motion cannot be repaired.
    """

    def of_joint(joint: int, motion: Trajectory) -> dict[str, Use]:
        limits = problem.limits.only([joint])
        uses = {
            key: limits.worst(key, motion)
            for key, limit in limits.kinds.items()
            if limit.is_ratio and key not in unjudged
        }
        return {
            key: use if use.joint is None else use._replace(joint=joint)
            for key, use in uses.items()
        }

    each = by_joint(problem, trajectory, of_joint)
    if each is None:
        return None
    keys = dict.fromkeys(key for uses in each for key in uses)
    return {
        key: max((uses[key] for uses in each if key in uses), key=_first_of_the_worst)
        for key in keys
    }


def _first_of_the_worst(use: Use) -> tuple[bool, float, float]:
    return bool(np.isnan(use.value)), use.value, -use.time


def _missed(
    problem: Problem,
    trajectory: Trajectory,
    allowed: Allowed,
    begins: float = 0.0,
    *,
    at_rest: bool = True,
) -> tuple[Worst, Worst, list[str]]:
    """Return the worst miss of a waypoint, the worst jump, and a flaw for each that is too large.

    If `at_rest`, jumps at the ends count; times in flaws are counted from `begins`, s, earlier.
    """
    waypoint, missed = _worst_miss(problem, trajectory, allowed.waypoint)
    jumps = []
    for order, jump in enumerate(allowed.jumps):
        jumps.append(_worst_jump(problem, trajectory, order, jump, at_rest))
    continuity, _ = max(jumps, key=lambda jump: jump[1])
    blurred, blur = _worst_blur(trajectory, allowed.blur)
    flaws = []
    if missed > 1:
        flaws.append(_say(problem, waypoint, "misses the waypoint by", begins))
    for worst, excess in jumps:
        if excess > 1:
            flaws.append(_say(problem, worst, _JUMP_WORDS[worst.order], begins))
    if blur > 1:
        flaws.append(_say(problem, blurred, "terms cancel, which rounds the position by", begins))
    return waypoint, continuity, flaws


def _rounded_outwards(
    problem: Problem, motion: Trajectory, dilation: float
) -> tuple[float, Trajectory] | None:
    """Return the dilation and the dilated motion, if its times are the given ones to rounding."""
    if not problem.route.at_rest or not dilation <= 1 + GIVEN_RTOL:
        return None
    slower = motion.dilated(dilation)
    return None if _other_times(problem, slower) else (dilation, slower)


def _missed_as_returned(
    problem: Problem, trajectory: Trajectory, unjudged: Collection[str]
) -> float | None:
    """Return by how many roundings a motion misses a place or a state, if it needs no repair.

    The states of a problem are known to their rounding (`trajopt.core.rounding`). A motion that
    misses them by no more, and keeps every limit, is a motion of the problem. A repair moves it
    onto the numbers as they are written; a segment that is possible at one instant alone then
    exceeds a limit. Jumps within the motion are added up, so that many pieces gain nothing.

    Returns:
        The largest miss over its rounding, at most 1; None where the motion misses by more, or
        exceeds a limit by more than rounding.
    """
    known = of_states(problem)
    for key, limit in problem.limits.kinds.items():
        if key in unjudged:
            continue
        use = problem.limits.worst(key, trajectory)
        if limit.flaw(use, known.position, problem) or not limit.keeps(use, KEPT_RTOL):
            return None
    least = _least_times(problem, trajectory)
    if least is not None and not least.value <= 1 + KEPT_RTOL:
        return None
    missed = np.abs(trajectory(trajectory.waypoint_times) - problem.waypoints) / known.position
    worst = float(missed.max())
    smooth = problem.limits.smooth
    for order, rounding in enumerate(known):
        jumps = _jumps(problem, trajectory, order, at_rest=True) / rounding
        worst = max(worst, float(jumps.sum(axis=0)[order <= smooth].max(initial=0.0)))
    return worst if worst <= 1 else None


def keeping(
    problem: Problem, trajectory: Trajectory, unjudged: Collection[str] = ()
) -> Trajectory | None:
    """Return the repaired motion if it keeps every limit up to rounding; else None."""
    problem = within_tolerance(problem, trajectory)
    motion = repaired(problem, trajectory)
    if motion is None:
        return None
    allowed = _allowed(problem, motion.duration, Tolerance()).position_limit
    for key, limit in problem.limits.kinds.items():
        if key in unjudged:
            continue
        use = problem.limits.worst(key, motion)
        if limit.flaw(use, allowed, problem) or not limit.keeps(use, KEPT_RTOL):
            return None
    least = _least_times(problem, motion)
    return motion if least is None or least.value <= 1 + KEPT_RTOL else None


def keeps(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether a motion keeps every limit up to rounding, repaired or as it is returned."""
    if keeping(problem, trajectory) is not None:
        return True
    return _missed_as_returned(within_tolerance(problem, trajectory), trajectory, ()) is not None


def _not_slower(problem: Problem, uses: Mapping[str, Use], motion: Trajectory) -> str:
    """Return the flaw of a motion that breaks a limit, if no slower one is found."""
    kinds = problem.limits.kinds
    key = max(uses, key=lambda key: kinds[key].dilation(uses[key], motion))
    use = uses[key]
    if _is_timed(problem):
        amount = KINDS[key].amount(use, problem)
        return f"{where(use, problem)}: {KINDS[key].name()} {amount}, and the times are given"
    ends = [name for name in ("start", "end") if any(map(np.any, getattr(problem.route, name)))]
    return (
        f"{where(use, problem)}: {KINDS[key].name()} {KINDS[key].amount(use, problem)}, and no "
        f"slower motion was found that keeps the {' and '.join(ends)} velocity"
    )


def _is_timed(problem: Problem) -> bool:
    """Return whether the problem says how long the motion takes, exactly."""
    return "given_times" in problem.demands or "duration" in problem.demands


def _no_time(least: Use | None, begins: float = 0.0) -> list[str]:
    """Return a flaw if a segment with a least time takes none."""
    if least is None or np.isfinite(least.value):
        return []
    return [f"a segment with a least time takes none, at {least.time + begins:.6g} s"]


def _other_times(problem: Problem, trajectory: Trajectory, begins: float = 0.0) -> list[str]:
    """Return a flaw about the time that differs most from the one that is given, if any does."""
    asked = float(problem.route.demand("duration"))
    if asked and abs(trajectory.duration / asked - 1) > GIVEN_RTOL:
        return [f"it takes {trajectory.duration:.6g} s, {asked:.6g} s are asked for"]
    if "given_times" not in problem.demands:
        return []
    given = problem.demands["given_times"]
    taken = np.diff(trajectory.waypoint_times)
    worst = int(np.abs(taken / given - 1).argmax())
    if abs(taken[worst] / given[worst] - 1) <= GIVEN_RTOL:
        return []
    at = trajectory.waypoint_times[worst] + begins
    return [f"at {at:.6g} s: a segment takes {taken[worst]:.6g} s, {given[worst]:.6g} s are given"]


def _least_times(problem: Problem, trajectory: Trajectory) -> Use | None:
    """Return the largest ratio of a least time, of a segment or the whole, to the time taken."""
    found = []
    if "least_duration" in problem.demands:
        share = float(problem.demands["least_duration"]) / trajectory.duration
        found.append(Use(share, None, 0.0))
    if "least_times" in problem.demands:
        least = problem.demands["least_times"]
        shares = np.where(least > 0, least / np.diff(trajectory.waypoint_times), 0.0)
        worst = int(shares.argmax())
        found.append(Use(float(shares[worst]), None, float(trajectory.waypoint_times[worst])))
    return max(found, key=lambda use: use.value, default=None)


def _judged_in_parts(
    problem: Problem, trajectory: Trajectory, tolerance: Tolerance, unjudged: Collection[str]
) -> tuple[Certificate, Trajectory]:
    """Return the certificate of a motion with waits, made of those of its parts.

    A dilation also makes the waits longer, which is allowed. Where the route begins or ends in
    motion, each part is slowed down by itself.
    """
    allowed = _allowed(problem, trajectory.duration, tolerance)
    parts = dwell.cut(problem, trajectory)
    if parts is None:
        whole = replace(problem, demands={})
        certificate, _ = _judged(whole, trajectory, tolerance, unjudged)
        flaw = "it waits so long at a waypoint that no time is left before the next"
        return replace(certificate, flaws=(flaw, *certificate.flaws)), trajectory
    flaws = []
    for rest in dwell.rests(problem, trajectory):
        away, excess = _worst_leave(problem, rest, allowed.waypoint)
        if excess > 1:
            said = f"leaves waypoint {rest.first + 1} during its wait by"
            flaws.append(_say(problem, away, said))
    is_still = not flaws
    found = []
    motions = []
    for own, part in zip(dwell.parts(problem), parts, strict=True):
        certificate, judged = _judged(own, part.motion, tolerance, unjudged, begins=part.begins)
        found.append(_later(certificate, part.begins))
        motions.append(judged)
        if is_still:
            flaws += certificate.flaws
        if certificate.valid and not problem.route.dilatable and own.route.dilatable:
            motions[-1] = judged.dilated(max(1.0, certificate.dilation))
    motion = dwell.joined(problem, motions)
    dilation = float(np.max([own.dilation for own in found]))
    if not problem.route.dilatable and dilation > 1:
        dilation = motion.duration / trajectory.duration
    uses = {
        key: max((own.uses[key] for own in found), key=lambda use: use.value)
        for key in found[0].uses
    }
    least = [own.least_times for own in found if own.least_times is not None]
    of_whole = _least_times(problem.without("least_times"), motion)
    if of_whole is not None:
        least.append(of_whole)
        dilation = max(dilation, of_whole.value)
    flaws += _other_times(problem.without("given_times"), motion)
    certificate = Certificate(
        duration=trajectory.duration,
        dilation=dilation,
        uses=uses,
        waypoint=max((own.waypoint for own in found), key=lambda worst: worst.value),
        continuity=max((own.continuity for own in found), key=lambda worst: worst.value),
        flaws=tuple(flaws),
        tolerance=tolerance,
        least_times=max(least, key=lambda use: use.value, default=None),
        rounded=max((own.rounded for own in found if own.rounded is not None), default=None),
    )
    return certificate, motion


def _later(certificate: Certificate, begins: float) -> Certificate:
    """Return a part's certificate with times counted from the start of the whole motion."""
    at = certificate.least_times
    return replace(
        certificate,
        uses={key: use._replace(time=use.time + begins) for key, use in certificate.uses.items()},
        waypoint=replace(certificate.waypoint, time=certificate.waypoint.time + begins),
        continuity=replace(certificate.continuity, time=certificate.continuity.time + begins),
        least_times=at and at._replace(time=at.time + begins),
    )


def _worst_leave(problem: Problem, rest: dwell.Part, allowed: Array) -> tuple[Worst, float]:
    """Return how far a motion leaves the waypoint of a wait, and its ratio to the allowed miss."""
    away = np.array(rest.motion.pieces())
    away[-1] -= problem.waypoints[rest.first]
    flat = away.reshape(len(away), -1)
    points = polynomials.critical_points(flat)
    values = np.abs(polynomials.evaluate(flat[:, None], points)).max(axis=0)
    errors = values.reshape(away.shape[1:])
    return worst_of(errors, allowed, rest.begins + rest.motion.breaks)


@dataclass(frozen=True)
class Allowed:
    """The largest errors of each joint that are repaired, `(…, joints)` each.

    Attributes:
        waypoint: miss of a waypoint, rad.
        position_limit: excess over a position limit, rad.
        blur: rounding of the position from terms that cancel, rad.
        jumps: of position, velocity and acceleration: rad, rad/s, rad/s².
    """

    waypoint: Array
    position_limit: Array
    blur: Array
    jumps: tuple[Array, Array, Array]


def _allowed(problem: Problem, duration: float, tolerance: Tolerance) -> Allowed:
    limits = problem.limits.in_all_segments()
    sizes = (np.abs(own).min(axis=1) for own in (limits.velocity, limits.acceleration, limits.jerk))
    return allowed_errors(
        *sizes,
        smooth=limits.smooth,
        largest=problem.largest_displacements,
        coordinates=problem.rounding,
        duration=duration,
        tolerance=tolerance,
    )


def allowed_errors(
    V: Array,
    A: Array,
    J: Array,
    *,
    smooth: Indices,
    largest: Array,
    coordinates: Array,
    duration: Array | float,
    tolerance: Tolerance,
) -> Allowed:
    """Return the largest errors that are repaired, of one motion or of several.

    Args:
        V: The smaller side of the velocity limit, `(joints,)` or `(motions, joints)`, as all that
            follows: of the acceleration limit `A`, of the jerk limit `J`.
        smooth: The highest derivative that must be continuous.
        largest: Displacement, rad.
        coordinates: Rounding of the waypoints, rad.
        duration: s; `(motions, 1)`.
        tolerance: The largest misses and jumps that are repaired.
    """
    reached_velocity = np.minimum(V, np.sqrt(A * largest))
    root = np.cbrt(J)
    from_jerk = root**2 * np.cbrt(largest)
    reached_acceleration = np.minimum(A, from_jerk)
    # Breaks are rounded. Each derivative may change by its own rate during that time.
    rounded = BREAK_TIME_RTOL * duration
    position_jump = tolerance.position * largest + coordinates + rounded * V
    velocity_jump = tolerance.jump * reached_velocity + rounded * A
    acceleration_jump = tolerance.jump * reached_acceleration + rounded * J
    acceleration_jump = np.where(smooth >= 2, acceleration_jump, np.inf)
    bridge = tolerance.bridge
    return Allowed(
        waypoint=tolerance.position * largest + coordinates,
        position_limit=tolerance.position_limit * largest + coordinates,
        blur=tolerance.position * largest + 4 * coordinates,
        jumps=(
            np.maximum(position_jump, bridge * V),
            np.maximum(velocity_jump, bridge * A),
            np.maximum(acceleration_jump, bridge * J),
        ),
    )


def _worst_miss(problem: Problem, trajectory: Trajectory, allowed: Array) -> tuple[Worst, float]:
    """Return the worst miss of a waypoint, and its ratio to the allowed miss."""
    passed = trajectory(trajectory.waypoint_times)
    errors = np.abs(passed - problem.waypoints)
    return worst_of(errors, allowed, trajectory.waypoint_times)


def _worst_jump(
    problem: Problem, trajectory: Trajectory, order: int, allowed: Array, at_rest: bool
) -> tuple[Worst, float]:
    """Return the worst jump of a derivative at a break, and its ratio to the allowed jump.

    If `at_rest`, the robot is at its first and last waypoint before and after the motion, in the
    states that the route demands. A closed motion is continued by itself.
    """
    return _worst_in(_jumps_in_blocks(problem, trajectory, order, at_rest), allowed, order)


def _jumps(problem: Problem, trajectory: Trajectory, order: int, at_rest: bool) -> Array:
    """Return the jumps of a derivative at the breaks, `(breaks, joints)`; see `_worst_jump`."""
    blocks = _jumps_in_blocks(problem, trajectory, order, at_rest)
    return np.concatenate([jumps for jumps, _ in blocks])


def _jumps_in_blocks(
    problem: Problem, trajectory: Trajectory, order: int, at_rest: bool
) -> Iterator[tuple[Array, Array]]:
    """Yield the jumps at the breaks, `(breaks, joints)`, with their times; see `_worst_jump`."""
    route = problem.route
    first, last = problem.waypoints[[0, -1]]
    if order > 0:
        first, last = route.start[order - 1], route.end[order - 1]
    blocks = list(trajectory.blocks())
    start = trajectory.pieces(order, blocks[0])[-1, 0]
    stop = trajectory.pieces(order, blocks[-1]).sum(axis=0)[-1]
    if order > 0 and "closed" in route.demands:
        first, last = stop, start
    if not at_rest:
        first, last = start, stop
    before = first[None]
    for some in blocks:
        unit = trajectory.pieces(order, some)
        stops = np.concatenate([before, unit.sum(axis=0)])
        before = stops[-1:]
        yield np.abs(unit[-1] - stops[:-1]), trajectory.breaks[some]
    yield np.abs(last - before), trajectory.breaks[-1:]


def _worst_blur(trajectory: Trajectory, allowed: Array) -> tuple[Worst, float]:
    """Return the largest rounding of a joint's position, and its ratio to the allowed one."""
    blurs = (
        (polynomials.evaluation_rounding(trajectory.pieces(0, some)), trajectory.breaks[some])
        for some in trajectory.blocks()
    )
    return _worst_in(blurs, allowed)


def _worst_in(
    blocks: Iterable[tuple[Array, Array]], allowed: Array, order: int = 0
) -> tuple[Worst, float]:
    """Return what `worst_of` does, of errors and their times in blocks: the first of the worst."""
    each = [worst_of(errors, allowed, times, order) for errors, times in blocks]
    return max(each, key=lambda own: (own[1], np.isnan(own[0].value)))


def worst_of(errors: Array, allowed: Array, times: Array, order: int = 0) -> tuple[Worst, float]:
    """Return the error with the largest ratio to the allowed one, and that ratio.

    An error that is NaN has an infinite ratio (`argmax` finds it).

    Args:
        errors: `(times, joints)`.
        allowed: `(joints,)`.
        times: of the errors, s, `(times,)`.
        order: of the derivative.
    """
    excess = errors / allowed
    row, joint = np.unravel_index(np.argmax(excess), excess.shape)
    worst = Worst(
        value=float(errors[row, joint]), joint=int(joint), time=float(times[row]), order=order
    )
    ratio = float(excess[row, joint])
    return worst, np.inf if np.isnan(ratio) else ratio


_NOT_REPAIRED = "it passes different waypoints at one instant, or its numbers overflow"
_JUMP_WORDS = ("position jumps by", "velocity jumps by", "acceleration jumps by")


def _say(problem: Problem, worst: Worst, what: str, begins: float = 0.0) -> str:
    unit = problem.unit(worst.joint, worst.order)
    label = problem.joint_labels[worst.joint]
    where = f"{label} at {worst.time + begins:.6g} s"
    return f"{where}: {what} {worst.value:.3g} {unit}"
