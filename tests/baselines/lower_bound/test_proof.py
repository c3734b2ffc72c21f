"""The rows hold for verified trajectories, and a proof is believed for what it proves."""

from dataclasses import replace

import numpy as np
import pytest
import ruckig
from work import HANG_S

from baselines.exact.jerk import ExactJerk
from baselines.lower_bound import costates, extremal
from baselines.lower_bound.bound import prove
from baselines.lower_bound.branching import branch_and_bound
from baselines.lower_bound.dual_check import LOWER, RAISE, BoundProof, cuts, proved_bound
from baselines.lower_bound.incumbent import incumbent
from baselines.lower_bound.jerk_rows import Ramp, SquareTangent, ramp_row, square_rows
from baselines.lower_bound.planner import Prove
from baselines.lower_bound.relaxation import Relaxation, VariableBounds
from baselines.lower_bound.row_pool import RowPool, Tangent
from baselines.ruckig_ import RuckigStop, RuckigVia
from trajopt import InvalidInput, Limits, Problem
from trajopt.benchmark.store import folder
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.trial import trials_of
from trajopt.judging.verification import certified, verify
from trajopt.planners.rest_to_rest import stop_times


def never() -> bool:
    """A time limit that is not reached."""
    return False


def limited_problem(seed, *, jerk=True, walls=False, waypoints=4, joints=2, one_sided=False):
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-1, 1, (waypoints, joints))
    signs = [-1, 1]
    jerks = rng.uniform(4, 40, (joints, 2)) * signs if jerk else None
    if one_sided:
        jerks[0, 0] = -np.inf
        jerks[-1, 1] = np.inf
    ranges = np.array([rows.min(axis=0), rows.max(axis=0)]).T
    limits = Limits(
        velocity=rng.uniform(0.5, 2, (joints, 2)) * signs,
        acceleration=rng.uniform(1, 4, (joints, 2)) * signs,
        jerk=jerks,
        position=ranges if walls else None,
    )
    return Problem(rows, limits)


def random_cells(rng, *, jerky, walled):
    count = rng.integers(1, 6)
    inner = rng.uniform(0, 1, count - 1)
    starts = np.sort(np.append(0.0, inner))
    p = rng.normal(size=(count, 3)) * jerky
    q = rng.normal(size=(count, 2))
    slope = np.full((count, 1), rng.normal())
    if walled:
        slope = rng.normal(size=(count, 1))
    return np.hstack([starts[:, None], p, q, slope])


def variables(relaxation, problem, trajectory):
    """Return a trajectory's values of the relaxation's variables."""
    times = np.diff(trajectory.waypoint_times) / relaxation.time_unit
    inner = trajectory.waypoint_times[1:-1]
    per_second = relaxation.length_units / relaxation.time_unit
    velocity = trajectory(inner, 1) / per_second
    acceleration = trajectory(inner, 2) / per_second * relaxation.time_unit
    acceleration = acceleration * relaxation.jerky
    x = np.zeros(relaxation.variables)
    x[relaxation.time] = times
    x[relaxation.inverse] = 1 / times
    x[relaxation.square] = times**2
    x[relaxation.velocity] = velocity
    x[relaxation.acceleration] = acceleration
    x[relaxation.before] = acceleration * times[:-1, None]
    x[relaxation.after] = acceleration * times[1:, None]
    return x


def assert_rows_hold(rows, x, rtol=0.0):
    terms = rows.coefficients * x[rows.columns]
    slack = 1e-7 + rtol * np.abs(terms).sum(axis=1)
    assert (terms.sum(axis=1) <= rows.bounds + slack).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("jerk", "walls", "one_sided"),
    [(True, False, False), (False, False, False), (True, True, False), (True, True, True)],
)
def test_every_row_holds_for_a_verified_trajectory(seed, jerk, walls, one_sided):
    problem = limited_problem(seed, jerk=jerk, walls=walls, one_sided=one_sided)
    planner = RuckigStop() if walls else RuckigVia(evaluations=300)
    trajectory = certified(problem, planner.solve(problem).trajectory)
    assert verify(problem, trajectory).feasible
    relaxation = Relaxation.of(problem, 1.01 * trajectory.duration)
    x = variables(relaxation, problem, trajectory)
    rng = np.random.default_rng(seed)
    root = relaxation.root_box()
    assert (root.low - 1e-9 <= x).all()
    assert (x <= root.high + 1e-9).all()
    for _ in range(100):
        k = int(rng.integers(relaxation.segments))
        j = int(rng.integers(relaxation.joints))
        cells = random_cells(rng, jerky=relaxation.jerky[j], walled=walls)
        row = cuts(relaxation, [costates.Cut(k, j, cells)])
        assert_rows_hold(row, x, rtol=1e-7)
    for _ in range(20):
        below, above = np.abs(rng.normal(size=(2, relaxation.variables)))
        low = x - 0.3 * below * np.abs(x)
        high = x + 0.3 * above * np.abs(x)
        around = VariableBounds(np.maximum(low, root.low), np.minimum(high, root.high))
        box = relaxation.completed(around)
        assert_rows_hold(relaxation.box_rows(box), x)
        at = float(rng.uniform(0.1, 5))
        assert_rows_hold(relaxation.tangent(0, at), x)
        places = rng.uniform(0.01, 5, relaxation.segments)
        touching = [SquareTangent(k, at) for k, at in enumerate(places.tolist())]
        assert_rows_hold(square_rows(relaxation, touching, box), x)
    for side, k, j in np.ndindex(2, relaxation.segments, relaxation.joints):
        if np.isfinite(relaxation.j[side, k, j]):
            assert_rows_hold(ramp_row(relaxation, Ramp(k, j, side)), x)


def test_a_square_tangent_has_no_slack_where_the_inverse_is_exact():
    problem = limited_problem(0)
    relaxation = Relaxation.of(problem, 20.0)
    root = relaxation.root_box()
    time = relaxation.time[1]
    for t in np.linspace(root.low[time], root.high[time], 7)[1:-1].tolist():
        row = square_rows(relaxation, [SquareTangent(1, t)], root)
        x = np.zeros(relaxation.variables)
        x[time] = t
        x[relaxation.inverse[1]] = 1 / t
        # the largest square that the row allows
        largest = row.bounds[0] - row.coefficients[0] @ x[row.columns[0]]
        assert largest == pytest.approx(t**2, rel=1e-12)


def test_the_integral_of_a_quadratic_is_bounded_from_above_and_tightly():
    rng = np.random.default_rng(1)
    quadratic = rng.normal(size=(3, 200))
    quadratic[:, :20] = 0.0
    quadratic[2, 20:60] = 0.0
    widths = rng.uniform(0, 2, 200)
    s = np.linspace(0, 1, 20001)[:, None] * widths
    f = quadratic[0] + s * (quadratic[1] + s * quadratic[2])
    weighed = 3.0 * np.maximum(f, 0) + 2.0 * np.maximum(-f, 0)
    # the trapezoidal rule
    expected = (weighed[1:] + weighed[:-1]).sum(axis=0) / 2 * widths / 20000
    bound = costates.integral(tuple(quadratic), widths, 2.0, 3.0)
    assert bound == pytest.approx(expected, abs=1e-6)


def test_idle_rows_leave_the_program_and_are_found_again():
    relaxation = Relaxation.of(limited_problem(0), 20.0)
    pool = RowPool(relaxation, relaxation.root_box())
    total = relaxation.total()

    def least_total():
        for _ in range(40):
            x = pool.minimised(total).x
            times = x[relaxation.time].tolist()
            pool.add_violated([Tangent(k, at) for k, at in enumerate(times)], x)
            pool.add_violated(extremal.violated(relaxation, x, 1e-6), x)
        return pool.minimised(total).value

    least = least_total()
    for _ in range(80):
        pool.minimised(-total)
    assert pool.minimised(total).value < 0.9 * least
    assert least_total() == pytest.approx(least, rel=1e-4)


# --- against optima that are known ---


@pytest.mark.parametrize(
    ("v", "a", "j", "h"), [(1, 2, 8, 1.5), (10, 20, 3, 1.0), (1, 9, 5, 4.0), (10, 2, 300, 1.0)]
)
def test_two_waypoints_meet_ruckigs_optimum(v, a, j, h):
    problem = Problem([[0.0], [h]], Limits([v], [a], [j]))
    optimum = RuckigStop().solve(problem).trajectory.duration
    bound = prove(problem, within=1e-7, time_limit=HANG_S)
    assert bound.status == "proved"
    assert optimum * (1 - 1e-6) <= bound.lower_bound <= optimum * (1 + 1e-9)


def test_asymmetric_limits_meet_the_trapezoid():
    problem = Problem([[0.0], [1.0]], Limits([[-1, 0.5]], [[-1.0, 4.0]]))
    # h/V + V/(2 A1) + V/(2 A2)
    optimum = 2.0 + 0.25 + 0.0625
    proof = branch_and_bound(problem, optimum * (1 - 1e-6), 1e-6, never)
    assert optimum * (1 - 2e-6) <= proof.lower_bound <= optimum


@pytest.mark.parametrize("step", [1e-4, 1e-10])
def test_a_tiny_step_beside_long_ones_does_not_hide_them(step):
    """Forth, a tiny step back, forth again: the joint is at rest where it turns."""
    problem = Problem([[0.0], [1.0], [1.0 - step], [2.0]], Limits([1.5], [2.0]))
    optimum = stop_times(problem).sum()
    proof = branch_and_bound(problem, optimum * (1 - 1e-5), 1e-5, never)
    assert optimum * (1 - 2e-5) <= proof.lower_bound <= optimum


def test_waypoints_of_all_scales_along_a_straight_line_cost_nothing():
    steps = 2.0 ** np.array([0, -33, -7, -20, -1, -30, -3])
    places = np.append(0.0, np.cumsum(steps))
    problem = Problem(places[:, None], Limits([1.0], [2.0]))
    # h/V + V/A
    optimum = places[-1] + 0.5
    proof = branch_and_bound(problem, optimum * (1 - 1e-5), 1e-5, never)
    assert optimum * (1 - 2e-5) <= proof.lower_bound <= optimum


@pytest.mark.parametrize("free_side", [0, 1])
def test_a_free_side_of_jerk_is_free_and_the_other_counts(free_side):
    """V = 0.5 with accelerations −1 … 4 and one jerk limit of 10: the infimum by hand."""
    v, j = 0.5, 10.0
    sides = [-j, j]
    sides[free_side] *= np.inf
    problem = Problem([[0.0], [1.0]], Limits([[-1, v]], [[-1.0, 4.0]], [sides]))
    # up, the peak acceleration stays below 4: one side jumps and the other takes √(2 V/J)
    ramp = np.sqrt(2 * v / j)
    # down, acceleration −1 is held but for a ramp of 1/J
    end = 1 / j
    hold = (v - end / 2) / 1.0
    if free_side == 1:
        rising = j * ramp**3 / 3
        falling = v * end - j * end**3 / 6 + hold**2 / 2
    else:
        rising = j * ramp**3 / 6
        falling = v * hold - hold**2 / 2 + j * end**3 / 6
    infimum = ramp + end + hold + (1.0 - rising - falling) / v
    proof = branch_and_bound(problem, infimum * (1 - 1e-5), 1e-5, never)
    assert infimum * (1 - 2e-5) <= proof.lower_bound <= infimum * (1 + 1e-9)
    bound = prove(problem, within=1e-3, time_limit=HANG_S)
    assert bound.status == "proved"
    assert infimum * (1 - 1e-9) <= bound.upper_bound <= infimum * (1 + 1e-3)


def between_states(rng):
    """Ruckig's quickest way between two states, `(v, a, j, h, state, state, time)`."""
    v, a, j = rng.uniform([0.5, 0.5, 1.0], [2.0, 4.0, 40.0])
    h = rng.uniform(-1, 1) * rng.choice([0.05, 0.3, 1.0])
    v0, v1 = rng.uniform(-1, 1, 2) * v * rng.choice([0.2, 0.95])
    a0, a1 = rng.uniform(-1, 1, 2) * a * rng.choice([0.0, 0.3, 0.95])
    fastest_start = abs(v0) + a0**2 / (2 * j)
    fastest_end = abs(v1) + a1**2 / (2 * j)
    if max(fastest_start, fastest_end) > v:
        return between_states(rng)
    otg = ruckig.Ruckig(1)
    given = ruckig.InputParameter(1)
    given.current_velocity = [v0]
    given.current_acceleration = [a0]
    given.target_position = [h]
    given.target_velocity = [v1]
    given.target_acceleration = [a1]
    given.max_velocity = [v]
    given.max_acceleration = [a]
    given.max_jerk = [j]
    motion = ruckig.Trajectory(1)
    otg.calculate(given, motion)
    return ((v, a, j), h, (v0, v1), (a0, a1), motion.duration)


@pytest.mark.parametrize("seed", range(40))
def test_no_rows_of_extremal_motions_are_missing_and_none_is_false(seed):
    limits, h, velocities, accelerations, quickest = between_states(np.random.default_rng(seed))
    v, a, j = limits
    problem = Problem([[0.0], [1.0], [1.0 + h], [0.0]], Limits([v], [a], [j]))
    relaxation = Relaxation.of(problem, 8 * quickest + 6)
    length = relaxation.length_units[0]
    for shorter, is_broken in ((1e-2, True), (1e-4, True), (-1e-7, False)):
        time = quickest * (1 - shorter) / relaxation.time_unit
        x = np.zeros(relaxation.variables)
        x[relaxation.time] = time
        x[relaxation.inverse] = 1 / time
        x[relaxation.square] = time**2
        unit = relaxation.time_unit
        x[relaxation.velocity[:, 0]] = np.array(velocities) * unit / length
        scaled = np.array(accelerations) * unit**2 / length * time
        x[relaxation.before[:, 0]] = scaled
        x[relaxation.after[:, 0]] = scaled
        rows = extremal.violated(relaxation, x, 1e-9)
        assert any(row.segment == 1 for row in rows) == is_broken


# --- proofs ---


@pytest.fixture(scope="module")
def proved():
    problem = load("one-joint")
    bound = prove(problem, within=1e-5)
    return problem, bound


def test_a_proof_proves_its_bound_again(proved):
    problem, bound = proved
    stored = BoundProof.stored(bound.proof.arrays())
    assert proved_bound(problem, stored) == bound.lower_bound
    # the trapezoid: 1.5/1 + 1/2
    assert 2.0 * (1 - 2e-5) < bound.lower_bound <= 2.0


@pytest.fixture(scope="module")
def proved_with_jerk():
    """Two joints of a walk with steps of 1 and of 1e-7 rad."""
    walk = load("random-tiny-j7-w10-jerk-17")
    problem = replace(walk, waypoints=walk.waypoints[4:9]).only([0, 1])
    motion = ExactJerk(starts=1).solve(problem).trajectory
    known = verify(problem, motion).certified_duration
    found = branch_and_bound(problem, known / (1 + 1e-3), 1e-3, never)
    return problem, known, found


def test_a_tiny_step_with_jerk_limits_is_proved(proved_with_jerk):
    _, known, found = proved_with_jerk
    assert len(found.proof.square_tangents)
    assert len(found.proof.ramps)
    assert known / (1 + 1e-3) * (1 - 1e-9) <= found.lower_bound <= known


@pytest.mark.long
def test_rows_that_were_changed_prove_no_more_than_is_true(proved_with_jerk):
    problem, known, found = proved_with_jerk
    rng = np.random.default_rng(0)
    for _ in range(20):
        places = found.proof.square_tangents.copy()
        places[:, 1] *= np.exp(rng.normal(size=len(places)))
        ramps = found.proof.ramps.copy()
        ramps[:, 2] = rng.integers(2, size=len(ramps))
        changed = replace(found.proof, square_tangents=places, ramps=ramps)
        assert proved_bound(problem, changed) <= known


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ramps", [[0, 0, 2]]),
        ("ramps", [[0, 9, 1]]),
        ("square_tangents", [[0, -1.0]]),
        ("square_tangents", [[9, 1.0]]),
    ],
)
def test_rows_of_other_segments_joints_or_sides_are_refused(proved_with_jerk, name, value):
    problem, _, found = proved_with_jerk
    table = np.array(value, dtype=float)
    damaged = replace(found.proof, **{name: table})
    with pytest.raises(InvalidInput, match="proof"):
        proved_bound(problem, damaged)


def test_no_ramp_bounds_a_jerk_that_is_free(proved):
    problem, bound = proved
    free = replace(bound.proof, ramps=np.array([[0.0, 0.0, 1.0]]))
    with pytest.raises(InvalidInput, match="jerk limit"):
        proved_bound(problem, free)


def test_a_proof_of_an_older_version_is_read(proved):
    problem, bound = proved
    arrays = bound.proof.arrays()
    for name in ("square_tangents", "ramps"):
        assert not arrays.pop(f"proof_{name}").size
    assert proved_bound(problem, BoundProof.stored(arrays)) == bound.lower_bound


def test_rounding_a_proof_of_many_steps_costs_no_more_than_its_digits():
    problem = limited_problem(0, waypoints=5)
    motion = ExactJerk(starts=1).solve(problem).trajectory
    known = verify(problem, motion).certified_duration
    found = branch_and_bound(problem, known / (1 + 5e-4), 5e-4, never)
    moves = found.proof.steps[:, 0] <= LOWER
    assert moves.sum() > 10
    arrays = vars(found.proof)
    rounded = replace(
        found.proof,
        cells=round_to_digits(arrays["cells"], 6),
        multipliers=round_to_digits(arrays["multipliers"], 6),
    )
    assert proved_bound(problem, rounded) >= found.lower_bound * (1 - 1e-5)
    # a side that is stated farther than its multipliers prove is moved no farther
    boasting = found.proof.steps.copy()
    raises = boasting[moves, 0] == RAISE
    boasting[moves, 2] *= np.where(raises, 1.1, 0.9)
    assert proved_bound(problem, replace(found.proof, steps=boasting)) <= known


def round_to_digits(values, digits):
    rounded = [float(f"{value:.{digits}g}") for value in values.ravel()]
    return np.reshape(rounded, values.shape)


def test_a_proof_proves_no_more_than_is_true(proved):
    problem, bound = proved
    rng = np.random.default_rng(0)
    for name in ("multipliers", "cells", "tangents", "steps"):
        table = getattr(bound.proof, name)
        for _ in range(40):
            factors = 1 + 0.3 * rng.normal(size=table.shape)
            if name == "multipliers":
                factors[:, 0] = 1.0
            if name == "cells":
                factors[:, 1:4] = 1.0
            if name == "steps":
                factors[:, [0, 1, 3]] = 1.0
            changed = replace(bound.proof, **{name: table * factors})
            try:
                again = proved_bound(problem, changed)
            except InvalidInput:
                continue
            assert again <= 2.0
    higher = replace(bound.proof, cutoff=bound.proof.cutoff * 1.5)
    assert proved_bound(problem, higher) <= 2.0


@pytest.mark.parametrize(("length", "limits"), [(1.0, ([2.0], [4.0])), (0.5, ([1.0], [2.0]))])
def test_a_faster_problem_is_not_proved_by_another_ones_proof(proved, length, limits):
    problem, bound = proved
    faster = Problem(length * problem.waypoints, Limits(*limits))
    # 1.5/2 + 2/4 and 0.75/1 + 1/2
    assert proved_bound(faster, bound.proof) <= 1.25


@pytest.mark.parametrize(("waypoints", "joints"), [([0, 3], 1), ([0, 1, 2, 3], 2)])
def test_a_proof_of_other_segments_or_joints_is_refused(proved, waypoints, joints):
    problem, bound = proved
    rows = np.repeat(problem.waypoints[waypoints], joints, axis=1)
    other = Problem(rows, Limits([2.0] * joints, [4.0] * joints))
    with pytest.raises(InvalidInput, match="proof"):
        proved_bound(other, bound.proof)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("units", [0.0, 1.0]),
        ("cutoff", [-1.0]),
        ("cuts", [[0, 7, 1]]),
        ("steps", [[3, 0, 0, 10**6]]),
        ("steps", [[2, 0, 0.5, 0]]),
        ("cells", [[0.5, 0, 0, 0, 0, 0, 1]]),
    ],
)
def test_a_damaged_proof_is_refused(proved, name, value):
    problem, bound = proved
    table = np.array(value, dtype=float)
    damaged = replace(bound.proof, **{name: table})
    with pytest.raises(InvalidInput):
        proved_bound(problem, damaged)


@pytest.mark.parametrize("name", ["prove", "certify"])  # stored trials may have the old name
def test_a_stored_bound_that_was_edited_does_not_hold(tmp_path, name):
    planner = Prove(within=1e-3, time_limit=HANG_S)
    (trial,) = trials_of(planner, load("one-joint"), [0], name)
    folder.Store(tmp_path).write(trial)
    assert verification(tmp_path).holds
    edited = replace(trial, solution=replace(trial.solution, lower_bound=1.4))
    other = tmp_path / "edited"
    folder.Store(other).write(edited)
    checked = verification(other)
    assert not checked.holds
    assert "lower bound: recorded 1.4" in checked.trials[0].differences[0]


def test_the_optimum_s_own_costates_save_linear_programs() -> None:
    problem = load("topico-example5")
    best = incumbent(problem, seconds=HANG_S)
    assert best is not None
    target = best.duration / (1 + 1e-4)
    found = branch_and_bound(problem, target, 1e-4, never, best.trajectory)
    without = branch_and_bound(problem, target, 1e-4, never)
    assert found.programs < without.programs
    assert target <= found.lower_bound <= best.duration


def test_rows_of_a_motion_on_which_the_solver_breaks_down_are_left() -> None:
    problem = load("random-zigzag-j4-w10-jerk-02")
    best = incumbent(problem, seconds=0.5)
    assert best is not None
    target = best.duration / (1 + 1e-4)
    found = branch_and_bound(problem, target, 1e-4, never, best.trajectory)
    assert target <= found.lower_bound <= best.duration


def test_waypoints_that_rounding_may_miss_are_left_out() -> None:
    """The bound is one of the problem without them; the proof holds for the problem as given."""
    clear = Problem([[0.0, 0.0], [1.0, 0.5], [0.5, 1.0]], Limits([1.0, 1.0], [2.0, 2.0]))
    steps = 1e-9 * np.arange(1, 4)[:, None]
    dense = np.concatenate([clear.waypoints[:2], clear.waypoints[1] + steps, clear.waypoints[2:]])
    problem = replace(clear, waypoints=dense)
    bound = prove(problem, time_limit=HANG_S)
    assert bound.proof is not None
    assert proved_bound(problem, bound.proof) == bound.lower_bound
    assert len(bound.trajectory.waypoint_times) == len(dense)
    assert bound.status == "proved"
