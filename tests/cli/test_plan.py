"""`trajopt plan` of a stranger's waypoints and robot, the best planner, and `trajopt new`."""

from __future__ import annotations

import json
import re
import signal
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from trajopt import best_planner
from trajopt.benchmark.best_known import records
from trajopt.benchmark.run.runner import Supervised
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.suites import catalogue
from trajopt.best_planner import best
from trajopt.cli import main, plan
from trajopt.cli.best_words import sentences
from trajopt.core import problem_file
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.judging.verification import verify
from trajopt.views.export import motion_file


def typed(arguments):
    """Texts are split at blanks; paths and numbers are one word each."""
    for argument in arguments:
        yield from argument.split() if isinstance(argument, str) else [str(argument)]


@pytest.fixture
def trajopt(capsys, monkeypatch, tmp_path):
    """Runs a command in an empty folder: its exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(list(typed(arguments)))
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


LIMITS = """
joint_limits:
  elbow_joint: {has_acceleration_limits: true, max_acceleration: 2.0, max_jerk: 30}
  wrist_1_joint: {has_acceleration_limits: true, max_acceleration: 2.0, max_jerk: 30}
"""
URDF = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="wrist_1_joint" type="revolute"><parent link="a"/><child link="b"/>
<limit lower="-6" upper="6" velocity="2" effort="1"/></joint>
<joint name="elbow_joint" type="revolute"><parent link="b"/><child link="c"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>
"""


def test_waypoints_of_a_built_in_robot(trajopt, tmp_path):
    (tmp_path / "w.csv").write_text("elbow_joint,wrist_1_joint\n0,0\n90,-45\n", encoding="utf-8")
    code, out, err = trajopt("plan w.csv --robot ur5e --unit deg --json")
    found = json.loads(out)
    assert (code, err) == (0, "")
    # 90 degrees at 180 deg/s and 5 rad/s²: a triangle, 2 sqrt(h / A)
    assert found["certified_duration"] == pytest.approx(2 * np.sqrt(np.pi / 2 / 5), rel=1e-6)
    assert found["stopping_duration"] == pytest.approx(found["certified_duration"], rel=1e-6)
    assert found["proved_bound"] == pytest.approx(found["certified_duration"], rel=1e-6)
    assert found["problem_file"] == "w.csv"
    shown = trajopt("plan w.csv --robot ur5e --unit deg")[1]
    assert "elbow_joint" in shown
    assert "the optimum, proved" in shown
    assert "jerk limits too" in shown


def test_a_urdf_with_joint_limits_beside_it(trajopt, tmp_path):
    (tmp_path / "w.csv").write_text("0,0\n-1.0,0.5\n", encoding="utf-8")
    (tmp_path / "r.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "l.yaml").write_text(LIMITS, encoding="utf-8")
    code, _, err = trajopt("plan w.csv --urdf r.urdf")
    assert code == 2
    assert "r.urdf: acceleration limit is missing (this URDF has none)" in err
    assert "wrist_1_joint, elbow_joint; add --limits" in err
    arguments = "plan w.csv --urdf r.urdf --limits l.yaml --planner"
    code, out, _ = trajopt(arguments, "ruckig-stop --json")
    # 1 rad, J = 30, A = 2: v/A + A/J each way, no cruise at 2 rad/s
    slope = 2.0 / 30
    peak = 2.0 / 2 * (np.sqrt(slope**2 + 4 / 2.0) - slope)
    assert json.loads(out)["certified_duration"] == pytest.approx(2 * (peak / 2 + slope), rel=1e-6)
    assert code == 0


def test_scaling_factors_are_planned_with_and_judged_without(trajopt, tmp_path):
    (tmp_path / "w.csv").write_text("one\n0\n0.5\n", encoding="utf-8")
    one = "joint_limits: {one: {max_velocity: 9, max_acceleration: 2}}"
    factors = "default_velocity_scaling_factor: 0.5\ndefault_acceleration_scaling_factor: 0.25\n"
    (tmp_path / "l.yaml").write_text(factors + one, encoding="utf-8")
    robot = "--limits l.yaml"
    code, out, err = trajopt("plan w.csv", robot, "--planner exact --out m.csv")
    # 0.5 rad at a quarter of 2 rad/s²: 2 sqrt(h / A)
    assert f"certified   {2 * np.sqrt(0.5 / 0.5):.6f} s" in out
    assert "l.yaml: planned with 50 % of the velocity and 25 % of the acceleration limits" in err
    assert "write 1.0 there" in err
    for arguments in ("judge m.csv w.csv", "verify m.csv"):
        code, out, err = trajopt(arguments, robot, "--json")
        assert (code, err.count("\n")) == (0, 1)
        assert "default scaling factors" in err
        assert "are not applied" in err
        assert json.loads(out)["dilation"] == pytest.approx(0.5, rel=1e-3)  # whole cycles
    (tmp_path / "v.yaml").write_text("joint_limits: {one: {max_velocity: 9}}", encoding="utf-8")
    verify = "verify m.csv --limits v.yaml"
    assert "accelerations are not judged" in trajopt(verify)[2]
    assert trajopt(verify, "--acceleration 0.6")[0] == 0
    assert trajopt(verify, "--acceleration 0.4")[0] == 1


RAIL = """<robot><joint name="rail" type="prismatic"><limit lower="0" upper="1" velocity="1"/>
</joint><joint name="elbow" type="revolute"><limit lower="-3" upper="3" velocity="1"/></joint>
</robot>"""
OF_RAIL = "joint_limits: {rail: {max_acceleration: 0.8}, elbow: {max_acceleration: 9}}"


def test_a_rail_moves_by_metres_whatever_the_unit_of_angles(trajopt, tmp_path):
    (tmp_path / "w.csv").write_text("0,0\n0.2,10\n", encoding="utf-8")
    (tmp_path / "r.urdf").write_text(RAIL, encoding="utf-8")
    (tmp_path / "l.yaml").write_text(OF_RAIL, encoding="utf-8")
    robot = "--urdf r.urdf --limits l.yaml"
    plan = f"plan w.csv {robot} --unit deg --planner exact --out"
    code, out, err = trajopt(plan, "motion.csv")
    assert (code, err) == (0, "")
    assert f"certified   {2 * np.sqrt(0.2 / 0.8):.6f} s" in out
    assert re.search(r"waypoint +[-+.e0-9]+ (m +rail|rad +elbow)", out)
    header, *rows = (tmp_path / "motion.csv").read_text().splitlines()
    assert header == "time [s],rail [m],elbow [deg],rail [m/s],elbow [deg/s]"
    assert float(rows[-1].split(",")[1]) == pytest.approx(0.2, abs=1e-12)
    assert trajopt("verify motion.csv", robot)[0] == 0
    swapped = header.replace("rail [m", "rail [rad").replace("elbow [deg", "elbow [m")
    (tmp_path / "swapped.csv").write_text("\n".join([swapped, *rows]))
    code, _, err = trajopt("verify swapped.csv", robot)
    assert code == 2
    assert "swapped.csv: unit, joint 1 is 'rad': expected a unit of m: rail slides" in err
    trajopt(plan, "trial.h5")
    (trial,) = store.read(tmp_path / "trial.h5")
    assert trial.problem.joint_units == ("m", "rad")


# --- the best planner ---


def test_the_best_planner_is_the_exact_one_and_says_what_it_saves():
    limits = Limits([1.0, 1.5], [2.0, 3.0])
    problem = Problem([[0, 0], [1, 1], [2, 1.5]], limits)
    found = best(problem, 0)
    text = " ".join(sentences(found))
    assert found.trial.planner == "exact"
    # joint 1 cruises past the waypoint: 2/1 + 1/2; stopping: 1/1 + 1/2 twice
    assert found.trial.certified_duration == pytest.approx(2.5, rel=1e-6)
    assert found.stopping == pytest.approx(3.0)
    assert "exact is the best planner under velocity and acceleration limits." in text
    assert "Its answer is the optimum, proved. " in text  # the bound is joint 1's straight way
    weaker = replace(found, proved=2.5 / 1.00005)
    assert "the optimum, proved within 0.005 %. " in " ".join(sentences(weaker))
    assert "saves 16.7 %" in text


def test_position_limits_that_the_relaxation_leaves_go_to_the_next_planner():
    limits = Limits([1, 1], [2, 2], position=[[0, 1], [-9, 9]])
    problem = Problem([[0, 0], [1, -0.5], [0.4, 0.6]], limits)
    found = best(problem, 0)
    assert found.trial.planner == "collocation-refined"
    assert found.trial.certificate.valid
    assert found.relaxed < found.trial.certified_duration
    text = " ".join(sentences(found))
    assert "the best known under fewer limits" in text
    least, said = re.search(r"takes at least ([0-9.]+) s, ([0-9.]+) % less", text).groups()
    duration = found.trial.certified_duration
    assert 0 <= found.proved - float(least) < 1e-3
    assert float(said) == pytest.approx(100 * (duration - found.proved) / duration, rel=1e-2)


def test_a_new_problem_is_proved_while_it_is_planned(trajopt, tmp_path):
    """Three segments from rest to rest, 2 s each; one from end to end takes 2 s."""
    problem = Problem([[0.0], [1.0], [0.0], [1.0]], Limits([2.0], [1.0]), name="turns")
    (tmp_path / "turns.toml").write_text(problem_file.text(problem), encoding="utf-8")
    found = best(problem, 0)
    assert found.proved == pytest.approx(2.0)
    code, out, _ = trajopt("plan turns.toml --json")
    table = json.loads(out)
    assert code == 0
    assert table["certified_duration"] == pytest.approx(6.0)
    assert 6.0 * (1 - 1e-4) <= table["proved_bound"] <= 6.0
    _, out, _ = trajopt("plan turns.toml")
    assert "Its answer is the optimum, proved within" in " ".join(out.split())


@pytest.mark.parametrize("durations", [[2.0, 2.0], [2.8, 2.0, 2.6], [np.inf, 2.0], None])
@pytest.mark.parametrize("share", [0.95, 0.7])
def test_only_a_bound_says_that_an_answer_is_fastest(durations, share):
    """Starts that agree say nothing: on some problems all of a dozen end at one wrong time."""
    found = best(Problem([[0.0], [1.0]], Limits([1.0], [1.0])), 0)
    assert found.trial.certified_duration == pytest.approx(2.0)
    stats = {} if durations is None else {"start_duration": np.array(durations)}
    trial = replace(found.trial, solution=replace(found.trial.solution, stats=stats))
    text = " ".join(sentences(replace(found, trial=trial, proved=2.0 * share)))
    assert "It is certified; no proof that it is fastest. Proved: every motion takes" in text
    assert f"{100 * (1 - share):.3g} % less" in text


# --- new ---


def test_a_new_problem_file_plans_as_it_is(trajopt, tmp_path):
    code, out, _ = trajopt("new")
    assert (code, out) == (0, "problem.toml: edit it, then run: trajopt plan problem.toml\n")
    assert trajopt("plan problem.toml --planner ruckig-stop")[0] == 0
    (tmp_path / "problem.toml").write_text("mine", encoding="utf-8")
    code, _, err = trajopt("new")
    assert code == 2
    assert "--force" in err
    assert (tmp_path / "problem.toml").read_text(encoding="utf-8") == "mine"
    assert trajopt("new --force")[0] == 0
    assert trajopt("new", Path("cell 7"))[0] == 0
    text = (tmp_path / "cell 7.toml").read_text(encoding="utf-8")
    head, limits = text.split("# [limits]\n")
    limits = "\n".join(line.removeprefix("# ") for line in limits.splitlines())
    own = f'{head}units.limits = "rad"\n[limits]\n{limits}'
    (tmp_path / "own.toml").write_text(own, encoding="utf-8")
    assert len(Problem.from_toml(tmp_path / "own.toml").limits.jerk) == 6
    assert trajopt("list --json")[1].count('"shoulder_pan_joint"') == 2


# --- out ---

OUT = "plan reversal --planner exact --out"


@pytest.mark.parametrize(
    ("name", "flags", "points"),
    [
        ("m.yaml", "", None),
        ("m.yml", "--points cycles --rate 125", "every"),
        ("m.csv", "--cycle 0.008", "every"),
        ("m.csv", "--points breaks", None),
        ("m.json", "--points breaks", None),
    ],
)
def test_what_is_written_is_verified_as_executed(trajopt, tmp_path, name, flags, points):
    code, out, err = trajopt(OUT, name, flags, "--json")
    said = json.loads(out)["out"]
    assert (code, err, said["file"], said["interpolation"]) == (0, "", name, "cubic")
    assert said["certificate"]["feasible"]
    assert said["certificate"]["acceleration"]["ratio"] == pytest.approx(1, abs=1e-3)
    if points == "every":
        assert said["points"] == round(said["duration"] / 0.008) + 1
    text = (tmp_path / name).read_text(encoding="utf-8")
    assert "joint_1" in text
    if name.endswith(".csv"):
        assert text.startswith("time [s],joint_1 [rad],")
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_pictures_and_everything_else(trajopt, tmp_path):
    for name, start in {
        "m.png": b"\x89PNG",
        "m.svg": b"<?xml",
        "m.pdf": b"%PDF",
        "m.json": b"{",
    }.items():
        assert trajopt(OUT, name)[0] == 0
        assert (tmp_path / name).read_bytes().startswith(start)
    shown = trajopt(OUT, "m.yaml")[1]
    assert "executed with cubic pieces it keeps every limit" in " ".join(shown.split())
    assert trajopt(OUT, "m.yaml")[0] == 2  # it is there
    _, _, err = trajopt(OUT, "long.csv --cycle 10")
    assert "--cycle is 10.0: expected a shorter one" in err
    assert not (tmp_path / "long.csv").exists()


def test_what_breaks_a_limit_as_executed_is_not_kept(trajopt, tmp_path, monkeypatch):
    write = motion_file.joint_trajectory.write

    def coarse(file, samples, *, goal):
        """The ends alone."""
        ends = [0, -1]
        still = np.zeros_like(samples.positions[ends])
        names = samples.joint_names
        less = type(samples)(names, samples.times[ends], samples.positions[ends], still)
        write(file, less, goal=goal)

    monkeypatch.setattr(motion_file.joint_trajectory, "write", coarse)
    code, _, err = trajopt(OUT, "m.yaml")
    assert code == 2
    assert "m.yaml: not written: executed, " in err
    assert "misses the waypoint" in err
    assert not list(tmp_path.iterdir())


def test_a_goal_and_the_line_that_sends_it(trajopt, tmp_path):
    (tmp_path / "w.csv").write_text("elbow_joint [deg]\n0\n90\n", encoding="utf-8")
    plan = "plan w.csv --robot ur5e --planner exact --as goal --out"
    code, out, _ = trajopt(plan, "my-goal.yaml")
    assert code == 0
    action = "/joint_trajectory_controller/follow_joint_trajectory"
    kind = "control_msgs/action/FollowJointTrajectory"
    assert f'ros2 action send_goal {action} {kind} "$(cat my-goal.yaml)"' in out
    goal = yaml.safe_load((tmp_path / "my-goal.yaml").read_text())
    assert list(goal) == ["trajectory"]
    first, *_, last = goal["trajectory"]["points"]
    assert first["time_from_start"] == {"sec": 0, "nanosec": 0}
    assert last["positions"] == pytest.approx([np.pi / 2])
    assert last["velocities"] == [0.0]
    assert trajopt("verify my-goal.yaml --robot ur5e")[0] == 0
    cycles = "--points cycles --cycle 0.0002"
    assert "--stdin < long.json" in trajopt(plan, "long.json", cycles)[1]
    code, out, err = trajopt(plan, "goal.csv")
    assert (code, out) == (2, "")
    assert "--as is 'goal': expected left out for goal.csv; a goal's file ends in .yaml" in err


def test_a_csv_comes_out_in_the_unit_that_came_in(trajopt, tmp_path):
    (tmp_path / "w.csv").write_text("0,0\n200,90\n", encoding="utf-8")
    (tmp_path / "r.urdf").write_text(RAIL, encoding="utf-8")
    (tmp_path / "l.yaml").write_text(OF_RAIL, encoding="utf-8")
    robot = "--urdf r.urdf --limits l.yaml"
    assert trajopt("plan w.csv", robot, "--unit deg,mm --planner exact --out m.csv")[0] == 0
    header, *rows = (tmp_path / "m.csv").read_text().splitlines()
    assert header == "time [s],rail [mm],elbow [deg],rail [mm/s],elbow [deg/s]"
    ends = [float(cell) for cell in rows[-1].split(",")[1:]]
    assert ends == pytest.approx([200, 90, 0, 0], abs=1e-9)
    assert trajopt("verify m.csv", robot)[0] == 0
    text = 'waypoints = [[0], [90]]\nunits = {waypoints = "deg", limits = "rad"}\n'
    text += "limits = {velocity = [1], acceleration = [1], position = [[-1, 1.6]]}\n"
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    code, out, _ = trajopt("plan p.toml --planner exact --out n.csv")
    assert code == 0
    assert (tmp_path / "n.csv").read_text().startswith("time [s],joint_1 [deg],joint_1 [deg/s]\n")
    # 1.6 rad less 90 degrees
    assert re.search(r"position +0\.0292 rad margin +1 ", out)


def test_a_missing_yaml_package_is_said_before_anything_is_planned(trajopt, tmp_path, monkeypatch):
    monkeypatch.setattr("trajopt.formats.yaml_file.yaml", None)
    monkeypatch.setattr(plan, "Supervised", lambda *a: pytest.fail("it planned"))
    code, _, err = trajopt("plan one-joint --planner exact --out m.yaml")
    assert code == 2
    assert 'pip install "mintime[ros]"' in err


def test_a_planner_in_its_own_process_sees_every_kind_of_limit():
    """`explain` plans again through it: what it does not show is planned without."""
    problem = catalogue.load("robots-franka-fr3-w4")
    with closing(Supervised("collocation:intervals=4", problem)) as planner:
        motion = planner.solve(problem).trajectory
    assert verify(problem, motion).feasible


def test_the_known_motion_is_the_answer_where_planning_takes_long(trajopt, monkeypatch):
    """It took 22 s of CPU time: the optimum without the limit, a motion with it, and both again."""
    asked = []
    monkeypatch.setattr(best_planner, "trials_of", lambda *own: asked.append(own))
    code, out, _ = trajopt("plan robots-franka-fr3-w16-jerk")
    assert (code, asked) == (0, [])
    assert "best-known on robots-franka-fr3-w16-jerk: solved" in out
    record = records.find(catalogue.load("robots-franka-fr3-w16-jerk"))
    assert f"certified   {record.duration:.6f} s" in out
    assert "This is the best known motion" in out


def test_a_known_motion_that_breaks_a_limit_is_no_answer(monkeypatch):
    problem = catalogue.load("robots-franka-fr3-w4")
    record = records.find(problem)
    faster = replace(record.trial.solution, trajectory=record.trajectory.dilated(0.99))
    wrong = replace(record, trial=replace(record.trial, solution=faster))
    monkeypatch.setattr(records, "find", lambda problem: wrong)
    found = best_planner.best(problem, 0)
    assert found.trial.planner == "collocation-refined"


def test_the_answer_of_a_named_planner_is_held_against_the_known_motion(trajopt):
    record = records.find(catalogue.load("six-axis"))
    _, out, _ = trajopt("plan six-axis --planner ruckig-stop")
    said = f"The best known motion takes {record.duration:.6f} s ({record.motion})"
    assert said in " ".join(out.split())
    assert "+60.8 % above it" in out
    _, out, _ = trajopt("plan six-axis --planner exact")
    assert "best known motion" not in out


def test_a_proof_starts_from_the_answer(trajopt, tmp_path, monkeypatch):
    """It planned the motion a second time: half of the time of a plan under all limits."""
    monkeypatch.setattr("baselines.lower_bound.bound.incumbent", None)  # not callable
    problem = catalogue.load("six-axis")
    own = replace(problem, waypoints=problem.waypoints + 0.01, name="own")  # nothing is recorded
    (tmp_path / "own.toml").write_text(own.to_toml(), encoding="utf-8")
    code, out, _ = trajopt("plan", tmp_path / "own.toml")
    assert code == 0
    assert "Its answer is the optimum, proved within" in " ".join(out.split())


def test_the_smoothest_motion_takes_as_long(run, tmp_path):
    """Joint 2 of `PROBLEM` decides nothing; durations stay to the last printed digit."""
    text = (
        "waypoints = [[0, 0], [1, 0.1]]\nunits = {waypoints = 'rad', limits = 'rad'}\n"
        "limits = {velocity = [2, 2], acceleration = [1, 1], jerk = [50, 50]}\n"
    )
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    plain = json.loads(run("plan p.toml --json")[1])
    smooth = json.loads(run("plan p.toml --smoothest --json")[1])
    assert smooth["certified_duration"] == pytest.approx(plain["certified_duration"], rel=1e-9)
    before, after = (own["smoothness"]["jerk_integral"] for own in (plain, smooth))
    assert after < before
    assert smooth["status"] == "solved"


def test_samples_of_every_cycle_are_of_the_smoothest_motion_unless_it_is_not_asked_for(run):
    """The first joint needs 2 s, the second has time: of least jerk it is the quintic, whose way
    after a fourth of the time is 10/4³ − 15/4⁴ + 6/4⁵ of the whole; at one acceleration 2/4²."""
    Path("slack.toml").write_text(
        'waypoints = [[0, 0], [1, 0.1]]\nangle_unit = "rad"\n'
        "[limits]\nvelocity = [2, 2]\nacceleration = [1, 1]\n"
    )
    quintic = 0.1 * (10 / 4**3 - 15 / 4**4 + 6 / 4**5)
    for flags, way in (("", quintic), ("--no-smoothest", 0.1 * 2 / 4**2)):
        assert run(f"plan slack.toml --out m.csv --force {flags}")[0] == 0
        table = np.loadtxt("m.csv", delimiter=",", skiprows=1)
        at = np.interp(table[-1, 0] / 4, table[:, 0], table[:, 2])
        assert at == pytest.approx(way, rel=0.02)


def test_an_interrupted_plan_keeps_nothing_and_does_not_say_so(run, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("trajopt.cli.plan.best", interrupted)
    before = signal.getsignal(signal.SIGINT)
    code, _, err = run("plan six-axis")
    signal.signal(signal.SIGINT, before)  # the command ends deaf to it
    assert code == 130
    assert err.split() == ["trajopt:", "stopped"]
