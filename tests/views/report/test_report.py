"""The report's numbers against the trials themselves, its curves against hand counts."""

from __future__ import annotations

import base64
import gzip
import json
import math
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trials import as_runs

from trajopt import Limits, Problem, Relation, Solution, Status, Trajectory
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial, trials_of
from trajopt.core.exceptions import InvalidInput
from trajopt.explain.active_limits import share_at_limits
from trajopt.formats.motion import motion
from trajopt.judgement import GivenMotion
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.views import packing, report, table_cells
from trajopt.views.analysis.searches import histories
from trajopt.views.report import content, origin, rivals, suite_curves
from trajopt.views.report import panels as motions
from trajopt.views.results import Results

NASTY = "evil:note=</script><b>&"


class Made(Planner):
    """A quintic over 1 rad of a given duration per seed; None is an answer that never came."""

    stochastic = True

    def __init__(self, *durations: float | None, message: str = "gave up") -> None:
        self.durations, self.message = durations, message

    def options(self) -> dict[str, object]:
        return {}

    def relation(self, problem: Problem) -> Relation:
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        return None

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        t = self.durations[seed]
        if t is None:
            return Solution(Status.FAILED, message=self.message)
        h, start = problem.displacements[0, 0], problem.waypoints[0, 0]
        c = [6 * h / t**5, -15 * h / t**4, 10 * h / t**3, 0, 0, start]
        history = np.array([[1, np.nan], [10, 2 * t], [100, t]])
        found = Trajectory(np.array([0, t]), np.reshape(c, (6, 1, 1)), np.array([0, t]))
        return Solution(Status.SOLVED, found, evaluations=100, history=history)


def problem(name: str, end: float = 1.0) -> Problem:
    return Problem([[0.0], [end]], Limits([10.0], [100.0]), name)


def run(name: str, *durations: float | None, on: Problem | None = None) -> list[Trial]:
    chosen = on or problem("one")
    planner = Made(*durations, message="Traceback:\n  line 7\nValueError: <gave> up")
    trials = []
    for seed in range(len(durations)):
        (trial,) = trials_of(planner, chosen, [seed], name)
        of_a_package = trial.provenance | {"planner_distribution": "made"}
        trials.append(replace(trial, provenance=of_a_package))
    return trials


@cache
def made() -> list[Trial]:
    two = problem("two", 0.5)
    return [
        *run("exact", 2.0),
        *run("mine", 2.5, 3.0, None),
        *run(NASTY, None),
        *run("exact", 4.0, on=two),
        *run("mine", 4.0, 4.4, 5.0, on=two),
        *run("fast", 1.9),
    ]


def blob(html: str, name: str) -> Any:
    (text,) = re.findall(rf'<script type="text/plain" id="blob-{name}">([^<]*)</script>', html)
    unpacked = gzip.decompress(base64.b64decode(text)).decode()
    return unpacked if name == "plotly" else json.loads(unpacked)


class Page(HTMLParser):
    """Cells of the table of results, link targets, identifiers and outside addresses."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.values: list[dict[str, str]] = []
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = {k: v or "" for k, v in attributes}
        if "data-row" in found:
            self.values.append({})
        if "data-value" in found:
            self.values[-1][found["data-label"]] = found["data-value"]
        self.links += [found[k] for k in ("href", "src") if k in found]
        self.ids |= {found["id"]} if "id" in found else set()


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    assert report.write(Results(made()), path, command="trajopt compare one two") == path
    return path.read_text(encoding="utf-8")


def test_the_page_needs_nothing_from_outside(html: str) -> None:
    page = Page(html)
    assert page.links
    assert {link.partition(":")[0] for link in page.links if ":" in link} == {"data"}
    assert all(link.startswith(("#", "data:,")) for link in page.links)
    assert "@import" not in html
    assert "url(" not in html
    assert '<link rel="stylesheet' not in html


def test_a_page_says_whose_trials_it_shows(html: str, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    assert not report.is_of(Results(made()), path)
    path.write_text(html, encoding="utf-8")
    assert report.is_of(Results(made()), path)
    assert not report.is_of(Results(made()[:-1]), path)
    again = [replace(made()[0], started="2026-01-01T00:00:00+00:00"), *made()[1:]]
    assert not report.is_of(Results(again), path)


def test_every_number_of_the_table_is_the_results_own(html: str) -> None:
    rows = Page(html).values
    summary = Results(made()).summary()
    table = blob(html, "data")
    assert len(rows) == len(summary) == len(table["rows"]) == 6
    for written, row in zip(rows, table["rows"], strict=True):
        name, label = table["problems"][row["problem"]]["name"], table["planners"][row["planner"]]
        own = summary[(summary["problem"] == name) & (summary["label"] == label["label"])].iloc[0]
        for title, column in (
            ("certified (s)", "median"),
            ("gap (%)", "gap"),
            ("kept limits", "kept"),
            ("time (s)", "solve_time"),
        ):
            shown = float(written[title]) if written[title] else np.nan
            nothing_kept = column == "kept" and np.isnan(own["median"])
            np.testing.assert_equal(shown, np.nan if nothing_kept else own[column])
        # these motions are the smoothest of their durations, in closed form
        if np.isfinite(own["median"]):
            assert float(written["× least"]) == pytest.approx(1, rel=1e-6)


def test_every_trial_is_there_at_full_precision(html: str) -> None:
    table = blob(html, "data")
    items = made()
    trials = table["trials"]
    assert trials["id"] == [t.id for t in items]
    assert trials["certified_duration"] == [t.certified_duration for t in items]
    assert trials["claimed_duration"] == [t.claimed_duration for t in items]
    assert [table["messages"][i] for i in table["message"]] == [t.message for t in items]
    assert sorted(i for row in table["rows"] for i in row["trials"]) == list(range(len(items)))
    for row in table["rows"]:
        assert len({(items[i].label, items[i].problem.name) for i in row["trials"]}) == 1
        assert [items[i].seed for i in row["trials"]] == list(range(len(row["trials"])))


def test_links_lead_to_rows_trials_problems_and_planners_that_exist(html: str) -> None:
    page = Page(html)
    table = blob(html, "data")
    for link in page.links:
        kind, _, rest = link.removeprefix("#").partition("-")
        if kind == "row":
            assert int(rest.partition("-")[0]) < len(table["rows"])
        elif kind == "trial":
            assert rest in table["trials"]["id"]
        elif kind == "planner":
            assert int(rest) < len(table["planners"])
        elif link.startswith("#"):
            assert link.removeprefix("#") in page.ids


def test_the_command_of_a_trial_runs_its_problem_and_planner(html: str, tmp_path: Path) -> None:
    table = blob(html, "data")
    specs = {row["spec"] for row in table["rows"]}
    assert "trajopt plan one.toml --planner mine" in specs
    assert f"trajopt plan one.toml --planner '{NASTY}'" in specs
    text = next(p["toml"] for p in table["problems"] if p["name"] == "one")
    (tmp_path / "one.toml").write_text(text, encoding="utf-8")
    assert Problem.from_toml(tmp_path / "one.toml").digest() == problem("one").digest()


def test_a_built_in_problem_goes_by_its_name_an_impostor_does_not() -> None:
    items = [
        *run("mine", 2.0, on=problem("one-joint")),
        *trials_of(load("unoptimised"), suite.load("one-joint"), [0], ""),
    ]
    page = content.page(Results(items))
    assert sorted(page.names) == [
        "one-joint",
        f"one-joint-{problem('one-joint').digest()[:8]}.toml",
    ]


def test_what_is_written_by_others_cannot_leave_its_place(html: str) -> None:
    assert "<b>&" not in html
    assert "ValueError: &lt;gave&gt; up" in html
    assert len(re.findall("</script>", html)) == len(re.findall("<script", html))
    assert NASTY in [p["label"] for p in blob(html, "data")["planners"]]


def test_failures_have_their_status_and_whole_reason(html: str) -> None:
    found = content.page(Results(made())).failures
    assert {(f["label"], f["status"], f["count"]) for f in found} == {
        ("mine", "failed", 1),
        (NASTY, "failed", 1),
    }
    assert "Traceback:\n  line 7\nValueError: &lt;gave&gt; up</pre>" in html


def test_failures_are_grouped_by_kind_and_not_by_number() -> None:
    (lost,) = run("mine", None)
    messages = [
        "no answer after 20 steps",
        "no answer after 300 steps",
        "no best 3-5-3",
        "no best 4-5-3",
    ]
    trials = [replace(lost, message=message) for message in messages]
    found = content.page(Results(as_runs(trials))).failures
    assert [(line["count"], line["reason"]) for line in found] == [
        (2, "no answer after … steps"),
        (1, "no best 3-5-3"),
        (1, "no best 4-5-3"),
    ]


def test_an_endless_reason_is_clipped_but_its_trial_has_it_all(tmp_path: Path) -> None:
    (lost,) = run("mine", None)
    endless = replace(lost, message="x" * 100_000 + "the end")
    page = report.write(Results([endless]), tmp_path / "r.html").read_text(encoding="utf-8")
    assert page.count("x" * 400) < 100
    assert "xthe end" in page
    assert blob(page, "data")["messages"] == [endless.message]


def test_trials_below_the_reference_are_in_the_red_box(html: str) -> None:
    (below,) = [t for t in made() if t.planner == "fast"]
    box = html[html.index('id="suspicious"') : html.index('id="planners"')]
    assert f'href="#trial-{below.id}"' in box
    assert "1.9 s</a> against 2 s (−5 %)" in box
    honest = [t for t in made() if t.planner != "fast"]
    assert content.page(Results(honest)).suspicious == []


def test_what_gaps_are_measured_against_and_how_much_is_proved() -> None:
    (exact,) = run("exact", 2.0)
    bound = replace(
        exact, planner="prove", label="prove", solution=replace(exact.solution, lower_bound=1.6)
    )
    assert content.page(Results([exact, bound])).references == [
        "Gaps are to the exact optimum, 2.000000 s: proved within 25.000 % (lower bound "
        "1.600000 s)."
    ]
    assert "best known, not proved" in content.page(Results([exact])).references[0]
    assert content.page(Results(run("mine", 2.0))).references == ["No reference: gaps are unknown."]


def test_profiles_and_ecdfs_count_no_answer_as_the_worst(html: str) -> None:
    table = blob(html, "data")
    suite = table["suites"][0]
    names = [p["label"] for p in table["planners"]]
    profile = {names[c["planner"]]: c for c in suite["profile"]}
    assert set(profile) == {"exact", "mine"}
    assert suite["partly"] == {NASTY: 1, "fast": 1}
    # The medians of "mine" are 3 of (2.5, 3, no answer) and 4.4; of "exact", 2 and 4; "fast", on
    # one of the problems, 1.9.
    assert profile["exact"]["y"][0] == 0.5
    assert profile["exact"]["y"][-1] == profile["mine"]["y"][-1] == 1.0
    steps = [
        x
        for x, y, z in zip(
            profile["mine"]["x"], [0, *profile["mine"]["y"]], profile["mine"]["y"], strict=False
        )
        if z > y
    ]
    np.testing.assert_allclose(steps, [1.1, 3 / 1.9], rtol=0.005)
    ecdf = {names[c["planner"]]: c for c in suite["ecdf"]}
    assert ecdf["mine"]["y"][-1] == pytest.approx(5 / 6, abs=1e-4)  # 1 of 6 runs has no answer
    assert ecdf["exact"]["y"][0] == 1.0


def test_gaps_are_shares_of_problems_and_not_of_runs() -> None:
    two = problem("two", 0.5)
    items = [
        *run("exact", 2.0),
        *run("exact", 2.0, on=two),
        *run("mine", 3.0, 3.0, 3.0, 3.0, 3.0),
        *run("mine", None, on=two),
    ]
    page = content.page(Results(items))
    (own,) = [
        c for c in suite_curves.suites(page)[0]["ecdf"] if page.labels[c["planner"]] == "mine"
    ]
    assert own["y"][-1] == 0.5  # five runs solve the one problem, the only one misses the other


def test_a_planner_with_half_of_its_answers_missing_has_no_median_gap() -> None:
    items = [
        *run("exact", 2.0),
        *run("exact", 2.0, on=problem("two", 0.5)),
        *run("mine", 3.0),
        *run("mine", None, on=problem("two", 0.5)),
    ]
    mine = next(p for p in content.page(Results(items)).planners if p["label"] == "mine")
    assert (mine["gap"], mine["worst"]) == ("none", "+50.00")
    assert mine["solved"]["text"] == "50 %"
    # Wilson (1927), one success of two: (1 + z²/4 ± z √(1/8 + z²/16) …), 9.45 % to 90.55 %
    assert mine["solved"]["interval"] == "9–91"


def test_convergence_is_as_certified_and_endless_without_an_answer() -> None:
    slow, fast, lost = run("mine", 0.05, 3.0, None)  # 0.05 s needs a dilation
    best, runs = histories([slow, fast, lost])
    assert slow.certificate is not None
    assert np.isnan(best)
    (band,) = suite_curves.bands(runs, ["mine"])
    assert band["low"][-1] == pytest.approx((0.05 * slow.certificate.dilation + 3.0) / 2, rel=1e-5)
    assert band["middle"][-1] == pytest.approx(3.0)
    assert band["high"][-1] == np.inf
    assert band["x"][0] == 1
    assert packing.finite(band)["low"][0] is None


def test_searches_are_compared_with_the_best_353_and_every_lost_run_counts() -> None:
    other = problem("two", 0.5)
    items = [
        *run("spline353-nlp", 2.0),
        *run("spline353-nlp", 3.0, on=other),
        *run("mine", 2.01, 2.4),
        *run("mine", None, None, on=other),
        *run("quick", 1.0),
        *run("quick", 4.0, on=other),
    ]
    page = content.page(Results(items))
    suite = suite_curves.suites(page)[0]
    assert suite["searched"] == 2
    curve = next(c for c in suite["times"] if page.labels[c["planner"]] == "mine")
    assert curve["y"][-1] == 0.25  # one of four runs came within 1 %
    assert 99 <= curve["x"][-1] <= 101
    assert "quick" not in {page.labels[c["planner"]] for c in suite["convergence"]}


def test_what_a_search_costs_is_in_the_page_as_counted_by_hand() -> None:
    # Each run has 2t after 10 evaluations and t after 100, the best 3-5-3 is 2 and 3 s.
    other = problem("two", 0.5)
    items = [
        *run("spline353-nlp", 2.0),
        *run("spline353-nlp", 3.0, on=other),
        *run("mine", 2.01, 2.1, None),
        *run("mine", 3.0, 4.0, on=other),
    ]
    page = content.page(Results(items))
    cells = suite_curves.suites(page)[0]["ert"][str(page.labels.index("mine"))]
    # The run without an answer left no count: charged 100, as the longest.
    assert cells == [("167", "3 of 5"), ("250", "2 of 5"), ("500", "1 of 5"), ("500", "1 of 5")]
    assert rivals.count(1234567.4) == "1\u202f234\u202f567"
    assert rivals.count(np.inf) == "∞"


def test_planners_are_compared_on_every_suite_both_ways() -> None:
    three = [problem(f"random-{n}", 0.5 + n) for n in range(3)]
    items = [t for p in three for t in (*run("mine", 2.0, 2.2, on=p), *run("other", 2.1, on=p))]
    items += [*run("mine", 3.0, on=problem("edge")), *run("other", None, on=problem("edge"))]
    page = content.page(Results(items))
    whole, part = suite_curves.suites(page)
    mine = page.labels.index("mine")
    other = page.labels.index("other")
    # 2.1 and 2.1 are tied; 2.0 and 2.2 against 2.1 even; on the edge only one has an answer.
    assert [text for text, _ in whole["paired"][other][str(mine)]["cells"]] == [
        "4",
        "1",
        "3",
        "0",
        "1.00000",
        "0.62",
        "1.000",
    ]
    assert [text for text, _ in whole["paired"][mine][str(other)]["cells"][:4]] == list("4031")
    assert [text for text, _ in part["paired"][other][str(mine)]["cells"][:4]] == list("3030")
    assert part["name"] == "random"
    assert str(mine) not in whole["paired"][mine]


def test_ratios_and_probabilities_read_as_what_they_are() -> None:
    assert [table_cells.number(v) for v in (1.00002, 0.0, np.inf, np.nan)] == [
        "1.0000",
        "0.0000",
        "∞",
        "–",
    ]
    said = [table_cells.probability(v) for v in (1.0, 0.04996, 0.00099)]
    assert said == ["1.000", "0.050", "< 0.001"]


def test_the_first_to_compare_with_is_the_search_with_the_most_runs() -> None:
    items = [*run("exact", 1.0), *run("some", 2.0, 2.0), *run("most", 3.0, 3.0, 3.0)]
    assert rivals.first(items, ["exact", "some", "most"]) == 2
    assert rivals.first(items[:1], ["exact"]) == 0


def test_the_first_to_compare_with_answers_on_most_problems() -> None:
    """A swarm that solves one problem of two was the page's rival before a planner of both."""
    two = problem("two", 0.5)
    items = [*run("exact", 1.0), *run("exact", 1.0, on=two), *run("some", 2.0, 2.0, 3.0)]
    assert rivals.first(items, ["some", "exact"]) == 1


def test_how_far_limits_are_missed_is_said_to_three_digits() -> None:
    said = [table_cells.dilation(ratio) for ratio in (2.5, 1.03, 1.0000122, 1 + 4.6e-9)]
    assert said == ["× 2.5000", "× 1.0300", "–", "–"]
    kept = [table_cells.kept(0.0, ratio) for ratio in (1.03, 1.0000122, 1 + 4.6e-9, math.nan)]
    assert kept == ["0 %", "to rounding", "to rounding", "0 %"]


def test_groups_are_families_of_names_and_kinds_of_limits() -> None:
    jerky = Problem([[0.0], [1.0]], Limits([1.0], [1.0], [1.0]), "random-zigzag-j1-w2-01")
    plain = [problem(n, e) for n, e in (("random-zigzag-j1-w2-00", 1.0), ("random-smooth-1", 2.0))]
    found = suite_curves.groups({p.name: p for p in (jerky, *plain)})
    assert found == {
        "all problems": [jerky.name, *(p.name for p in plain)],
        "random-zigzag": [jerky.name, plain[0].name],
        "limits: velocity, acceleration": [p.name for p in plain],
    }


def test_what_else_is_asked_of_the_way_stands_beside_the_limits(tmp_path: Path) -> None:
    moving = replace(problem("moving"), demands={"start_velocity": [0.25], "end_velocity": [-1.5]})
    path = report.write(Results(run("ruckig-stop", None, on=moving)), tmp_path / "report.html")
    text = " ".join(path.read_text(encoding="utf-8").split())
    assert "acceleration; start velocity 0.25 rad/s; end velocity -1.5 rad/s</span>" in text


def test_the_median_run_is_drawn_as_certified_at_no_more_than_200_points() -> None:
    trials = run("mine", 0.05, 3.0, 2.0, None)
    panel = motions.panel(trials, ["mine"], with_motions=True)
    (motion,) = panel["motions"]
    assert motion["seed"] == 2
    assert len(motion["t"]) <= motions.POINTS
    t = np.array(motion["t"]) / 2.0
    np.testing.assert_allclose(motion["values"][0][0], 6 * t**5 - 15 * t**4 + 10 * t**3, atol=1e-4)
    assert motions.panel(trials, ["mine"], with_motions=False)["motions"] == []


@pytest.mark.parametrize("name", ["exact", "toppra"])
def test_the_time_at_a_limit_is_that_of_the_library(name: str) -> None:
    chosen = suite.load("one-joint")
    trajectory = load(name).solve(chosen).trajectory
    assert trajectory is not None
    share, held = motions.use(chosen, trajectory)
    assert share == pytest.approx(share_at_limits(chosen, trajectory), abs=1e-12)
    assert [s[3] - s[2] for s in held] == sorted((s[3] - s[2] for s in held), reverse=True)


def test_trajectories_left_out_are_named(tmp_path: Path) -> None:
    path = report.write(Results(made()), tmp_path / "r.html", trajectories=1)
    page = path.read_text(encoding="utf-8")
    assert re.search(
        r"trajectories of\s+1 of 2 problems are left out.*?</summary>\s+two</", page, re.S
    )
    assert blob(page, "problem-0")["motions"]
    assert not blob(page, "problem-1")["motions"]
    assert blob(page, "problem-1")["convergence"]


def test_only_failures_make_a_page_too(tmp_path: Path) -> None:
    path = report.write(Results(run("mine", None, None)), tmp_path / "r.html")
    suite = blob(path.read_text(encoding="utf-8"), "data")["suites"][0]
    assert [c["y"] for c in suite["profile"]] == [[0.0, 0.0]]
    assert suite["convergence"] == suite["ecdf"] == []


def test_no_trial_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="results"):
        report.write(Results([]), tmp_path / "r.html")


def test_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    items = made()
    one, two = (report.write(Results(items), tmp_path / f"{n}.html") for n in ("1", "2"))
    assert one.read_bytes() == two.read_bytes()


def test_looks_differ_for_every_planner_of_a_large_comparison() -> None:
    looks = [content.look(i) for i in range(28)]
    assert len({(one["colour"], one["dash"]) for one in looks}) == 28


def test_seeds_are_told_as_ranges() -> None:
    assert origin.ranges([0, 1, 2, 5, 7, 8]) == "0–2, 5, 7–8"
    assert origin.ranges([4]) == "4"


def test_facts_that_differ_between_trials_are_all_told() -> None:
    one, two = run("mine", 2.0, 3.0)
    other = replace(two, provenance=dict(two.provenance) | {"casadi": "9.9"})
    facts = dict(origin.facts([one, other]))
    assert facts["casadi"] == f"{one.provenance['casadi']} (1 trials); 9.9 (1 trials)"
    assert facts["python"] == one.provenance["python"]


def test_the_head_names_the_version_and_the_facts_every_commit() -> None:
    (one,) = run("mine", 2.0)
    other = replace(one, provenance=one.provenance | {"commit": "fedcba9876543210"})
    page = content.page(Results(as_runs([one, other])))
    assert f"; mintime {one.provenance['mintime']}; " in page.brief
    assert "fedcba9876543210 (1 trials)" in dict(page.facts)["commit"]


def test_the_command_runs_the_same_comparison_again() -> None:
    one = suite.load("one-joint")
    limits = {"timeout_limit": "60", "memory_limit": "1.5", "jobs": "2"}
    items = [*run("mine", 2.0, 2.1, 2.2, on=one), *run("exact", 2.0, on=problem("own one"))]
    items = [replace(trial, provenance=trial.provenance | limits) for trial in items]
    page = content.page(Results(items))
    assert page.command == (
        "trajopt compare one-joint own_one.toml --planner exact --planner mine --seeds 3 "
        "--timeout 60 --memory 1.5 --jobs 2"
    )
    facts = dict(page.facts)
    assert facts["time limit of a trial (s)"] == "60"
    assert facts["memory limit of a trial (GiB)"] == "1.5"
    assert facts["trials side by side"] == "2"
    assert "planner_digest" not in facts
    differing = [replace(items[0], provenance=items[0].provenance | {"jobs": "1"}), *items[1:]]
    assert "--jobs" not in content.page(Results(differing)).command


def test_a_whole_suite_goes_by_its_name() -> None:
    edges = suite.suites()["edges"].problems()
    trials = [run("mine", 2.0)[0]] + [replace(run("mine", 2.0)[0], problem=own) for own in edges]
    command = content.page(Results(trials)).command
    assert command == "trajopt compare one.toml --suite edges --planner mine --seeds 1"
    part = content.page(Results(trials[:-1])).command
    assert "--suite" not in part


def test_planners_are_named_with_the_distribution_that_they_are_of() -> None:
    (one,) = run("mine", 2.0)
    (two,) = trials_of(load("unoptimised"), problem("one"), [0], "unoptimised")
    stranger = {"planner_distribution": "strangers-planners", "planner_version": "1.2"}
    one = replace(one, provenance=one.provenance | stranger)
    told = origin.planners_code([one, two])
    assert told == f"strangers-planners 1.2: mine; mintime {two.provenance['mintime']}: unoptimised"


def test_the_command_line_does_not_know_planners_of_a_script(tmp_path: Path) -> None:
    (one,) = run("mine", 2.0)
    (two,) = trials_of(load("unoptimised"), problem("one"), [0], "unoptimised")
    one = replace(one, provenance=one.provenance | {"planner_distribution": ""})
    assert origin.scripted([one, two]) == ["mine"]
    file = report.write(Results([one, two]), tmp_path / "report.html")
    about = file.read_text(encoding="utf-8").partition('id="about"')[2]
    assert "From the script that ran it: mine" in about
    assert "<span>--planner</span> <span>unoptimised</span>" in about
    assert "<span>--planner</span> <span>mine</span>" not in about


def test_a_trial_of_a_script_or_of_a_file_shows_no_command_that_would_fail() -> None:
    (one,) = run("mine", 2.0)
    of_a_script = replace(one, provenance=one.provenance | {"planner_distribution": ""})
    assert origin.again(of_a_script, "one-joint") == (
        "",
        "mine was given in Python: the script that did so runs it again.",
    )
    spline = Path("docs/examples/motions/spline.csv")
    (judged,) = trials_of(GivenMotion(motion(spline)), problem("one"), [0], "spline.csv")
    command, instead = origin.again(judged, "one.toml")
    assert command == ""
    assert "trajopt compare one.toml --motion" in instead
    whole = content.page(Results([one, judged])).command
    assert whole == "trajopt compare one.toml --planner mine --motion spline.csv --seeds 1"
    assert origin.again(one, "one.toml") == ("trajopt plan one.toml --planner mine", "")


def test_between_seeds_there_is_a_table_where_problems_are_few() -> None:
    items = [*run("mine", 2.0, 2.1, 2.2), *run("other", 2.3, 2.4, None), *run("exact", 1.0)]
    (found,) = suite_curves.between_seeds(content.page(Results(items)))
    page = content.page(Results(items))
    mine = page.labels.index("mine")
    other = page.labels.index("other")
    line = found["paired"][other][str(mine)]
    # Every run of "mine" is the shorter: of C(6, 3) = 20 orders, 2 are as extreme.
    texts = [text for text, _ in line["cells"]]
    assert texts == ["3", "3", "2.1000", "2.4000", "0.87500", "1.00", "0.100"]
    assert not found["paired"][page.labels.index("exact")]  # one run
