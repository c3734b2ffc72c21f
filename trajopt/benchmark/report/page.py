"""What the report says: the numbers of each table, as text and at full precision."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.analysis.results import Results, competing, median_gap
from trajopt.benchmark.figures.draw import distinct_names
from trajopt.benchmark.figures.style import BLACK, CURVES
from trajopt.benchmark.report import cells as lines
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import TrajoptError
from trajopt.problem import LIMIT_NAMES, Problem

DASHES = ("solid", "7px,2px", "2px,2px", "8px,2px,2px,2px")
SYMBOLS = {  # Plotly's names, and the same as paths around (15, 5)
    "circle": "M11.5 5a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0-7 0z", "square": "M12 2h6v6h-6z",
    "triangle-up": "M15 1l4 7h-8z", "diamond": "M15 .5l4.5 4.5l-4.5 4.5l-4.5-4.5z",
    "triangle-down": "M15 9l4-7h-8z", "cross": "M14 1h2v3h3v2h-3v3h-2v-3h-3v-2h3z",
    "x": "M12 1l3 3l3-3l1.2 1.2l-3 3l3 3l-1.2 1.2l-3-3l-3 3l-1.2-1.2l3-3l-3-3z",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Page:
    """All that the template shows, in its order."""

    results: Results
    summary: pd.DataFrame
    gaps: pd.DataFrame

    @cached_property
    def labels(self) -> list[str]:
        """Planners by median gap, then name: a planner's look, everywhere, is its place here."""
        groups = self.gaps.groupby("label")
        gaps = {label: median_gap(competing(runs)) for label, runs in groups}
        return sorted(gaps, key=lambda label: (np.nan_to_num(gaps[label], nan=np.inf), label))

    @cached_property
    def problems(self) -> list[Problem]:
        """By name, numbers as numbers, the paper's own first."""
        found = {t.problem.digest(): t.problem for t in self.results.items}
        return sorted(found.values(), key=lambda p: (p.name != "six-axis", _natural(p.name)))

    @cached_property
    def names(self) -> list[str]:
        """What the command line calls each problem: its built-in name, or a file."""
        keys = [(p.name, p.digest()) for p in self.problems]
        files = [f"{name}.toml" for name in distinct_names(keys)]
        return [
            p.name if _built_in(p) else file for p, file in zip(self.problems, files, strict=True)
        ]

    @cached_property
    def digests(self) -> dict[str, int]:
        return {p.digest(): i for i, p in enumerate(self.problems)}

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        rows = [self._row(row) for row in self.summary.itertuples()]
        return sorted(rows, key=lambda row: int(row["problem"]))  # stable: the best stay first

    def _row(self, row: Any) -> dict[str, Any]:
        place = {"problem": self.digests[row.digest], "planner": self.labels.index(row.label)}
        words = {"name": row.problem, "label": row.label, "status": row.status}
        return place | words | {"cells": lines.cells(row)}

    @cached_property
    def trials_by_problem(self) -> list[list[Trial]]:
        groups: dict[str, list[Trial]] = {digest: [] for digest in self.digests}
        for trial, digest in zip(self.results.items, self.gaps["digest"], strict=True):
            groups[digest].append(trial)
        return list(groups.values())

    @cached_property
    def references(self) -> list[str]:
        """Per problem, what its gaps are measured against and how much of it is proved."""
        table = self.results.references()
        return [
            lines.reference(table.loc[d]) if d in table.index else "No reference: gaps are unknown."
            for d in self.digests
        ]

    @cached_property
    def kinds(self) -> list[str]:
        return [limit_kinds(p) for p in self.problems]

    @cached_property
    def statuses(self) -> list[str]:
        return sorted(set(self.summary["status"]))

    @cached_property
    def critical(self) -> str:
        """How far apart mean ranks must be (Nemenyi), if there are ranks."""
        count, ranked = len(self.problems), [p for p in self.planners if p["rank"].value]
        if not ranked:
            return ""
        apart = statistics.critical_difference(count, len(ranked))
        return f"; those less than {apart:.2f} apart are not told apart (Nemenyi, 95 %)"

    def drawn(self, most: int) -> set[int]:
        """The problems whose trajectories are in the page: at most so many, from all over."""
        count = min(most, len(self.problems))
        return {i * len(self.problems) // count for i in range(count)}

    def left_out(self, most: int) -> list[str]:
        return [p.name for i, p in enumerate(self.problems) if i not in self.drawn(most)]

    @cached_property
    def suspicious(self) -> list[dict[str, Any]]:
        return [
            {"id": r.id, "label": r.label, "seed": r.seed, "problem": r.problem,
             "certified": f"{r.certified_duration:.9g}", "reference": f"{r.reference:.9g}",
             "gap": f"{100 * r.gap:+.3g} %".replace("-", "−")}
            for r in self.results.suspicious().itertuples()
        ]  # fmt: skip

    @cached_property
    def failures(self) -> list[dict[str, Any]]:
        return lines.failures(self.results.items)

    @cached_property
    def planners(self) -> list[dict[str, Any]]:
        """One line per planner: over all its runs, and over the problems."""
        ranks = lines.ranks(self.gaps)
        looks = [look(i) for i in range(len(self.labels))]
        runs = dict(list(self.gaps.groupby("label")))
        return [
            looks[i] | {"label": label, "options": self._options(label)}
            | lines.over_all(runs[label], ranks.get(label))
            for i, label in enumerate(self.labels)
        ]  # fmt: skip

    def _options(self, label: str) -> dict[str, Any]:
        options = next(t.options for t in self.results.items if t.label == label)
        return {name: str(value) for name, value in options.items()}

    @cached_property
    def brief(self) -> str:
        """Seeds, versions, machine and day in a line."""
        facts = dict(self.facts)
        commits = {t.provenance.get("commit", "") for t in self.results.items} - {""}
        several = [f"{len(commits)} commits (see below)"] if len(commits) > 1 else []
        named = "".join(f", {words}" for words in several or map(lines.commit, commits))
        day = min(t.started for t in self.results.items)[:10]
        return (
            f"Seeds {lines.ranges(sorted({t.seed for t in self.results.items}))}; trajopt "
            f"{facts.get('trajopt', '')}{named}; {facts.get('machine', '')}; {day}."
        )

    @cached_property
    def facts(self) -> list[tuple[str, str]]:
        """What was compared, where and when."""
        items = self.results.items
        seeds = sorted({t.seed for t in items})
        limits = "; ".join(f"{kind}: {n}" for kind, n in Counter(self.kinds).items())
        started = sorted(t.started for t in items)
        facts = [
            ("problems", f"{len(self.problems)} ({limits})"), ("planners", str(len(self.labels))),
            ("trials", f"{len(items)}, seeds {lines.ranges(seeds)}"),
            ("run", " to ".join(dict.fromkeys([started[0], started[-1]]))),
        ]  # fmt: skip
        return facts + lines.provenance(items)


def page(results: Results) -> Page:
    return Page(results, results.summary(), results.gaps())


def look(index: int) -> dict[str, str]:
    """Colour, dashes and marker of the planner at a place: the same everywhere in the page."""
    names = list(SYMBOLS)
    symbol = names[(index + index // len(names)) % len(names)]
    colour = CURVES[index % len(CURVES)]
    return {
        "colour": colour,
        "ink": "currentColor" if colour == BLACK else colour,  # white where the page is dark
        "dash": DASHES[index % len(DASHES)],
        "symbol": symbol,
        "mark": SYMBOLS[symbol],
    }


def trial_table(page: Page) -> dict[str, Any]:
    """Every trial at full precision, column by column, and which of them each row is made of."""
    gaps, items = page.gaps, page.results.items
    messages = list(dict.fromkeys(t.message for t in items))
    index = {message: i for i, message in enumerate(messages)}
    groups = gaps.sort_values("seed", kind="stable").groupby(["digest", "label"], sort=False)
    members = {key: group.index.tolist() for key, group in groups}
    keys = list(page.digests)
    columns = ("id", "seed", "status", "claimed_duration", "certified_duration", "gap", "dilation",
               "evaluations", "solve_time", "setup_time", "lower_bound")  # fmt: skip
    return {
        "planners": [
            {k: p[k] for k in ("label", "colour", "dash", "symbol", "options")}
            for p in page.planners
        ],
        "problems": [
            {"name": p.name, "file": n, "toml": "" if n == p.name else p.to_toml()}
            for p, n in zip(page.problems, page.names, strict=True)
        ],
        "rows": [
            {"problem": r["problem"], "planner": r["planner"],
             "spec": shlex.join(["trajopt", "plan", page.names[r["problem"]], "--planner",
                                 r["label"]]),
             "trials": members[keys[r["problem"]], r["label"]]}
            for r in page.rows
        ],
        "trials": {c: gaps[c].tolist() for c in columns},
        "kept": gaps["feasible"].tolist(),
        "message": [index[t.message] for t in items], "messages": messages,
    }  # fmt: skip


def limit_kinds(problem: Problem) -> str:
    return ", ".join(name for name in LIMIT_NAMES if problem.has(name))


def _built_in(problem: Problem) -> bool:
    try:
        known = problem.name in suite.problem_files()
        return known and suite.load(problem.name).digest() == problem.digest()
    except TrajoptError:
        return False


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part) if part.isdigit() else -1, part) for part in re.split(r"(\d+)", name)]


def suites_of(problem: Problem) -> list[str]:
    """The suites that a problem says it is of: by its name, or as a built-in edge case."""
    named = [name for name in suite.suites() if problem.name.startswith(f"{name}-")]
    edge = _built_in(problem) and problem.name not in suite.suites()
    return named or ["edges"] * edge
