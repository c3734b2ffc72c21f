"""The LaTeX tables of planners and of tests, by hand on made-up trials."""

from __future__ import annotations

from test_results import OTHER, run

from trajopt import Results
from trajopt.views.export import latex


def cells(text):
    """The cells of each line of a table, as LaTeX prints them."""
    lines = [line.removesuffix(r" \\") for line in text.splitlines() if " & " in line]
    return [
        [cell.replace("$", "").replace("\\", "") for cell in line.split(" & ")] for line in lines
    ]


def made():
    """The rival's medians are 20 % above the optimum of both problems, the other's 50 %."""
    first = [*run("exact", 2.0), *run("near", 2.4, 2.4), *run("far", 3.0, 2.3)]
    second = [(name, 2 * duration) for name, duration in (("exact", 2.0), ("near", 2.4))]
    for name, duration in second:
        first += run(name, duration, problem=OTHER)
    return Results([*first, *run("far", 6.0, problem=OTHER)])


def test_the_planners_are_held_against_a_rival(tmp_path):
    results = made()
    assert latex.rival(results) == "near"
    heading, exact, near, far = cells(latex.planners(results, "near"))
    assert heading == [
        "planner",
        "problems",
        "solved",
        "gap (%)",
        "worst (%)",
        *("rank", "shorter", "p (Holm)"),
    ]
    assert exact == ["exact", "2", "2 of 2", "+0.00", "+0.00", "1.00", "1.00", "1.000"]
    assert near == ["near", "2", "3 of 3", "+20.00", "+20.00", "2.00", "--", "--"]
    # medians 2.65 and 6: 32.5 % and 50 %. One of two runs is shorter on the first, none on the
    # second; both problems are of one group, so that the signs of a test are one coin.
    assert far == ["far", "2", "3 of 3", "+41.25", "+50.00", "3.00", "0.25", "1.000"]
    latex.write(results, tmp_path, "far")
    written = (tmp_path / "planners.tex").read_text(encoding="utf-8")
    assert cells(written)[3][6:] == ["--", "--"]
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "planners.tex",
        "summary.tex",
        "tests.tex",
    ]


def test_both_tables_say_for_how_many_tests_p_is_adjusted():
    """Two rivals of one planner, and all three pairs."""
    results = made()
    assert "% p: of that test, adjusted for the 2 tests here; " in latex.planners(results, "near")
    assert latex.tests(results).startswith("% Holm: p adjusted for the 3 tests here; ")


def test_ranks_that_no_planner_has_are_no_column():
    results = Results([*run("exact", 2.0), *run("near", 2.4, 2.4), *run("near", 4, problem=OTHER)])
    text = latex.planners(results, "near")
    heading, *_ = cells(text)
    assert heading == [
        "planner",
        "problems",
        "solved",
        "gap (%)",
        *("worst (%)", "shorter", "p (Holm)"),
    ]
    assert "% no mean rank: fewer than three planners were run on every problem" in text


def test_every_pair_has_a_line_once():
    heading, *rows = cells(latex.tests(made()))
    assert heading[:5] == ["planner", "against", "better", "tied", "worse"]
    pairs = [tuple(row[:2]) for row in rows]
    assert pairs == [("exact", "near"), ("exact", "far"), ("near", "far")]
    assert rows[2][2:7] == ["2", "0", "0", f"{((2.4 / 2.65) * (4.8 / 6)) ** 0.5:.4f}", "0.75"]


def test_one_problem_is_compared_over_runs():
    items = [*run("a", 2.0, 2.1, 2.2), *run("b", 2.3, 2.4, 2.5), *run("c", 2.6)]
    heading, row = cells(latex.tests(Results(items)))
    assert heading == ["planner", "against", "ratio", "shorter", "95 %", "p", "p (Holm)"]
    # all 9 pairs of runs won: 2 of 20 ways to deal the ranks
    assert row[:4] == ["a", "b", f"{2.1 / 2.4:.4f}", "1.00"]
    assert row[-2:] == ["0.100", "0.100"]
