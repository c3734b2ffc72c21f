"""What a command says: one table, command → exit code → words.

A row is a command in a folder that holds the files it names (`FILES`), its exit code, and words
that it says in this order, with anything at `…`. Beside its row's words

- a command that ends with 2 says one line on stderr, `trajopt: …`, nothing on stdout, and writes
  no file;
- any other says its words on stdout, and on stderr nothing but the row's `notes`;
- with `--json` stdout is one JSON object.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest
from PIL import Image

from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.cli import main


class Row(NamedTuple):
    """What a command is to do: see above."""

    command: str
    code: int
    says: str
    notes: str = ""  # on stderr, of a command that does not end with 2
    never: str = ""  # on neither


def problem(waypoints="[[0], [1]]", velocity="[1]", acceleration="[2]", more="", unit='"rad"'):
    """The text of a problem file; `more` stands beside the waypoints."""
    return (
        f"waypoints = {waypoints}\nangle_unit = {unit}\n{more}\n"
        f"limits = {{ velocity = {velocity}, acceleration = {acceleration} }}\n"
    )


def robot(*joints, head="<robot name='r'>"):
    """The text of a URDF of revolute joints ±3 rad, 1 rad/s, or of joints as they are given."""
    limit = '<limit lower="-3" upper="3" velocity="1"/>'
    texts = [
        own if "<" in own else f'<joint name="{own}" type="revolute">{limit}</joint>'
        for own in joints
    ]
    return head + "".join(texts) + "</robot>"


def limits(more="", **joints):
    """The text of a joint_limits.yaml."""
    return more + "joint_limits:\n" + "".join(f"  {n}: {own}\n" for n, own in joints.items())


FACTORS = "default_velocity_scaling_factor: 0.5\ndefault_acceleration_scaling_factor: 0.5\n"
A = "{max_acceleration: 2}"
VA = "{max_velocity: 1, max_acceleration: 2}"
LOOSE = "{max_velocity: 2, max_acceleration: 4}"
XACRO = "<robot name='r' xmlns:xacro='http://www.ros.org/wiki/xacro'>"
CONTINUOUS = '<joint name="j" type="continuous"><limit velocity="2" effort="9"/></joint>'
RAIL = '<joint name="rail" type="prismatic"><limit lower="0" upper="1" velocity="1"/></joint>'
STEPS = "0,0,0\n0.5,0.5,-0.25\n1,1,-0.5\n"  # s, rad, rad
MESSAGE = """joint_names: [one]
points:
- {positions: [0.0], velocities: [0.0], time_from_start: {sec: 0, nanosec: 0}}
- {positions: [1.0], velocities: [0.0], time_from_start: {sec: 3, nanosec: 0}}
"""
# From 0 to 1 and 0 to −0.5 rad in 1 s, at 4 rad/s², or in 2 s, at 1 rad/s².
HEADER = "time [s],a [rad],b [rad],a_velocity [rad/s],b_velocity [rad/s]\n"
FAST = HEADER + "0,0,0,0,0\n0.5,0.5,-0.25,2,-1\n1,1,-0.5,0,0\n"
SLOW = HEADER + "0,0,0,0,0\n1,0.5,-0.25,1,-0.5\n2,1,-0.5,0,0\n"
JUDGED = problem("[[0, 0], [1, -0.5]]", "[5, 5]", "[1, 1]")
RAIL_MOTION = "time [s],rail [{0}],elbow [{1}],rail [{0}/s],elbow [{1}/s]\n0,0,0,0,0\n2,0.2,90,0,0"
TABLE_OF_A_PACKAGE = (
    "joint1:\n  limit:\n    lower: -2.7437\n    upper: 2.7437\n    velocity: 2.62\n"
)
_RECORD = records.file_of(catalogue.load("six-axis")).read_text(encoding="utf-8")

# Texts are written, arrays saved, others made by a function of the path.
FILES = {
    # problems
    "cell.toml": problem(),  # 1 rad at 1 rad/s and 2 rad/s²: 1/1 + 1/2 s
    "two.toml": problem("[[0, 0], [0.1, 1], [0.2, 2], [0.3, 3]]", "[1, 1]", "[1, 1]"),
    "judged.toml": JUDGED,
    "jerky.toml": JUDGED.replace("[1, 1] }", "[4, 4], jerk = [40, 40] }"),
    "bom.toml": b"\xef\xbb\xbf" + problem().encode(),
    "cut.toml": "waypoints = [[",
    "line-4.toml": problem().replace("\n\n", "\n") + "= 3\n",
    "colour.toml": problem(more="colour = 1"),
    "typo.toml": problem(more="tolerence = 3"),
    "negative.toml": problem("[[0, 0], [1, 1]]", "[1, -3]", "[1, 1]"),
    "one-number.toml": problem(velocity="1.0"),
    "torque-limits.toml": problem(more="max_torque = [3]"),
    "torque-inside.toml": problem(velocity="[1], max_torque = [3]"),
    "velocity-beside.toml": problem(more="velocity = [3]"),
    "degrees.toml": problem("[[0], [40], [20], [60]]", "[2]", "[4]", unit='"deg"'),
    "radians.toml": problem("[[0], [40], [20], [60]]", "[2]", "[4]").replace(
        'angle_unit = "rad"', 'units = {waypoints = "deg", limits = "rad"}'
    ),
    "forward.toml": problem("[[0], [0.5], [2]]", "[[0, 1]]"),
    "nowhere.toml": problem("[[0], [0.5], [2]]", "[[0, 0]]"),
    "too-fast.toml": problem("[[0], [9]]", more="start_velocity = [1.5]"),
    "touching.toml": problem("[[0.1], [0.7]]", "[1]", "[3], position = [[0.1, 0.7]]"),
    "rail.toml": problem("[[0, 0], [0.2, 90]]", "[1, 360]", "[1, 1]").replace(
        'angle_unit = "rad"',
        'units = {waypoints = ["m", "deg"], limits = "rad"}\njoint_names = ["rail", "elbow"]',
    ),
    # waypoints
    "w.csv": "one\n0\n1\n",
    "w.json": '{"waypoints": [[0], [1]]}',
    "w.npy": np.array([[0.0], [1.0]]),
    "ww.csv": "one,two\n0,0\n1,1\n",
    "bare.csv": "0,0\n1,1\n",
    "goal.csv": "one\n1\n",
    "turned.csv": "j\n3.0\n-3.0\n",
    "named.csv": "name,j1,j2\nhome,0,0\npick,0.4,-0.2\n",
    "numbered.csv": "Pt,j1,j2\n1,0,0\n2,0.4,-0.2\n",
    "gripper.csv": "j1,j2,grip\n0,0,True\n0.4,-0.2,False\n",
    "w.xlsx": b"PK\x03\x04\x14\x00",
    "objects.json": '[{"j1":0,"j2":0},{"j1":1,"j2":1}]',
    "timed.csv": "t,q1,q2,q3,q4,q5,q6\n0,0,-90,90,-90,-90,0\n1,40,-70,80,-100,-90,20\n",
    # robots and limits
    "robot.urdf": robot("one"),
    "two.urdf": robot("one", "two"),
    "xacro.urdf": robot('<xacro:arm prefix="x"/>', "one", head=XACRO),
    "prefix.urdf": robot("${prefix}one", "one", head=XACRO),
    "expanded.urdf": robot('<xacro:property name="w" value=".2"/>', "one", head=XACRO),
    "spaces.urdf": robot("one", head="<robot name='r' xmlns='http://www.ros.org'>"),
    "gains.urdf": robot("one").replace("</joint>", '<controller_gains Kd="0"/></joint>'),
    "rates.urdf": robot("one").replace("<limit", '<limit current="10" gear_velocity="10"'),
    "continuous.urdf": robot(CONTINUOUS),
    "rail.urdf": robot(RAIL, "elbow"),
    "limits.yaml": limits(one=A),
    "two.yaml": limits(one=VA, two=VA),
    "ab.yaml": limits(b="{max_velocity: 5, max_acceleration: 1}").replace(
        "limits:\n", "limits:\n  a: {max_velocity: 5, max_acceleration: 1}\n"
    ),
    "j.yaml": limits(j1=LOOSE, j2=LOOSE),
    "q.yaml": limits(q1=LOOSE, q2=LOOSE),
    "twoo.yaml": limits(one=A, twoo="{max_velocity: 1}"),
    "onne.yaml": limits(onne="{max_velocity: 3}", two=VA),
    "scaled.yaml": limits(FACTORS, one=A),
    "factors.yaml": FACTORS,
    "moveit.yaml": "move_group: {ros__parameters: {default_velocity_scaling_factor: 0.5}}",
    "inside.yaml": limits(default_velocity_scaling_factor="0.1", one=A),
    "off.yaml": limits(one="{has_acceleration_limits: false, max_acceleration: 0}"),
    "efforts.yaml": limits(one="{max_acceleration: 2, has_effort_limits: true, max_effort: 9}"),
    "no-efforts.yaml": limits(one="{max_acceleration: 2, has_effort_limits: false, max_effort: 9}"),
    "cartesian.yaml": limits(one=A) + "cartesian_limits: {max_trans_vel: 1}\n",
    "velocities.yaml": limits(one="{max_velocity: 9}"),
    "package.yaml": TABLE_OF_A_PACKAGE,
    # motions
    "motion.yaml": MESSAGE,
    "motion.csv": "time [s],one [rad],one [rad/s]\n0,0,0\n3,1,0\n",
    "other-joint.yaml": MESSAGE.replace("[one]", "[two]"),
    "namespace.yaml": MESSAGE.replace("[one]", "[left/one]"),
    "no-unit.csv": "time [s],one,one_velocity\n0,0,0\n3,1,0\n",
    "fast.csv": FAST,
    "slow.csv": SLOW,
    "lines.csv": "time [s],one [rad]\n0,0\n1,0.5\n2,0.6\n",
    "mixed.csv": "time,q0,q1,mode,q0_Tq,q1_Tq\n0,0,0,auto,1,2\n0.5,1,1,auto,1,2\n1,2,2,auto,1,2\n",
    "renamed.csv": "time [s],one [rad],two [rad],mode [-],q0_Tq [-],q1_Tq [-]\n"
    "0,0,0,auto,1,2\n0.5,1,1,auto,1,2\n1,2,2,auto,1,2\n",
    "q01.csv": "t,q0 [rad],q1 [rad]\n0,0,0\n0.5,1,1\n",
    "rail.csv": RAIL_MOTION.format("m", "deg"),
    "swapped.csv": RAIL_MOTION.format("deg", "m"),
    "no-times.csv": "q1,q2\n0,0\n0.1,-0.05\n0.2,-0.1\n",
    "twice.csv": f"time [s],q1 [rad],q1 [rad]\n{STEPS}",
    "preamble.csv": f"Robot: two-joint\nRate: 10 Hz\n\ntime [s],q1 [rad],q2 [rad]\n{STEPS}",
    "finger.csv": "time [s],q1,q2,finger_joint1\n0,0,0,0.01\n0.5,0.5,-0.25,0.02\n1,1,-0.5,0.03\n",
    "ms.csv": "time [ms],q1,q2\n0,0,0\n500,0.5,-0.25\n1000,1,-0.5\n",
    "edited.json": _RECORD.replace("1.48", "1.47", 1),  # its seal is broken
    # of other kinds
    "other.toml": "[project]\nname = 'x'\n",
    "other.json": '{"a": [1, 2]}',
    "other.yaml": "services:\n  web: {image: nginx}\n",
    "script.py": "import numpy as np\n",
    "page.md": "# A page\n\n```python\nimport numpy as np\n```\n",
    "page.html": "<!DOCTYPE html><html><body><svg></svg></body></html>",
    "p.src": "DEF demo()\nPTP {A1 0, A2 -90, A3 90, A4 0, A5 0, A6 0}\nEND\n",
    "p.script": "def demo():\n  movej([0,-1.5708,1.5708], a=1.4, v=1.05)\nend\n",
    "p.mod": "MODULE Demo\n  PROC main()\n    MoveAbsJ [[0,-20]], v1000;\n  ENDPROC\n",
    "empty.csv": "",
    "empty.toml": "",
    "other.h5": lambda path: h5py.File(path, "w").close(),
    "picture.png": lambda path: Image.new("RGB", (4, 4)).save(path),
    "folder": Path.mkdir,
}
ONE = "--urdf robot.urdf --limits limits.yaml"
PROBLEMS = "expected a problem file (.toml), a built-in name, or waypoints: give limits with --urdf"
STATED = "expected a problem file (.toml), which `trajopt new` writes, or a built-in name"
MOTIONS = "expected a motion: a CSV with a column of times, a ROS message, arrays"
RESULTS = "expected results: a folder that `trajopt compare` has filled, or its results.h5"
WAYPOINTS = "expected waypoints, a row of joint positions each (.csv, .txt, .npy, .json)"

TABLE = {
    "Words that nobody knows get the nearest that is known": [
        ("nonsense", 2, "nonsense … compare"),
        ("list more", 2, "more"),
        ("plan six-axes", 2, "no problem is called 'six-axes' … six-axis"),
        ("plan SIX-AXIS", 2, "did you mean 'six-axis'?"),
        ("plan one-joint --planner topra", 2, "topra … toppra"),
        ("plan one-joint --planner TOPPRA", 2, "did you mean 'toppra'?"),
        ("race six-axis topra", 2, "topra … toppra"),
        ("compare one-joint --against nobody --output new", 2, "nobody"),
        ("plan w.csv --robot ur5", 2, "did you mean 'ur5e'"),
        ("plan w.csv --robot panda", 2, "did you mean 'franka-panda'?"),
        ("suite show robot", 2, "did you mean 'robots'"),
        ("suite export robot x", 2, "did you mean 'robots'"),
        ("claims fang", 2, "no published problem is called 'fang'; known: "),
        ("best-known list nothing", 2, "no problem is called 'nothing'"),
        ("front one-joint --measure snap", 2, "snap"),
        ("PLAN cell.toml", 2, 'Did you mean "plan"?'),
        ("suite SHOW robots", 2, 'Did you mean "show"?'),
        ("help Compare", 2, 'Did you mean "compare"?'),
        ("plan one-joint --PLANNER exact", 2, 'Did you mean "--planner"?'),
        ("plan one-joint --Planner exact", 2, "Did you mean --planner?"),
        ("plan one-joint --colour", 2, "--colour"),
    ],
    "A name in another's place is told apart": [
        ("plan toppra", 2, "trajopt: toppra is a planner, not a problem; "),
        ("plan one-joint --planner six-axis", 2, "trajopt: six-axis is a problem, not a planner; "),
        (
            "compare --suite robots-ur5e-w4",
            2,
            "suite is 'robots-ur5e-w4': expected the name of a suite; "
            "this is a problem's, which goes without --suite",
        ),
        ("best-known propose slow.csv judged.toml", 2, "'judged.toml': expected a problem of a"),
    ],
    "An old name gets the new one": [
        ("certify six-axis", 2, "trajopt: the command certify is now called prove"),
        ("compare six-axis --certify", 2, "trajopt: the option --certify is now called --prove"),
        ("plan six-axis --planner certify", 2, "'certify'; it is now called 'prove'"),
    ],
    "A command alone says what it needs, with an example": [
        ("judge", 2, "needs MOTION … trajopt judge"),
        ("judge motion.csv", 2, "needs PROBLEM … trajopt judge"),
        ("explain six-axis", 2, "needs --planner … trajopt explain"),
        ("plan --planner exact", 2, "PROBLEM"),
        ("compare", 2, "PROBLEM"),
        ("verify", 2, "PATH"),
        ("best-known propose slow.csv", 2, "PROBLEM: expected the problem"),
        ("new mine --robot ur5e", 2, "waypoints are missing: expected a file"),
    ],
    "A number is what it must be, in range, and written as a number": [
        ("plan one-joint --seed x", 2, "--seed … x"),
        ("plan one-joint --seed -1", 2, '"-1" for --seed'),
        ("plan one-joint --seed 1e3", 2, "--seed … 1e3"),
        ("plan one-joint --seed 1_000", 2, "--seed … 1_000"),
        ("plan one-joint --seed 9223372036854775808", 2, "--seed"),
        ("plan one-joint --rate 1_0", 2, "--rate … 1_0"),
        ("plan one-joint --rate 0", 2, "--rate … 0"),
        ("plan one-joint --rate 1e300", 2, '"1e+300" for --rate'),
        ("plan one-joint --rate nan", 2, "--rate … nan"),
        ("compare one-joint --seeds 0", 2, '"0" for --seeds'),
        ("compare one-joint --seeds 1000000000000", 2, '"1000000000000" for --seeds'),
        ("compare one-joint --jobs 0", 2, '"0" for --jobs'),
        ("compare one-joint --timeout 1e300", 2, '"1e+300" for --timeout'),
        ("compare one-joint --timeout 0.5", 2, '"0.5" for --timeout'),
        ("compare one-joint --memory inf", 2, "--memory … inf"),
        ("compare one-joint --memory 0.1", 2, '"0.1" for --memory'),
        ("prove one-joint --time-limit nan", 2, "--time-limit … nan"),
        ("prove one-joint --within 0", 2, "positive"),
        ("claims fang2020-task1 --time-limit 0", 2, "Must be > 0"),
        ("suite show random --size 2.5", 2, "--size … 2.5"),
        ("suite show random --size 100000000000000000000", 2, '"100000000000000000000" for --size'),
        ("suite show edges --size 0", 2, "size"),
        ("report folder --trajectories -1", 2, '"-1" for --trajectories'),
        ("front one-joint --durations 2,x", 2, "--durations"),
        ("front one-joint --durations 2,-1", 2, "--durations"),
        ("front one-joint --durations 1.2", 2, "durations is 1.2"),
        ("front one-joint --time-limit -1", 2, "--time-limit"),
        ("judge slow.csv judged.toml --via-tolerance -1", 2, "via-tolerance"),
        ("judge slow.csv judged.toml --via-tolerance 1", 2, "via_tolerance is 1.0"),
        ("verify motion.csv --limits cell.toml --noise 1e308", 2, "noise is 1e+308: expected a nu"),
        (f"plan w.csv {ONE} --tool-speed 0", 2, "--tool-speed"),
    ],
    "An option of a planner is one of its own, of its kind": [
        ("plan one-joint --planner pso:colour=1", 2, "pso … colour … population"),
        ("plan one-joint --planner pso:iterations", 2, "iterations … key=value"),
        ("plan one-joint --planner pso:iterations=many", 2, "iterations … many … int"),
        ("plan one-joint --planner pso:population=30.0", 2, "population … 30.0 … int"),
        ("plan one-joint --planner pso:timing=never", 2, "timing … never … shared"),
        ("plan one-joint --planner unoptimised:segment_time=1e999", 2, "1e999 … float"),
        ("plan one-joint --planner exact:starts=0", 2, "starts … 0"),
        ("compare one-joint --planner pso:x=1", 2, "pso … x"),
    ],
    "What does not go together is said": [
        ("plan w.csv --robot ur5e --urdf x", 2, "--robot or --urdf, not both"),
        ("plan six-axis --robot ur5e", 2, "--robot is 'ur5e': expected no such flag with six-axis"),
        ("compare --suite six-axis --robot ur5e", 2, "expected no such flag with --suite"),
        ("plan bare.csv --robot puma-560", 2, "6 columns (joint_1"),
        ("plan w.csv --robot ur5e --unit grad", 2, "--unit"),
        ("judge slow.csv six-axis", 2, "joints is 2: expected 6"),
        ("judge slow.csv judged.toml --interpolation quintic", 2, "no accelerations"),
        ("verify motion.csv cell.toml", 2, "cell.toml: PATH: expected motions only"),
        ("verify slow.csv", 2, "--limits: expected joint_limits.yaml, a robot or a problem"),
        ("verify slow.csv --limits ur5e", 2, "slow.csv: joint_names is ['a', 'b']"),
        ("verify results --limits cell.toml", 2, "PATH is 'results': expected a motion's"),
        ("plan one-joint --out m.csv --cycle 0.001 --rate 1000", 2, "--cycle or --rate, not both"),
        ("plan one-joint --out m.png --points breaks", 2, "'breaks': expected left out for a .png"),
        ("plan one-joint --out m.csv --points some", 2, "--points"),
        ("plan one-joint --out m.csv --cycle 0", 2, "--cycle"),
        ("plan one-joint --out m.doc", 2, "a file ending in .csv, .json, .yaml"),
        (
            "plan one-joint --out m.csv --as goal",
            2,
            "--as is 'goal': expected left out for m.csv; a goal's file ends in .yaml",
        ),
        (f"verify motion.csv {ONE} --out m.xlsx", 2, "expected a file ending in .csv, .json"),
        ("plan cell.toml --at 0.5", 2, "--from FILE and --at SECONDS, both or neither"),
        ("plan cell.toml --from motion.csv", 2, "--from FILE and --at SECONDS, both or neither"),
        ("plan cell.toml --from motion.csv --at 99", 2, "a time from 0 to"),
        (f"plan goal.csv {ONE}", 2, "at least two rows"),
        (f"verify motion.csv --before motion.csv --at 4 {ONE}", 2, "a time from 0 to 3 s"),
        ("chunk lines.csv --limits limits.yaml --fastest --at-given-times", 2, "not both"),
        ("chunk lines.csv --limits limits.yaml --at 0.1", 2, "both or neither"),
        ("prove six-axis --family best", 2, "spline353"),
        ("prove seven-waypoints --family spline353", 2, "4 waypoints"),
        ("compare one-joint --planner unoptimised --output w.csv", 2, "w.csv"),
        ("export out --to csv --output x", 2, "since --to is csv"),
        ("export out --to latex --out x", 2, "since --to is latex"),
        ("best-known propose slow.csv six-axis", 2, "joints is 2: expected 6"),
        ("best-known propose lines.csv one-joint", 2, "motion: expected one that solves one-joint"),
        ("best-known propose folder one-joint", 2, "PROBLEM is 'one-joint': expected left out"),
        ("best-known propose folder --method mine", 2, "--method is 'mine': expected left out"),
        ("best-known verify --registry w.csv", 2, "--registry is 'w.csv': expected a folder"),
        ("claims pmm-race", 2, "a problem that can be stated here, but its limits are Euclidean"),
    ],
    "A front is not of other problems": [
        ("front moving-start", 2, "no front here: it does not know … start velocity"),
        ("front demands-wait", 2, "no front here: it does not know … dwell"),
        ("front robots-franka-fr3-w4", 2, "no front here: it does not know … velocity"),
        ("front demands-random-020", 2, "no front here: it does not know … tolerance"),
    ],
    "A file that is not there is said, with one that is": [
        ("plan no.toml", 2, "no.toml: it does not exist: expected a file that is there"),
        ("plan no.csv --robot ur5e", 2, "no.csv: it does not exist: expected a file that is there"),
        ("plan w.csv --robot ur5e --limits no.yaml", 2, "no.yaml: it does not exist"),
        ("plan cell.toml --from no.csv --at 0.5", 2, "does not exist"),
        ("judge no.csv cell.toml", 2, "no.csv: it does not exist: expected a file that is there"),
        ("judge slow.csv no.toml", 2, "no.toml"),
        ("verify moton.csv --before motion.csv --at 1 --limits cell.toml", 2, "perhaps motion.csv"),
        ("verify nowhere", 2, "nowhere"),
        ("report folder", 2, "folder"),
        ("best-known propose no.csv one-joint", 2, "no.csv"),
        ("best-known propose nowhere one-joint", 2, "SOURCE is 'nowhere': expected a file or fol"),
    ],
    "A file of the wrong kind is named for what it is": [
        ("plan w.csv", 2, f"trajopt: w.csv is a CSV of waypoints; {PROBLEMS}"),
        ("plan w.json", 2, f"trajopt: w.json is a JSON file of waypoints; {PROBLEMS}"),
        ("prove w.npy", 2, f"trajopt: w.npy is a NumPy array; {PROBLEMS}"),
        ("explain robot.urdf --planner exact", 2, f"robot.urdf is a URDF; {PROBLEMS}"),
        ("compare motion.yaml", 2, f"trajopt: motion.yaml is a ROS message; {PROBLEMS}"),
        ("judge motion.csv empty.toml", 2, f"trajopt: empty.toml is an empty file; {PROBLEMS}"),
        ("new x.toml other.toml", 2, f"other.toml is a TOML file of another kind; {PROBLEMS}"),
        ("claims script.py", 2, f"trajopt: script.py is a Python file; {STATED}"),
        ("best-known list page.md", 2, f"trajopt: page.md is a Markdown file; {STATED}"),
        ("best-known verify motion.csv", 2, f"motion.csv is a CSV of a motion; {STATED}"),
        ("judge empty.csv cell.toml", 2, f"trajopt: empty.csv is an empty file; {MOTIONS}"),
        ("judge other.h5 cell.toml", 2, f"trajopt: other.h5 is an HDF5 file; {MOTIONS}"),
        ("compare cell.toml --motion other.yaml", 2, f"YAML file of another kind; {MOTIONS}"),
        ("plan w.csv --urdf page.html", 2, "is an HTML page; expected a URDF behind --urdf"),
        ("plan w.csv --limits picture.png", 2, "is a picture; expected a joint_limits.yaml behind"),
        ("export cell.toml --to csv", 2, f"cell.toml is a problem file; {RESULTS}"),
        ("report other.json", 2, f"other.json is a JSON file of another kind; {RESULTS}"),
        ("verify limits.yaml --robot ur5e", 2, f"limits.yaml is a joint_limits.yaml; {MOTIONS}"),
        ("verify folder", 2, "folder … results folder"),
        ("verify cut.toml", 2, "cut.toml is a problem file; expected results"),
        ("verify other.h5", 2, "other.h5"),
        ("verify motion.csv --limits robot.urdf", 2, "is a URDF; expected a joint_limits.yaml"),
        ("plan w.xlsx --limits two.yaml", 2, f"is a spreadsheet; {WAYPOINTS}; save the sheet as"),
        ("plan objects.json --robot ur5e", 2, f"{WAYPOINTS}; a list of rows of numbers is one"),
        ("plan p.src --robot ur5e", 2, "p.src is a robot program; expected"),
        ("plan p.script --robot ur5e", 2, "p.script is a robot program"),
        ("plan p.mod --robot ur5e", 2, "are not read: write the joint positions of its moves as a"),
        (
            "plan timed.csv --robot ur5e --unit deg",
            2,
            "remove the column of times to plan through its positions",
        ),
        (
            "plan w.csv --limits package.yaml",
            2,
            "package.yaml is a table of a robot description package; expected a joint_limits.yaml "
            "behind --limits; its limits are in the URDF made of it, which goes behind --urdf",
        ),
        (
            "judge cell.toml motion.csv",
            2,
            "trajopt: motion.csv is a CSV of a motion; expected a problem file … "
            "; `trajopt judge MOTION PROBLEM` takes the motion first",
        ),
        ("judge motion.yaml limits.yaml", 2, "`trajopt verify MOTION --limits FILE` judges"),
        ("verify no-times.csv --limits q.yaml", 2, f"a CSV of waypoints; {MOTIONS[:30]}"),
    ],
    "An edited trial is told as that": [
        ("verify edited.json", 2, "edited.json: damaged … its checksum differs"),
        ("judge edited.json six-axis", 2, "edited.json: damaged … its checksum differs"),
        ("report edited.json", 2, "edited.json: damaged … its checksum differs"),
    ],
    "A problem file's own errors name the file, the place, and what is right": [
        ("plan cut.toml", 2, "cut.toml … TOML"),
        (
            "plan line-4.toml",
            2,
            "line-4.toml: problem cannot be read (Invalid statement (at line 4",
        ),
        ("plan colour.toml", 2, "colour.toml … colour … waypoints"),
        ("plan typo.toml", 2, "typo.toml: tolerence is 3: expected the key tolerance"),
        ("plan negative.toml", 2, "negative.toml … velocity … joint 2 … -3"),
        ("plan one-number.toml", 2, "a list with a number, or a pair [low, high], for every joint"),
        ("plan nowhere.toml", 2, "expected a positive number, or low < 0 < high"),
        ("plan velocity-beside.toml", 2, "velocity is … : expected this key under [limits]"),
        ("plan torque-limits.toml", 2, "expected this key left out: torques have a name of their"),
        ("plan torque-inside.toml", 2, "expected this key left out: torques have a name of their"),
    ],
    "Options of other tools get what comes nearest": [
        ("plan cell.toml --max-torque 3", 2, "is no option: torques have a name of their own"),
        ("plan cell.toml --payload-mass 3", 2, "is no option: masses have places of their own"),
        (
            "plan cell.toml --tcp-speed 3",
            2,
            "is no option: of the tool's limits, that of its speed",
        ),
        ("plan cell.toml --obstacles 3", 2, "is no option: obstacles are not … the nearest"),
        ("compare cell.toml --wait=3", 2, "is no option: a wait has a name of its own"),
        ("plan cell.toml --dt 0.01", 2, "`trajopt plan --cycle`"),
        ("plan cell.toml --format goal", 2, "--as goal"),
        ("plan cell.toml --jerk 50", 2, "max_jerk of a joint_limits.yaml"),
        ("plan cell.toml --velocity=2", 2, "max_velocity, max_acceleration"),
        (
            "verify motion.csv --robot ur5e --tolerance 0.1",
            2,
            "nearest is tolerance (rad) beside the waypoints of a problem file, to plan near them",
        ),
    ],
    # 1 rad from rest to rest at 1 rad/s and 2 rad/s² takes 1/1 + 1/2 s.
    "Waypoints are planned, proved, explained and compared like a problem": [
        (f"plan w.csv {ONE} --planner exact", 0, "exact on … (w.csv): solved … certified 1.500000"),
        (f"plan w.json {ONE} --planner exact", 0, "certified 1.500000 s"),
        (f"plan w.npy {ONE} --planner exact", 0, "certified 1.500000 s"),
        (
            f"prove w.csv {ONE} --json",
            0,
            '"lower_bound": 1.4999 … "upper_bound": 1.5000 … "status": "proved"',
        ),
        (f"explain w.json {ONE} --planner ruckig-stop --json", 0, '"certified_duration": 1.5'),
        (
            f"compare one-joint w.csv {ONE} --planner ruckig-stop --jobs 1",
            0,
            "w: certified durations … 1.5000",
        ),
        ("plan bom.toml --planner exact", 0, "certified 1.500000 s"),
        ("plan ww.csv --limits two.yaml --planner exact --json", 0, '"certified_duration": 1.5'),
        (
            "plan named.csv --limits j.yaml --unit rad --planner exact",
            0,
            "certified 0.632456 s",  # 2 √(0.4 / 4)
            "named.csv: left out: name",
        ),
        (
            "plan numbered.csv --limits j.yaml --unit rad --planner exact",
            0,
            "certified 0.632456 s",
            "numbered.csv: left out: column 1",
        ),
        (
            "plan gripper.csv --limits j.yaml --unit rad --planner exact",
            0,
            "certified 0.632456 s",
            "gripper.csv: left out: grip",
        ),
    ],
    "A scaling factor counts in what plans, and in nothing that judges; who forgets is told": [
        (
            "plan w.csv --urdf robot.urdf --limits scaled.yaml --planner exact",
            0,
            "certified 2.500000 s",  # 1/0.5 + 0.5/1
            "planned with 50 % of the velocity and 50 % of the acceleration limits … write 1.0",
        ),
        (
            "prove w.csv --urdf robot.urdf --limits scaled.yaml",
            0,
            "2.5000",
            "planned with 50 % of the velocity and 50 %",
        ),
        (
            "plan w.csv --urdf robot.urdf --limits factors.yaml --acceleration 2 --planner exact",
            0,
            "certified 2.500000 s",
            "planned with 50 % of the velocity and 50 %",
        ),
        (
            "plan w.csv --urdf robot.urdf --limits moveit.yaml --acceleration 2 --planner exact",
            0,
            "certified 2.250000 s",  # 1/0.5 + 0.5/2
            "planned with 50 % of the velocity",
        ),
        (
            "plan w.csv --limits factors.yaml",
            2,
            "at least one joint, or --robot or --urdf beside the scaling factors",
        ),
        ("plan w.csv --limits inside.yaml", 2, "expected this key one level up, beside joint_limi"),
        (
            "new scaled.toml w.csv --urdf robot.urdf --limits scaled.yaml",
            0,
            "scaled.toml: edit it, then run: trajopt plan scaled.toml",
            "its default scaling factors (velocity 0.5, acceleration 0.5) are not applied",
        ),
        (
            "verify motion.yaml --urdf robot.urdf --limits scaled.yaml",
            0,
            "feasible",
            "(velocity 0.5, acceleration 0.5) are not applied",
        ),
        (
            "judge motion.yaml w.csv --urdf robot.urdf --limits scaled.yaml",
            0,
            "feasible",
            "(velocity 0.5, acceleration 0.5) are not applied",
        ),
    ],
    "A URDF with more in it is read; what xacro must expand is not": [
        ("plan w.csv --urdf gains.urdf --acceleration 2 --planner exact", 0, "certified 1.500000"),
        ("plan w.csv --urdf expanded.urdf --acceleration 2 --planner exact", 0, "1.500000 s"),
        ("plan w.csv --urdf spaces.urdf --acceleration 2 --planner exact", 0, "1.500000 s"),
        (
            "plan w.csv --urdf rates.urdf --acceleration 2 --planner exact",
            0,
            "1.500000 s",
            "gear_velocity",  # a rate that is not read is named
        ),
        ("plan w.csv --urdf xacro.urdf --acceleration 2", 2, "xacro"),
        ("plan w.csv --urdf prefix.urdf --acceleration 2", 2, "xacro"),
    ],
    # From 3 to −3 rad at 2 rad/s and 4 rad/s²: 2 √((2π − 6) / 4) s, or 6/2 + 2/4 s.
    "A continuous joint takes the nearest way": [
        (
            "plan turned.csv --urdf continuous.urdf --acceleration 4 --unit rad --planner exact",
            0,
            "certified 0.532",
            "the nearest way is taken (not with --no-unwrap) by continuous j",
        ),
        (
            "plan turned.csv --urdf continuous.urdf --acceleration 4 --unit rad --planner exact "
            "--no-unwrap",
            0,
            "certified 3.500000 s",
        ),
    ],
    "Limits that are missing, switched off, unknown or in vain are said": [
        (
            "plan w.csv --urdf robot.urdf",
            2,
            "robot.urdf: acceleration limit is missing (this URDF has none) … one; add --limits",
        ),
        (
            "plan w.csv --urdf robot.urdf --limits off.yaml",
            2,
            "limit is switched off (has_acceleration_limits: false): expected one for one",
        ),
        (
            "verify motion.yaml --urdf robot.urdf --limits off.yaml",
            0,
            "feasible",
            "accelerations are not judged",
        ),
        (
            "verify motion.csv --limits velocities.yaml",
            0,
            "feasible",
            "accelerations are not judged",
        ),
        (
            "plan ww.csv --urdf two.urdf --limits twoo.yaml",
            2,
            "acceleration limit is missing: expected one for two; … for all of them; "
            "twoo.yaml: left out, as two.urdf has no such joint: twoo (perhaps two)",
        ),
        (
            "plan ww.csv --urdf two.urdf --limits twoo.yaml --acceleration 2 --planner exact",
            0,
            "solved",
            "trajopt: twoo.yaml: left out, as two.urdf has no such joint: twoo (perhaps two)",
        ),
        (
            "plan w.csv --urdf robot.urdf --limits efforts.yaml --planner exact",
            0,
            "solved",
            "efforts, which count where a limit of torque asks for them (--torque urdf)",
        ),
        ("plan w.csv --urdf robot.urdf --limits no-efforts.yaml --planner exact", 0, "solved"),
        (
            "plan w.csv --urdf robot.urdf --limits cartesian.yaml --planner exact",
            0,
            "solved",
            "cartesian.yaml: cartesian_limits is left out: of the tool's limits, that",
        ),
        (
            f"verify motion.yaml {ONE} --acceleration 3",
            0,
            "within robot.urdf, limits.yaml, 3 rad/s² for joints without one: feasible",
            "--acceleration 3 has no effect: every joint has an acceleration limit already",
        ),
        (
            "verify motion.yaml --limits cell.toml --acceleration 3",
            0,
            "feasible",
            "--acceleration 3 has no effect",
        ),
        ("verify motion.yaml --urdf robot.urdf --acceleration 3", 0, "feasible"),
        (
            "plan robots-ur5e-w4 --tool-speed 1 --planner exact",
            1,
            "it does not know tool speed limits",
        ),
        ("plan robots-crs-a255-w4 --tool-speed 1", 2, "link frames"),
        (
            f"plan w.csv {ONE} --payload 2",
            2,
            "--payload is 2.0: expected a limit that it weighs on",
        ),
    ],
    "Joints have the robot's names": [
        (
            f"verify other-joint.yaml {ONE}",
            2,
            "other-joint.yaml: joint_names is ['two']: expected … one; rename them",
        ),
        (
            f"judge other-joint.yaml w.csv {ONE}",
            2,
            "other-joint.yaml: joint_names is ['two']: expected … one; rename them",
        ),
        (f"verify namespace.yaml {ONE}", 0, "feasible"),
        (
            "verify q01.csv --limits two.yaml",
            2,
            "q01.csv: joint_names is ['q0', 'q1']: expected joints of two.yaml (it says no order): "
            "one, two; rename them",
        ),
        ("judge q01.csv ww.csv --limits two.yaml", 1, "not feasible"),
    ],
    "Units are not guessed": [
        ("judge no-unit.csv cell.toml", 2, "expected the unit of angles: --motion-unit deg"),
        (f"judge no-unit.csv w.csv {ONE} --unit rad", 2, "the unit of angles: --motion-unit deg"),
        (f"judge no-unit.csv w.csv {ONE} --unit rad --motion-unit rad", 0, "feasible"),
        ("judge no-unit.csv cell.toml --unit rad", 0, "feasible"),
        (
            f"judge motion.yaml w.csv {ONE} --motion-unit deg",
            2,
            "--motion-unit is 'deg': expected no such flag with motion.yaml",
        ),
        (
            "compare cell.toml --motion motion.yaml --motion-unit deg",
            2,
            "--motion-unit is 'deg': expected no such flag with motion.yaml",
        ),
        (
            "plan degrees.toml --planner unoptimised",
            0,
            "solved",
            "trajopt: warning: degrees.toml: … units.limits",
        ),
        ("plan radians.toml --planner unoptimised", 0, "solved"),
        ("judge rail.csv rail.toml", 1, "waypoint … m rail"),
        (
            "judge swapped.csv rail.toml",
            2,
            "unit, joint 1 is 'rad': expected a unit of m: rail slides",
        ),
    ],
    "A log that cannot be read is shown a header that can": [
        (
            "verify mixed.csv --urdf two.urdf --acceleration 2",
            2,
            "trajopt: mixed.csv: header: expected the unit of angles: -- … rename the columns of "
            "mixed.csv: time [s],one [rad],two [rad],mode [-],q0_Tq [-],q1_Tq [-]",
        ),
        (
            "judge mixed.csv ww.csv --limits two.yaml",
            2,
            "rename the columns of "
            "mixed.csv: time [s],one [rad],two [rad],mode [-],q0_Tq [-],q1_Tq [-]",
        ),
        (
            "verify renamed.csv --limits two.yaml --interpolation linear",
            1,
            "not feasible",
            "renamed.csv: left out: mode, q0_Tq, q1_Tq",
        ),
        ("verify twice.csv --limits q.yaml", 2, "'q1': expected a column that is not there twice"),
        (
            "verify preamble.csv --limits q.yaml",
            2,
            "expected a header; text above it may begin with",
        ),
        ("verify finger.csv --limits q.yaml", 2, "q1 [rad],q2 [rad],finger_joint1 [-]"),
        ("verify ms.csv --limits q.yaml", 2, "time [ms],q1 [rad],q2 [rad]"),
    ],
    "A plan says who planned what, and what is certified": [
        ("plan edges-two-waypoints --planner ruckig-stop", 0, "solved … certified 1.500000 s"),
        (
            "plan two.toml --planner unoptimised:segment_time=0.5",  # joint 2 goes ten times as far
            0,
            "on two (two.toml): solved … velocity 6.200000 of limit 2 … acceleration … of limit 2",
        ),
        (
            "plan seven-waypoints --planner unoptimised --out t.csv",
            1,
            "unsupported",
            "trajopt: t.csv",
        ),
        ("plan six-axis --planner exact", 0, "solved", "", "best known motion"),
        # 1.5 rad from rest, then as far as it goes at 1 rad/s, 2 rad/s²: h/v + v/a
        ("plan forward.toml --planner exact", 0, "certified 2.500000 s"),
        # 0.5 rad/s too fast at 2 rad/s²: 0.25 s, at 1.25 rad/s all that time
        (
            "plan too-fast.toml",
            1,
            "is beyond its limit, 1 rad/s: it brakes to it in 0.25 s and 0.3125 rad at least",
        ),
        # on both position limits, at numbers that round
        ("plan touching.toml --planner ruckig-stop", 0, "position 0 rad margin", "", "beyond"),
        ("list", 0, "ignores jerk and position limits"),
        ("list planners", 0, "refuses jerk limits"),
    ],
    # Twice as fast as 1 rad/s² allows: slowed down 2 times velocities halve, accelerations quarter.
    "A motion is judged": [
        (
            "judge slow.csv judged.toml",
            0,
            "slow.csv on judged: feasible … Executed with 2 cubic pieces between its samples. "
            "… certified 2.000000 s … 1.000 times the best known optimum, 2.0000 s "
            "… figure: results/judge/judged-slow.csv.png",
        ),
        (
            "judge fast.csv judged.toml",
            1,
            "not feasible … Slowed down 2.000000 times, to 2.000000 s, it keeps every limit. "
            "… multiply the planner's limits: velocity 0.5000, acceleration 0.2500. "
            "… 4.000000 of limit",
        ),
        (
            "judge fast.csv judged.toml --json",
            1,
            '"motion": "fast.csv", "interpolation": "cubic" … "certified_duration": 2.0',
        ),
        (
            "judge slow.csv judged.toml --interpolation linear",
            1,
            "Slowing down does not help … send velocities too",
            "",
            "certified",
        ),
        ("verify fast.csv --limits ab.yaml", 1, "Slowed down 2.000000 times, to 2.000000 s, it ke"),
        ("verify fast.csv --limits judged.toml", 1, "Slowed down 2.000000 times, to 2.000000 s"),
        ("verify slow.csv --limits ab.yaml", 0, "feasible"),
        # 1 rad within 4 rad/s² takes 2 √(1/4) = 1 s
        (
            "judge slow.csv jerky.toml",
            1,
            "Slowing down does not help: joint 1 at 1 s: acceleration jumps by 2 rad/s² "
            "… jerk limits: It could run 2.000000 times as fast within every limit, in 1.000000 s. "
            "… takes 2.0000 s on jerky without jerk limits, 2.000 times the best known",
        ),
        ("verify lines.csv --limits cell.toml", 1, "--interpolation spline"),
    ],
    "What is published is told with what is proved": [
        (
            "claims fang2020-task1",
            0,
            "not yet compared with the publisher's page proved optimum: 4 s (ruckig-search); "
            "no motion is faster than … "
            "equal: as long as the best known motion, to the digits printed",
            "",
            "unproved",
        ),
        ("claims", 0, "trajopt claims PROBLEM"),
        ("claims topico-example3", 0, "No time was published, or none was read."),
    ],
}
ROWS = [pytest.param(Row(*row), id=row[0]) for rows in TABLE.values() for row in rows]


def matched(words: str, text: str) -> bool:
    """Return whether the words are in a text in their order, with anything at `…`."""
    pattern = ".*".join(re.escape(part.strip()) for part in words.split("…"))
    return re.search(pattern, text) is not None


@pytest.mark.parametrize("row", ROWS)
def test_command(row, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    for name, content in FILES.items():
        if name in row.command:
            path = Path(name)
            if isinstance(content, str | bytes):
                path.write_bytes(content.encode() if isinstance(content, str) else content)
            elif isinstance(content, np.ndarray):
                np.save(path, content)
            else:
                content(path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    with pytest.raises(SystemExit) as ended:
        main(row.command.split())
    out, err = capsys.readouterr()
    assert ended.value.code == row.code, out + err
    said, noted = (" ".join(text.split()) for text in (out, err))
    if row.code == 2:
        assert out == ""
        assert re.fullmatch(r"trajopt: [^\n]+\n", err)
        assert matched(row.says, noted), err
        assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    else:
        assert matched(row.says, said), out
        assert matched(row.notes, noted) if row.notes else err == "", err
    if "--json" in row.command:
        assert isinstance(json.loads(out), dict)
    assert not row.never or row.never not in out + err
