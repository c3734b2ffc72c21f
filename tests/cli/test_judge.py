"""`trajopt judge` and `trajopt verify --limits` as a user types them."""

from __future__ import annotations

import json
import re
import warnings

import numpy as np
import pytest

from trajopt import cli
from trajopt.explain import decomposition
from trajopt.explain.references import ReferenceAnswer

HEADER = "time [s],a [rad],b [rad],a_velocity [rad/s],b_velocity [rad/s]\n"
FAST = HEADER + "0,0,0,0,0\n0.5,0.5,-0.25,2,-1\n1,1,-0.5,0,0\n"  # 1 rad in 1 s: 4 rad/s²
SLOW = HEADER + "0,0,0,0,0\n1,0.5,-0.25,1,-0.5\n2,1,-0.5,0,0\n"  # in 2 s: 1 rad/s²
PROBLEM = """\
waypoints = [[0, 0], [1, -0.5]]
units = {waypoints = "rad", limits = "rad"}
limits = {velocity = [5, 5], acceleration = [1, 1]}
"""
OWN = "has_velocity_limits: true, max_velocity: 5, has_acceleration_limits: true"
LIMITS = f"""\
joint_limits:
  b: {{{OWN}, max_acceleration: 1}}
  a: {{{OWN}, max_acceleration: 1}}
"""


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fast.csv").write_text(FAST)
    (tmp_path / "slow.csv").write_text(SLOW)
    (tmp_path / "p.toml").write_text(PROBLEM)
    (tmp_path / "limits.yaml").write_text(LIMITS)

    def ran(*arguments):
        with pytest.raises(SystemExit) as ended:
            cli.main(" ".join(arguments).split())
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return ran


def test_a_feasible_motion_is_told_with_its_figure(run, tmp_path):
    code, out, _ = run("judge slow.csv p.toml")
    assert code == 0
    assert "slow.csv on p: feasible" in out
    assert "Executed with 2 cubic pieces between its samples." in out
    assert "certified   2.000000 s" in out
    assert "1.000 times the best known optimum, 2.0000 s" in " ".join(out.split())
    assert "figure: results/judge/p-slow.csv.png" in out
    assert (tmp_path / "results/judge/p-slow.csv.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("motion", "code", "said"),
    [
        ("slow.csv", 0, "<b>slow.csv</b><span>2.00 s"),
        ("fast.csv", 1, "It breaks a limit: it uses 400 % of it."),
    ],
)
def test_a_motion_races_the_optimum(run, tmp_path, motion, code, said):
    ended, out, _ = run(f"judge {motion} p.toml --race race.html")
    assert ended == code
    assert "race: race.html" in out
    page = " ".join((tmp_path / "race.html").read_text(encoding="utf-8").split())
    assert "<b>optimum</b><span>2.00 s" in page
    assert said in page
    assert "The shortest of these within the limits takes 2.0000 s." in page
    ended, _, err = run(f"judge {motion} p.toml --race race.html")
    assert ended == 2
    assert "--race is 'race.html': expected a file that is not there yet" in err


def test_json_is_one_object(run):
    code, out, err = run("judge fast.csv p.toml --json")
    table = json.loads(out)
    assert (code, err) == (1, "")
    assert table["motion"] == "fast.csv"
    assert table["problem"] == "p"
    assert table["interpolation"] == "cubic"
    assert table["waypoint_times"] == [0, 1]
    assert table["certified_duration"] == pytest.approx(2)
    assert table["certificate"]["acceleration"]["ratio"] == pytest.approx(4)


@pytest.mark.parametrize("lost", ["a", "b"])
def test_limits_that_lost_their_degrees_are_warned_of(run, tmp_path, lost):
    tagged = LIMITS.replace("max_velocity: 5", "max_velocity: !degrees 286")
    (tmp_path / "tagged.yaml").write_text(tagged)
    before, line, after = tagged.partition(f"{lost}: ")
    (tmp_path / "lost.yaml").write_text(before + line + after.replace("!degrees ", "", 1))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        _, _, said = run("verify slow.csv --limits tagged.yaml")
        assert said == ""
        _, _, err = run("verify slow.csv --limits lost.yaml")
    assert re.match(rf"trajopt: warning: slow\.csv, {lost}: .* radians beside degrees", err)


def test_an_arms_limits_are_its_joints(run, tmp_path):
    names = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]
    names += ["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
    points = [
        {"positions": [0.0] * 6, "velocities": [0.0] * 6, "time_from_start": 0},
        {"positions": [0.1] * 6, "velocities": [0.0] * 6, "time_from_start": 4},
    ]
    message = {"joint_trajectory": {"joint_names": names, "points": points}}
    (tmp_path / "m.json").write_text(json.dumps(message))
    code, out, err = run("verify m.json --limits ur5e")
    assert code == 0, err
    assert "as fast" in out


FR3 = [f"fr3_joint{joint}" for joint in range(1, 8)]
ELSEWHERE = [0.0, 0.0, 0.0, -1.0, 0.0, 2.0, 0.0]


def fr3_motion(tmp_path, end):
    """Joint 2 of the FR3 from 0.38 rad before `end` to it in 1 s, at 1.52 rad/s² and back."""
    parabolas = np.zeros((3, 2, 7))
    parabolas[2] = ELSEWHERE
    parabolas[:, :, 1] = np.transpose([[0.76, 0, end - 0.38], [-0.76, 0.76, end - 0.19]])
    motion = {"breaks": [0, 0.5, 1], "coefficients": parabolas.tolist(), "joint_names": FR3}
    (tmp_path / "m.json").write_text(json.dumps(motion))
    rows = []
    for angle in (end - 0.38, end):
        row = [str(own) for own in ELSEWHERE]
        row[1] = str(angle)
        rows.append(",".join(row))
    (tmp_path / "w.csv").write_text("\n".join([",".join(FR3), *rows]))


def fr3_urdf(tmp_path):
    own = '<position_based_velocity_limits velocity_offset="0.2" deceleration_limit="2.585"/>'
    joints = ""
    accelerations = ""
    for name in FR3:
        upper = 1.7918 if name == "fr3_joint2" else 9
        limit = f'<limit lower="-9" upper="{upper}" velocity="2.62"/>'
        joints += f'<joint name="{name}" type="revolute">{limit}{own}</joint>'
        accelerations += f"  {name}: {{max_acceleration: 10}}\n"
    (tmp_path / "r.urdf").write_text(f"<robot>{joints}</robot>")
    (tmp_path / "l.yaml").write_text(f"joint_limits:\n{accelerations}")


@pytest.mark.parametrize(
    "arguments",
    [
        "judge m.json w.csv --robot franka-fr3",
        "verify m.json --robot franka-fr3",
        "verify m.json --limits franka-fr3",
        "verify m.json --urdf r.urdf --limits l.yaml",
    ],
)
def test_the_arms_own_velocity_limit_is_checked(run, tmp_path, arguments):
    fr3_motion(tmp_path, 1.78)
    fr3_urdf(tmp_path)
    # libfranka: sqrt(5.17 (1.7918 - q)) - 0.2. Braking at b the use is v / (sqrt(R² + d v²/b) - o),
    # R² = 2 d W with W the distance that is left at rest: largest where the root is R²/o.
    b, d, o = 1.52, 2.585, 0.2
    root = 2 * d * (1.7918 - 1.78) / o
    v = np.sqrt((root**2 - root * o) * b / d)
    value = v / (root - o)
    code, out, err = run(arguments, "--json")
    table = json.loads(out)
    found = table["certificate"]["falling_velocity"]
    assert (code, err) == (1, "")
    assert table["feasible"] is False
    assert found["joint"] == 2
    assert found["ratio"] == pytest.approx(value, rel=1e-9)
    assert found["time"] == pytest.approx(1 - v / b, rel=1e-6)
    # within the constant limits; but the FR3 has jerk limits, and accelerations jump here
    if "--urdf" in arguments:
        assert table["dilation"] == found["ratio"]
    code, out, _ = run(arguments)
    words = " ".join(out.split())
    assert code == 1
    assert f"falling velocity {value:.6f} of limit fr3_joint2" in words


def test_a_motion_far_from_the_ends_keeps_the_arms_own_limit(run, tmp_path):
    fr3_motion(tmp_path, 1.2)
    fr3_urdf(tmp_path)
    code, out, _ = run("verify m.json --urdf r.urdf --limits l.yaml")
    assert code == 0
    assert re.search(r"falling velocity +0\.\d+ of limit", out)


# --- jerk limits, and what is below the optimum ---

JERKY = PROBLEM.replace("acceleration = [1, 1]", "acceleration = [4, 4], jerk = [40, 40]")


def test_a_motion_made_without_jerk_limits_is_judged_without_them_too(run, tmp_path):
    """1 rad from rest to rest within 4 rad/s² takes 2 √(1/4) = 1 s, half as long as the motion."""
    (tmp_path / "jerky.toml").write_text(JERKY)
    code, out, _ = run("judge slow.csv jerky.toml")
    told = " ".join(out.split())
    assert code == 1
    assert "Slowing down does not help: joint 1 at 1 s: acceleration jumps by 2 rad/s²" in told
    assert (
        "jerk limits: It could run 2.000000 times as fast within every limit, in 1.000000 s."
        in told
    )
    assert "takes 2.0000 s on jerky without jerk limits, 2.000 times the best known" in told
    code, out, _ = run("judge slow.csv jerky.toml --json")
    found = json.loads(out)
    assert (found["gap"], found["status"]) == (None, "invalid")
    other = found["without_jerk"]
    assert (other["feasible"], "without_jerk" in other) == (True, False)
    assert other["gap"] == pytest.approx(1.0, rel=1e-6)


def test_other_flaws_leave_no_verdict_without_jerk_limits(run, tmp_path):
    (tmp_path / "jerky.toml").write_text(JERKY.replace("[1, -0.5]]", "[1, -0.4]]"))
    _, out, _ = run("judge slow.csv jerky.toml --json")
    assert json.loads(out)["without_jerk"] is None
    _, out, _ = run("judge slow.csv jerky.toml --via-tolerance 0.2 --json")
    assert json.loads(out)["without_jerk"]["feasible"] is True


@pytest.mark.parametrize("planner", ["toppra", "exact"])
def test_explain_answers_without_jerk_limits_where_a_planner_knows_none(run, tmp_path, planner):
    (tmp_path / "jerky.toml").write_text(JERKY)
    code, out, _ = run(f"explain jerky.toml --planner {planner} --json")
    found = json.loads(out)
    assert code == 1
    assert found["status"] == {"toppra": "unsupported", "exact": "invalid"}[planner]
    assert found["without_jerk"]["certified_duration"] == pytest.approx(1.0, rel=1e-3)
    assert found["without_jerk"]["exact"] == pytest.approx(1.0, rel=1e-6)
    code, out, _ = run(f"explain jerky.toml --planner {planner}")
    assert "Without the jerk limits:" in out
    assert "times the best known optimum" in " ".join(out.split())


def test_a_motion_below_the_optimum_raises_the_alarm(run, monkeypatch):
    """An optimum that is wrong: twice as long as the motion."""
    true = decomposition._optimum
    monkeypatch.setattr(
        decomposition,
        "_optimum",
        lambda problem: ReferenceAnswer(true(problem).trajectory.dilated(2.0)),
    )
    _, _, err = run("judge slow.csv p.toml")
    said = "BUG OR BETTER OPTIMUM: slow.csv on p is 50.000000 % below the best known optimum"
    assert said in " ".join(err.split())
    _, _, err = run("judge slow.csv p.toml --json")
    assert said in " ".join(err.split())


def test_the_optimum_itself_raises_none(run):
    _, _, err = run("judge slow.csv p.toml --json")
    assert "BUG" not in err
