"""The content of the report: the numbers of each table, as text and at full precision."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.views import race, table_cells
from trajopt.views.analysis import statistics
from trajopt.views.analysis.least_jerk import times_the_least
from trajopt.views.analysis.results import Tables
from trajopt.views.analysis.versions import by_problem
from trajopt.views.figures.draw import distinct_names, shown_motions
from trajopt.views.figures.style import BLACK, CURVES, MARKERS, places
from trajopt.views.report import lines, origin, verdict

MAX_NUMBERS_SAID = 12  # of a demand, in a problem's line
MAX_LEAST_SEARCHES = 20  # problems whose least ∫ jerk² is searched
MAX_WAYPOINTS_SHOWN = 50  # in a problem's table
NO_REFERENCE = "No reference: gaps are unknown."
DASHES = ("solid", "7px,2px", "2px,2px", "8px,2px,2px,2px")
SYMBOLS = {  # for each mark in figures: Plotly's name, and an SVG path around (15, 5)
    "o": ("circle", "M11.5 5a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0-7 0z"),
    "s": ("square", "M12 2h6v6h-6z"),
    "^": ("triangle-up", "M15 1l4 7h-8z"),
    "D": ("diamond", "M15 .5l4.5 4.5l-4.5 4.5l-4.5-4.5z"),
    "v": ("triangle-down", "M15 9l4-7h-8z"),
    "P": ("cross", "M14 1h2v3h3v2h-3v3h-2v-3h-3v-2h3z"),
    "X": ("x", "M12 1l3 3l3-3l1.2 1.2l-3 3l3 3l-1.2 1.2l-3-3l-3 3l-1.2-1.2l3-3l-3-3z"),
    "<": ("triangle-left", "M11 5l7-4v8z"),
    ">": ("triangle-right", "M19 5l-7-4v8z"),
}
TRIAL_COLUMNS = (
    "id",
    "seed",
    "status",
    "claimed_duration",
    "certified_duration",
    "gap",
    "dilation",
    "jerk_integral",
    "evaluations",
    "solve_time",
    "library_time",
    "setup_time",
    "lower_bound",
)


@dataclass(frozen=True, eq=False)
class Page:
    """The content of the template, in its order."""

    results: Tables
    summary: pd.DataFrame
    gaps: pd.DataFrame

    @cached_property
    def labels(self) -> list[str]:
        """Planners by median gap, ties as in every table."""
        return list(self.results.planners().index)

    @cached_property
    def problems(self) -> list[Problem]:
        """The problems by name, `w8` before `w16`; the paper's problem is first."""
        found = {trial.problem.digest(): trial.problem for trial in self.results.items}
        return sorted(found.values(), key=_paper_first)

    @cached_property
    def names(self) -> list[str]:
        """The names of problems on the command line: a built-in name, or a file."""
        keys = [(p.name, p.digest()) for p in self.problems]
        names = []
        for problem, file in zip(self.problems, distinct_names(keys), strict=True):
            names.append(problem.name if _built_in(problem) else f"{file}.toml")
        return names

    @cached_property
    def digests(self) -> dict[str, int]:
        return {p.digest(): i for i, p in enumerate(self.problems)}

    @cached_property
    def columns(self) -> dict[str, str]:
        """Headings of the table of problems and planners; a column without an entry is left out."""
        return {
            name: title
            for name, title in lines.COLUMNS.items()
            if any(row["cells"][name].text != table_cells.MISSING for row in self.rows)
        }

    @property
    def has_library(self) -> bool:
        """Whether any planner here wraps a library and states the time inside it."""
        return bool(self.gaps["library_time"].notna().any())

    @property
    def library(self) -> str:
        """What the column of the library's time means; empty without one."""
        return f" In lib: {table_cells.LIBRARY}." if self.has_library else ""

    @cached_property
    def times_least(self) -> list[dict[str, float]]:
        """Per problem, each planner's ∫ jerk² over the least of its duration, by label.

        A search a problem takes a tenth of a second, so only the first problems have it.
        """
        groups = self.trials_by_problem
        found = [times_the_least(trials) for trials in groups[:MAX_LEAST_SEARCHES]]
        return found + [{} for _ in groups[MAX_LEAST_SEARCHES:]]

    @property
    def least(self) -> str:
        """What the column of ratios of ∫ jerk² means; empty without one."""
        if not any(self.times_least):
            return ""
        few = len(self.problems) > MAX_LEAST_SEARCHES
        where = f", for the first {MAX_LEAST_SEARCHES} problems" if few else ""
        return (
            f" ∫ jerk² is of the certified motion; × least: {table_cells.LEAST_JERK}, where no "
            f"limit acts on that{where}."
        )

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        rows = []
        for row in self.summary.itertuples():
            line = {
                "problem": self.digests[row.digest],
                "planner": self.labels.index(row.label),
                "name": row.problem,
                "label": row.label,
                "status": row.status,
                "cells": lines.of_row(
                    row, self.times_least[self.digests[row.digest]].get(row.label)
                ),
            }
            rows.append(line)
        return sorted(rows, key=lambda line: line["problem"])  # stable: the best stay first

    @cached_property
    def trials_by_problem(self) -> list[list[Trial]]:
        groups = by_problem(self.results.items)
        return [groups[digest] for digest in self.digests]

    @cached_property
    def references(self) -> list[str]:
        """Per problem, what its gaps are measured against and how much of it is proved."""
        table = self.results.references()
        sentences = []
        for digest in self.digests:
            known = digest in table.index
            sentences.append(table_cells.reference(table.loc[digest]) if known else NO_REFERENCE)
        return sentences

    @cached_property
    def kinds(self) -> list[str]:
        return [limit_kinds(p) for p in self.problems]

    @cached_property
    def demands(self) -> list[str]:
        """Per problem, what else is asked of the way, with its numbers; empty for none."""
        return ["; ".join(_demands(problem)) for problem in self.problems]

    @cached_property
    def numbers(self) -> list[dict[str, Any]]:
        """Per problem, its joints and waypoints, as texts with units."""
        return [_numbers(problem) for problem in self.problems]

    @cached_property
    def statuses(self) -> list[str]:
        return sorted(set(self.summary["status"]))

    @cached_property
    def critical(self) -> str:
        """The critical difference of mean ranks (Nemenyi), if there are ranks."""
        ranked = [planner for planner in self.planners if planner["rank"] != table_cells.MISSING]
        if not ranked:
            return ""
        apart = statistics.critical_difference(len(self.problems), len(ranked))
        return f"; those less than {apart:.2f} apart are not told apart (Nemenyi, 95 %)"

    def drawn(self, most: int) -> set[int]:
        """The problems whose trajectories are in the page: at most so many, from all over."""
        count = min(most, len(self.problems))
        return {i * len(self.problems) // count for i in range(count)}

    def left_out(self, most: int) -> list[str]:
        """The names of the others."""
        drawn = self.drawn(most)
        return [problem.name for i, problem in enumerate(self.problems) if i not in drawn]

    @cached_property
    def suspicious(self) -> list[dict[Any, Any]]:
        rows: list[dict[Any, Any]] = self.results.suspicious().to_dict("records")
        return rows

    @cached_property
    def unheld(self) -> str:
        """Return the number of trials whose files state a wrong verdict, shown corrected."""
        trials = self.results.items
        count = sum(bool(trial.differences) for trial in trials)
        if not count:
            return ""
        return (
            f"{count} of {len(trials)} trials do not hold what their files state: they are shown "
            "as this installation's judge finds them (trajopt verify names them)."
        )

    @cached_property
    def single(self) -> bool:
        """Whether the page is about one problem: no profile, no shares of problems."""
        return len(self.problems) == 1

    @cached_property
    def verdict(self) -> str:
        """Return the result of the page in a sentence."""
        return verdict.of_problem(self.results) if self.single else verdict.of_suite(self.results)

    @cached_property
    def durations(self) -> list[dict[str, Any]]:
        """Return a line per planner for the page's only problem, the shortest first."""
        return verdict.durations(self.results, self.labels)

    @cached_property
    def race(self) -> str:
        """The same motions side by side on one clock, as HTML; empty without one."""
        motions = shown_motions(self.results.items)
        return race.fragment(self.problems[0], motions) if self.single and motions else ""

    @cached_property
    def overlay(self) -> str:
        """The motions of a few planners on one time axis, as SVG; empty without two."""
        return verdict.overlaid(self.results.items)

    @cached_property
    def failures(self) -> list[dict[str, Any]]:
        return lines.reasons(self.results, apply=True)

    @cached_property
    def not_applicable(self) -> list[dict[str, Any]]:
        """Return why planners do not compete on problems: refusals, and proofs without a motion."""
        return lines.reasons(self.results, apply=False)

    @cached_property
    def planners(self) -> list[dict[str, Any]]:
        """One line per planner: over all its runs, and over the problems."""
        rows = []
        place = places(sorted(self.labels))  # as figures have it
        for line in self.results.planners().itertuples():
            row = {"label": line.Index, "options": self._options(line.Index)}
            row |= look(place[line.Index])
            row |= lines.over_all(line)
            rows.append(row)
        return rows

    def _options(self, label: str) -> dict[str, Any]:
        options = next(t.options for t in self.results.items if t.label == label)
        return {name: str(value) for name, value in options.items()}

    @cached_property
    def brief(self) -> str:
        """Seeds, version, machine and day in a line."""
        facts = dict(self.facts)
        told = [f"mintime {facts.get('mintime', '')}", facts.get("machine", "")]
        first = min(trial.started for trial in self.results.items)
        return f"Seeds {self.seeds}; {'; '.join(told)}; {first[:10]}."

    @property
    def seeds(self) -> str:
        different = {trial.seed for trial in self.results.items}
        return origin.ranges(sorted(different))

    @cached_property
    def command(self) -> str:
        """The command that runs the same comparison again."""
        problems = dict(zip(self.names, self.problems, strict=True))
        return origin.compare_command(self.results.items, self.labels, problems)

    @property
    def scripted(self) -> list[str]:
        """Planners that the command line does not know."""
        return origin.scripted(self.results.items)

    @cached_property
    def facts(self) -> list[tuple[str, str]]:
        """The facts of the comparison: problems, planners, trials, and their origin."""
        items = self.results.items
        started = sorted(trial.started[:19] for trial in items)
        first_and_last = dict.fromkeys([started[0], started[-1]])
        kinds = Counter(self.kinds)
        counts = [f"{kind}: {count}" for kind, count in kinds.items()]
        limits = "; ".join(counts)
        facts = [
            ("problems", f"{len(self.problems)} ({limits})"),
            ("planners", str(len(self.labels))),
            ("trials", f"{len(items)}, seeds {self.seeds}"),
            ("run", " to ".join(first_and_last)),
        ]
        return facts + origin.facts(items)


def page(results: Tables) -> Page:
    return Page(results, results.summary(), results.gaps())


def look(index: int) -> dict[str, str]:
    """Colour, dashes and marker of the planner at a place: the same everywhere in the page."""
    symbol, mark = SYMBOLS[MARKERS[index % len(MARKERS)]]
    colour = CURVES[index % len(CURVES)]
    return {
        "colour": colour,
        "ink": "currentColor" if colour == BLACK else colour,  # white where the page is dark
        "dash": DASHES[index % len(DASHES)],
        "symbol": symbol,
        "mark": mark,
    }


def trial_table(page: Page) -> dict[str, Any]:
    """Every trial at full precision, column by column, and which of them each row is made of."""
    gaps = page.gaps
    texts = [trial.message for trial in page.results.items]
    messages = list(dict.fromkeys(texts))
    place = {message: i for i, message in enumerate(messages)}
    return {
        "planners": [_planner(planner) for planner in page.planners],
        "problems": _problems(page),
        "rows": _rows(page),
        "trials": {column: gaps[column].tolist() for column in TRIAL_COLUMNS},
        "kept": gaps["feasible"].tolist(),
        "message": [place[text] for text in texts],
        "messages": messages,
    }


def _planner(row: dict[str, Any]) -> dict[str, Any]:
    return {key: row[key] for key in ("label", "colour", "dash", "symbol", "options")}


def _problems(page: Page) -> list[dict[str, str]]:
    """Each problem's name, what the command line calls it, and its file if it is not built in."""
    problems = []
    for problem, name in zip(page.problems, page.names, strict=True):
        file = "" if name == problem.name else problem.to_toml()
        problems.append({"name": problem.name, "file": name, "toml": file})
    return problems


def _rows(page: Page) -> list[dict[str, Any]]:
    """Each row's problem and planner, the command of its trials, and their places."""
    by_seed = page.gaps.sort_values("seed", kind="stable")
    groups = by_seed.groupby(["digest", "label"], sort=False)
    members = {key: group.index.tolist() for key, group in groups}
    digests = list(page.digests)
    rows = []
    for row in page.rows:
        problem = row["problem"]
        label = row["label"]
        places = members[digests[problem], label]
        first = page.results.items[places[0]]
        command, instead = origin.again(first, page.names[problem])
        rows.append(
            {
                "problem": problem,
                "planner": row["planner"],
                "spec": command,
                "instead": instead,
                "trials": places,
            }
        )
    return rows


def _demands(problem: Problem) -> Iterator[str]:
    for key, numbers in problem.demands.items():
        demand = DEMANDS[key]
        short = numbers.size <= MAX_NUMBERS_SAID
        yield demand.say(numbers, problem.shared_unit()) if short else demand.name


def _numbers(problem: Problem) -> dict[str, Any]:
    """Return the rows of a problem's table: its first waypoints; its panel has the limits."""
    shown = problem.waypoints[:MAX_WAYPOINTS_SHOWN]
    rows = []
    for number, waypoint in enumerate(shown, start=1):
        units = map(problem.unit, range(problem.joints))
        cells = [f"{value:.6g} {unit}" for value, unit in zip(waypoint, units, strict=True)]
        rows.append({"name": f"waypoint {number}", "cells": cells})
    left_out = len(problem.waypoints) - len(shown)
    return {"joints": list(problem.joint_labels), "rows": rows, "left_out": left_out}


def limit_kinds(problem: Problem) -> str:
    return ", ".join(KINDS[key].name() for key in problem.limits.kinds)


def _built_in(problem: Problem) -> bool:
    try:
        known = problem.name in suite.problem_files()
        return known and suite.load(problem.name).digest() == problem.digest()
    except TrajoptError:
        return False


def _paper_first(problem: Problem) -> tuple[bool, list[tuple[int, str]]]:
    return problem.name != "six-axis", _natural(problem.name)


def _natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts numbers in names as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(int(part) if part.isdigit() else -1, part) for part in parts]


def suites_of(problem: Problem) -> list[str]:
    """The suites that a problem says it is of: by its name, or as a built-in edge case."""
    suites = suite.suites()
    named = [name for name in suites if problem.name.startswith(f"{name}-")]
    if named:
        return named
    edge = _built_in(problem) and problem.name not in suites
    return ["edges"] if edge else []
