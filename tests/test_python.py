"""What a Python user meets first: short reprs, equal problems, `plan`, `write`, progress."""

from __future__ import annotations

import io
import re
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import trajopt
from trajopt import (
    InvalidInput,
    Limits,
    Planner,
    Problem,
    Solution,
    Status,
    Trajectory,
    WrongType,
    verify,
)
from trajopt.benchmark.run.progress import Line, Progress, reporter
from trajopt.cli import main
from trajopt.core.exceptions import TrajoptError
from trajopt.formats import samples_csv
from trajopt.planners.registry import entries, load

# Bang-bang over 1 rad within 1 rad/s²: 2 √(h / a) = 2 s, at 1 rad/s.
PROBLEM = Problem([[0.0], [1.0]], Limits([10.0], [1.0]), "one")
DURATION = 2.0


def test_the_version_is_that_of_the_distribution() -> None:
    project = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    assert trajopt.__version__ == tomllib.loads(project)["project"]["version"]


def test_problems_are_equal_by_their_numbers() -> None:
    same = Problem(np.array([[0], [1]]), Limits([[-10.0, 10.0]], [1.0]), "another name")
    other = Problem([[0.0], [1.0]], Limits([10.0], [1.0 + 1e-15]), "one")
    assert same == PROBLEM
    assert other != PROBLEM
    assert PROBLEM != "one"
    assert {PROBLEM, same, other} == {same, other}


def test_limits_are_equal_by_their_numbers() -> None:
    limits = Limits([10.0, 2.0], [1.0, 1.0], position=[[0.0, 1.0], [-1.0, 1.0]])
    same = Limits([[-10.0, 10.0], 2.0], [1, 1], position=[[-0.0, 1.0], 1.0])
    others = [
        Limits([10.0, 2.0], [1.0, 1.0]),
        Limits([10.0], [1.0]),
        Limits([10.0, 2.0 + 1e-15], [1.0, 1.0], position=limits.position),
    ]
    assert same == limits
    assert hash(same) == hash(limits)
    assert limits not in [*others, "limits"]


def test_errors_of_write_name_its_arguments(tmp_path: Path) -> None:
    answer = trajopt.plan("one-joint")
    with pytest.raises(InvalidInput, match=r"^path is .*m\.txt': expected a file ending in"):
        trajopt.write(tmp_path / "m.txt", answer)
    with pytest.raises(InvalidInput, match=r"^cycle is 10\.0: expected a shorter one"):
        trajopt.write(tmp_path / "m.csv", answer, cycle=10.0)
    with pytest.raises(InvalidInput, match=r"^points is 'breaks': expected left out for a \.png"):
        trajopt.write(tmp_path / "m.png", answer, points="breaks")


def test_reprs_are_one_short_line() -> None:
    answer = trajopt.plan(PROBLEM)
    judgement = trajopt.judge(PROBLEM, Trajectory([0, 4], [[[0.25]], [[0.0]]], [0, 4]))
    said = [repr(PROBLEM), repr(answer), repr(answer.solution), repr(judgement)]
    assert said[0] == "Problem('one', 2 waypoints, 1 joint, limits: velocity, acceleration)"
    assert said[1] == "Trial(exact on one, seed 0, solved, 2 s certified)"
    assert said[2] == "Solution(solved, 2 s)"
    assert said[3].startswith("Judgement(")
    assert " on one, Certificate(invalid: velocity jumps" in said[3].replace("joint 1 at 0 s: ", "")
    assert all(len(line) < 200 and "\n" not in line for line in said)
    failed = Solution(Status.FAILED, message="Traceback\nValueError: no", lower_bound=1.5)
    assert repr(failed) == "Solution(failed, lower bound 1.5 s, ValueError: no)"


@pytest.mark.parametrize("name", entries())
def test_every_planner_says_what_a_problem_is(name: str) -> None:
    try:
        planner = entries()[name].load()
    except TrajoptError as error:
        pytest.skip(str(error))
    for call in (planner.solve, lambda rows: planner.solve_batch(rows, [0])):
        with pytest.raises(WrongType) as found:
            call([[0], [1]])  # type: ignore[arg-type]
        assert isinstance(found.value, TypeError)
        said = str(found.value)
        assert "expected a trajopt.Problem, got [[0], [1]]: make one with Problem(" in said
        assert "\n" not in said


def test_a_function_that_plans_says_so_too() -> None:
    def mine(problem: Problem, *, seed: int = 0) -> Solution:
        raise AssertionError

    with pytest.raises(TypeError, match="make one with Problem"):
        trajopt.planners.planner.of_function(mine).solve([[0], [1]])  # type: ignore[arg-type]
    for ask in (trajopt.plan, lambda rows: trajopt.compare([rows], ["exact"])):
        with pytest.raises(TypeError, match="make one with Problem"):
            ask([[0], [1]])


def test_plan_chooses_as_the_command_does() -> None:
    jerk = Problem([[0.0], [1.0]], Limits([10.0], [10.0], jerk=[1.0]))
    assert trajopt.plan(PROBLEM).planner == "exact"
    answer = trajopt.plan(jerk)
    assert answer.planner == "exact-jerk"
    # pieces of jerk +1, −1, −1, +1 of t each: h = 2 J t³
    assert answer.certified_duration == pytest.approx(4 * (1 / 2) ** (1 / 3), rel=1e-6)
    named = trajopt.plan("one-joint", "ruckig-stop")
    assert (named.planner, named.problem.name) == ("ruckig-stop", "one-joint")


def test_write_makes_a_file_for_a_controller(tmp_path: Path) -> None:
    answer = trajopt.plan(PROBLEM)
    file = tmp_path / "motion.csv"
    written = trajopt.write(file, answer, cycle=0.01)
    assert written is not None
    assert written.certificate.feasible
    samples = samples_csv.read(file)
    assert samples.times[-1] == pytest.approx(DURATION, abs=0.021)
    np.testing.assert_allclose(np.diff(samples.times), 0.01, atol=1e-9)
    message = trajopt.write(str(tmp_path / "motion.json"), answer)
    assert message is None
    with pytest.raises(trajopt.InvalidInput, match=r"a file ending in \.csv"):
        trajopt.write(tmp_path / "motion.docx", answer)


# --- progress ---


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_is_one_line_that_is_rewritten(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = _Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    clock = iter([0.0, 0.0, 10.0, 10.1, 100.0])
    line = Line(clock=lambda: next(clock))
    for finished in (40, 60, 70, 100):
        line(Progress(total=100, finished=finished, kept=40))
    shown = stream.getvalue().split("\r")[1:]
    assert [text.rstrip() for text in shown] == [
        "40 of 100 trials after 0 s",
        "60 of 100 trials after 10 s, about 20 s left",  # 20 in 10 s, 40 to go
        "100 of 100 trials after 1 min 40 s",
    ]
    assert len(shown[2].removesuffix("\n")) == len(shown[1])  # nothing of the longer one is left


def test_an_answer_stays_above_the_line_that_is_rewritten(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = _Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    line = Line(answers=True, clock=lambda: 0.0)
    line(Progress(total=9, finished=0, kept=0))
    line(Progress(total=9, finished=1, kept=0, ended="exact on arm: 2.0000 s"))
    line(Progress(total=9, finished=9, kept=0, ended="pso on arm: failed"))
    assert [text.rstrip() for text in stream.getvalue().split("\r")[1:]] == [
        "0 of 9 trials after 0 s",
        "exact on arm: 2.0000 s",
        "1 of 9 trials after 0 s, about 0 s left",
        "pso on arm: failed",
        "9 of 9 trials after 0 s",
    ]
    log = io.StringIO()
    monkeypatch.setattr(sys, "stderr", log)
    Line(answers=True, rewritten=False)(Progress(9, 1, 0, "exact on arm: 2.0000 s"))
    assert log.getvalue() == ""


def test_single_runs_answer_first(tmp_path: Path) -> None:
    """Of the main job nothing was seen for 20 s: `exact`, which takes 0.02 s, came last."""
    said: list[str] = []
    trajopt.compare(
        "one-joint",
        ["pso:iterations=1", "unoptimised", "exact"],
        tmp_path,
        seeds=2,
        jobs=1,
        progress=lambda state: said.append(state.ended),
    )
    start, *answers = [text.partition(" on one-joint: ") for text in said]
    assert start[0] == ""
    assert [name for name, *_ in answers] == ["unoptimised", "exact", "pso:iterations=1"]
    assert answers[-1][2].endswith(" s, the median of 2 runs")


def test_progress_is_shown_where_somebody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    state = Progress(total=2, finished=1, kept=0)

    def shown(stream: io.StringIO | None, wanted: bool | None) -> bool:
        monkeypatch.setattr(sys, "stderr", stream)
        reporter(wanted)(state)
        return bool(stream and stream.getvalue())

    assert shown(_Terminal(), None)
    assert shown(io.StringIO(), True)
    assert not shown(io.StringIO(), None)
    assert not shown(_Terminal(), False)
    assert not shown(None, None)
    seen: list[Progress] = []
    reporter(seen.append)(state)
    assert seen == [state]


def test_a_swapped_call_of_judge_says_the_order(tmp_path: Path) -> None:
    for name in ("theirs.csv", "theirs.yaml"):
        with pytest.raises(InvalidInput, match=r"theirs.*: expected .*: judge\(problem, motion\)$"):
            trajopt.judge(tmp_path / name, "six-axis")


def test_python_errors_name_arguments_not_options(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,a,b\n0,0,0\n0.5,1,1\n", encoding="utf-8")
    problem = trajopt.Problem([[0, 0], [1, 1]], trajopt.Limits([1, 1], [1, 1]))
    for unit in (None, "grad"):
        with pytest.raises(InvalidInput) as caught:
            trajopt.judge(problem, log, unit=unit)
        assert "unit=" in str(caught.value)
        assert "--" not in str(caught.value)


def test_a_notebook_shows_progress_as_one_output(monkeypatch: pytest.MonkeyPatch) -> None:
    outputs: list[str] = []

    class Handle:
        def update(self, content: dict[str, str], *, raw: bool) -> None:
            outputs[-1] = content["text/plain"]

    def display(content: dict[str, str], *, raw: bool, display_id: bool) -> Handle:
        outputs.append(content["text/plain"])
        return Handle()

    stream = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=display))
    for wanted in (None, True, False):
        report = reporter(wanted)
        report(Progress(total=2, finished=0, kept=0))
        report(Progress(total=2, finished=2, kept=0))
    assert outputs == ["2 of 2 trials after 0 s"] * 2
    assert stream.getvalue() == ""


def test_what_is_there_already_shows_no_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for expected in (True, False):
        stream = _Terminal()
        monkeypatch.setattr(sys, "stderr", stream)
        trajopt.compare([PROBLEM], ["exact"], tmp_path)
        assert ("1 of 1 trials" in stream.getvalue()) is expected


def test_verify_and_write_say_what_they_take(tmp_path):
    problem = PROBLEM
    spline = CubicSpline([0.0, 1.0], [[0.0], [1.0]], bc_type="clamped")
    solution = load("exact").solve(problem)
    wrong = [
        (lambda: verify(problem, spline), "expected a trajopt.Trajectory.*from_ppoly"),
        (lambda: verify(problem, solution), "expected a trajopt.Trajectory"),
        (lambda: verify(solution.trajectory, problem), "expected a trajopt.Problem"),
        (lambda: trajopt.write(tmp_path / "m.csv", solution), "an answer of trajopt.plan"),
    ]
    for call, said in wrong:
        with pytest.raises(WrongType, match=said):
            call()


class Returned(Planner):
    """No dataclass, and its answer is an array."""

    def solve(self, problem, *, seed=0):
        return problem.waypoints


def test_one_problem_and_one_planner_need_no_list(tmp_path):
    results = trajopt.compare(PROBLEM, "ruckig-stop", tmp_path)
    assert {trial.planner for trial in results.items} >= {"ruckig-stop"}
    with pytest.raises(
        InvalidInput, match="problem is 'one': expected left out beside kind='profile'"
    ):
        results.plot("one", kind="profile")


def test_limits_of_a_trial_need_a_process(tmp_path):
    for limit in ({"timeout": 5.0}, {"memory": 1.0}):
        with pytest.raises(InvalidInput, match="jobs=1 or more"):
            trajopt.compare(PROBLEM, "toppra", tmp_path, jobs=0, **limit)


def test_what_solve_returns_is_named_in_a_line(tmp_path):
    @dataclass(frozen=True)
    class Framed(Returned):
        pass

    [trial] = [
        t for t in trajopt.compare(PROBLEM, Framed(), tmp_path).items if t.planner == "Framed"
    ]
    assert trial.message.splitlines()[-1].endswith("got array([[0.], [1.]])")


def test_a_planner_of_a_file_that_is_no_dataclass_is_refused_in_a_line(
    tmp_path, monkeypatch, capsys
):
    lines = [
        "from trajopt import Planner",
        "class Plain(Planner):",
        "    def __init__(self, iterations=20):",
        "        self.iterations = iterations",
        "    def solve(self, problem, *, seed=0):",
        "        return None",
    ]
    monkeypatch.chdir(tmp_path)
    Path("plain.py").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["compare", "one-joint", "--planner", "./plain.py:Plain", "--jobs", "1"])
    assert ended.value.code == 2
    assert re.fullmatch(r"trajopt: [^\n]*frozen dataclass[^\n]*\n", capsys.readouterr().err)
