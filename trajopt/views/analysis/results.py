"""Trials as tables: one row per trial, gaps to the reference, one line per planner.

    results = Tables("results")    # a folder, a results.h5, or trials
    results = Tables.of("a", "b")  # several folders
    results.gaps()                 # a pandas frame, one row per trial
    results.summary()              # a pandas frame, one row per problem and planner
    results.planners()             # a pandas frame, one row per planner
    results.paired()               # a pandas frame, one row per planner and rival
    results.between_seeds()        # the same on one problem, over seeds
    results.running_times()        # a pandas frame, one row per planner and target

Durations and times are in seconds, gaps are ratios minus 1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from trajopt.benchmark.store import fields, unfinished
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.store.unfinished import Stopped
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.solution import Status
from trajopt.explain.references import BUG_RTOL, PROVERS, REFERENCES, REFINED_RTOL
from trajopt.views.analysis import pairwise, searches
from trajopt.views.analysis.common import Common, common
from trajopt.views.analysis.gap_reference import OPTIMA, references
from trajopt.views.analysis.overview import competing, overview
from trajopt.views.analysis.versions import Kept, Newest, by_problem, newest

Target = Literal["optimum", "best 3-5-3"]
Line = Any  # a row of `Results.summary()`: its columns are attributes

_REFERENCE_COLUMNS: dict[str, Any] = {
    "duration": float,
    "kind": "str",
    "proved": float,
    "recorded": "str",
    "recorded_proof": "str",
}
_REFERENCES = {*REFERENCES, *PROVERS}
_OF_A_LINE = ["problem", "digest", "label"]  # shared by the trials of a line


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Tables:
    """The trials of a run, for tables and figures: of each planner those of its last version.

    Args:
        source: the trials, or the path of a results folder, a `results.h5` or a trial file.
        kept: which of them are from an earlier run.
        stopped: how many of them a run that was stopped did not reach; of a folder, what it states.

    Raises:
        StoreError: naming the file, if it cannot be read.
    """

    newest: Newest
    kept: Kept | None
    stopped: Stopped | None

    def __init__(
        self,
        source: Sequence[Trial] | Path | str,
        *,
        kept: Kept | None = None,
        stopped: Stopped | None = None,
    ) -> None:
        if isinstance(source, str | Path):
            found: Sequence[Trial] = store.read(source)
            stopped = unfinished.read(Path(source), found)
        else:
            found = source
        object.__setattr__(self, "newest", newest(found))
        object.__setattr__(self, "kept", kept)
        object.__setattr__(self, "stopped", stopped)

    @classmethod
    def of(cls, *sources: Path | str) -> Self:
        """Put the trials of several results folders or files together, each trial once."""
        parts = [cls(source) for source in sources]
        if len(parts) == 1:
            return parts[0]
        trials: list[Trial] = []
        for source in sources:
            trials += store.read(source)
        stopped = [part.stopped for part in parts if part.stopped]
        return cls(trials, stopped=Stopped.together(stopped) if stopped else None)

    def only(self, planners: Sequence[str] = (), *, common: bool = False) -> Self:
        """Return the results of some planners, or on the problems that all planners answer.

        The references stay, since gaps are measured against them; they need not answer.

        Args:
            planners: By their names with options, or by their names alone for all of their options;
                by default all.
            common: Whether to leave out the problems that some planner does not answer.

        Raises:
            UnknownName: No trial is of such a planner.
            InvalidInput: There is no problem that all of them answer.
        """
        names = [{own.label, own.label.partition(":")[0]} for own in self.items]
        for label in planners:
            if not any(label in own for own in names):
                known = {own.label for own in self.items}
                raise UnknownName("planner of these trials", label, known)
        wanted = {*planners, *_REFERENCES}
        pairs = zip(self.items, names, strict=True)
        trials = [trial for trial, own in pairs if not planners or own & wanted]
        shown = type(self)(trials, kept=self.kept, stopped=self.stopped)
        if not common or not trials:
            return shown
        found = shown.common()
        if not found.problems or found.left_out:
            counts = found.answered.sort_values(kind="stable").items()
            few = ", ".join(f"{label} {count} of {found.every}" for label, count in counts)
            right = "planners that all answer some problem with a known optimum"
            raise InvalidInput("planners", right, value=few)
        own = [trial for trial in trials if trial.digest in found.problems]
        return type(self)(own, kept=self.kept, stopped=self.stopped)

    def common(self) -> Common:
        """Return the planners that can be compared with each other, and on which problems.

        The references are not among them, unless there are no other planners.
        """
        labels = list(self.planners().index)
        others = [label for label in labels if label.partition(":")[0] not in _REFERENCES]
        return common(self._gaps, others or labels)

    @property
    def items(self) -> Sequence[Trial]:
        """The trials that are shown."""
        return self.newest.trials

    @property
    def left_out(self) -> Mapping[str, int]:
        """The numbers of trials of earlier versions, which are not shown, by label."""
        return self.newest.left_out

    def trials(self) -> pd.DataFrame:
        """One row per trial; a number that does not exist is NaN.

        Its columns are the fields of a trial (`benchmark.store.fields`, docs/files.md), and
        `group`: an arm, a paper or a random family. Problems of one group are not independent.
        `feasible` is false for a trial without a trajectory.
        """
        return self._trials.copy()

    @cached_property
    def _trials(self) -> pd.DataFrame:
        columns = {}
        for name, column in fields.columns(self.items).items():
            numbers = isinstance(column, np.ndarray)
            columns[name] = pd.Series(column, dtype=None if numbers else "str")
        table = pd.DataFrame(columns)
        table["feasible"] = table["feasible"] == 1
        groups = [catalogue.group(trial.problem) for trial in self.items]
        return table.assign(group=groups)

    def references(self) -> pd.DataFrame:
        """One row per problem, by its digest: the reference of its gaps.

        Columns:
            reference: s.
            kind: `exact`, the shortest certified answer of the exact planners, or of the proof;
                `refined`, that of refined collocation, above the optimum by at most
                `REFINED_RTOL`; `relaxed`, where no exact planner knows all limits, the longest of
                their answers without the limits that they ignore; `lower bound`, where a longer
                duration is proved;
                `best known`, where the recorded motion (`trajopt best-known`) is shorter than all.
            proved: no trajectory takes less, s; NaN where nothing was proved.
            recorded: where the recorded motion comes from, if it is the reference, or empty.
            recorded_proof: the same of the recorded lower bound, if it is the highest.
        """
        return self._references.copy()

    @cached_property
    def _references(self) -> pd.DataFrame:
        found = references(self.items)
        rows = [asdict(reference) for reference in found.values()]
        index = pd.Index(list(found), name="digest", dtype="str")
        table = pd.DataFrame(rows, index, list(_REFERENCE_COLUMNS)).astype(_REFERENCE_COLUMNS)
        return table.rename(columns={"duration": "reference"})

    def gaps(self) -> pd.DataFrame:
        """`trials()` with the columns of `references()` and `gap` = certified / reference − 1."""
        return self._gaps.copy()

    @cached_property
    def _gaps(self) -> pd.DataFrame:
        table = self._trials.merge(self._references, how="left", left_on="digest", right_index=True)
        for name in ("recorded", "recorded_proof"):
            table[name] = table[name].fillna("")
        table["gap"] = table["certified_duration"] / table["reference"] - 1
        return table

    def summary(self) -> pd.DataFrame:
        """One row per problem and planner with its options, the best first.

        Columns:
            problem, digest, label: the problem, and the planner with its options.
            median, q1, q3, min, max: certified durations of the runs that have one, s.
            gap: median of theirs to the reference, a ratio minus 1.
            kind, reference, proved, recorded, recorded_proof: those of `references()`.
            runs, solved: the number of runs, and of those with the status `solved`.
            kept: share of all runs that keep every limit as claimed.
            dilation: median of the runs that break a limit and can be mended.
            position_excess: worst of all runs, rad.
            lower_bound: the smallest, s.
            jerk_integral, acceleration_integral, jerk_rms_sum: medians, infinite for a motion that
                jumps.
            evaluations, solve_time: medians, the latter in s.
            library_time: median part of it inside the calls of a library that plans, s; NaN without
                one.
            setup_time: the longest, s.
            status, message: of the first run that is not solved; if all are, of the first run.
        """
        return self._summary.copy()

    @cached_property
    def _summary(self) -> pd.DataFrame:
        table = self._gaps
        solved = table["status"] == str(Status.SOLVED)
        broke_limits = table["certified_duration"].notna() & ~table["feasible"]
        mended = table["dilation"].where(broke_limits)
        table = table.assign(solved=solved, dilation=mended)
        groups = table.groupby(_OF_A_LINE, sort=False)
        certified = groups["certified_duration"]
        of_each = groups.first()
        telling = table.sort_values("solved", kind="stable").drop_duplicates(_OF_A_LINE)
        verdicts = telling.set_index(_OF_A_LINE)
        columns = {
            "median": certified.median(),
            "q1": certified.quantile(0.25),
            "q3": certified.quantile(0.75),
            "min": certified.min(),
            "max": certified.max(),
            "gap": groups["gap"].median(),
            "kind": of_each["kind"],
            "reference": of_each["reference"],
            "proved": of_each["proved"],
            "recorded": of_each["recorded"],
            "recorded_proof": of_each["recorded_proof"],
            "runs": groups.size(),
            "solved": groups["solved"].sum(),
            "kept": groups["feasible"].mean(),
            "dilation": groups["dilation"].median(),
            "position_excess": groups["position_excess"].max(),
            "lower_bound": groups["lower_bound"].min(),
            "jerk_integral": groups["jerk_integral"].median(),
            "acceleration_integral": groups["acceleration_integral"].median(),
            "jerk_rms_sum": groups["jerk_rms_sum"].median(),
            "evaluations": groups["evaluations"].median(),
            "solve_time": groups["solve_time"].median(),
            "library_time": groups["library_time"].median(),
            "setup_time": groups["setup_time"].max(),
            "status": verdicts["status"],
            "message": verdicts["message"],
        }
        lines = pd.DataFrame(columns, index=of_each.index).reset_index()
        ordered = pairwise.best_first(lines, lines["median"])
        return ordered.sort_values("problem", kind="stable", ignore_index=True)

    def planners(self) -> pd.DataFrame:
        """One row per planner with its options, by median gap; `overview` lists the columns."""
        return overview(self._gaps)

    def lines(self) -> list[Line]:
        """The rows of `summary()`, their columns as attributes; `kind` may be None."""
        table = self._summary
        kind = table["kind"].astype(object)
        known = kind.where(kind.notna(), None)
        return list(table.assign(kind=known).itertuples(index=False))

    def paired(self) -> pd.DataFrame:
        """Every planner against every other, over the problems that both support.

        One row per `planner` and `against`, both with their options: `pairwise.paired_tests` lists
        the columns. `.loc["issa", "ssa"]` is one row, `.xs("ssa", level="against")` all against
        one.
        """
        pairs = pairwise.pairs_by_problem(competing(self._trials), self._references["proved"])
        return pairwise.paired_tests(pairs)

    def between_seeds(self, problem: str | None = None) -> pd.DataFrame:
        """Every planner with several runs against every other, over their runs on one problem.

        One row per `planner` and `against`, both with their options: `pairwise.between_seeds` lists
        the columns.

        Args:
            problem: its name or digest; may be left out if there is one only.

        Raises:
            InvalidInput: if no problem, or more than one, is meant.
        """
        runs = self._trials
        names = ", ".join(runs["problem"].unique())
        if problem is not None:
            by_name = runs["problem"] == problem
            by_digest = runs["digest"] == problem
            runs = runs[by_name | by_digest]
        if runs["digest"].nunique() != 1:
            expected = f"the name or digest of one of: {names}"
            raise InvalidInput("problem", expected, value=problem)
        return pairwise.between_seeds(competing(runs))

    def histories(self) -> dict[str, searches.Histories]:
        """Per problem, by its digest, the best 3-5-3 and every run's history."""
        problems = by_problem(self.items)
        return {digest: searches.histories(trials) for digest, trials in problems.items()}

    def running_times(
        self,
        targets: ArrayLike = searches.TARGETS,
        *,
        to: Target = "optimum",
        cost: searches.Cost = "seconds",
    ) -> pd.DataFrame:
        """Expected cost until a planner is within `target` of the optimum, and how often it is.

        One row per planner, with its options, and target (a ratio minus 1): `ert`, `successes`,
        `runs`, pooled over the `problems` whose reference is a motion, on which it competes. Where
        these numbers differ, times are of other problems: `only(common=True)` leaves the problems
        that all planners answer.

        Args:
            targets: Gaps.
            to: The optimum; or the best 3-5-3, for searches of it only, in evaluations.
            cost: Seconds, which a search spends evenly over its evaluations; or evaluations, of
                planners that count them.
        """
        if to == "best 3-5-3":
            problems = list(self.histories().values())
            table = searches.running_times(searches.over_best(problems), targets)
            each = [own.runs for own in problems if np.isfinite(own.best)]
        else:
            table = searches.running_times(self.over_optimum(cost), targets)
            trials = by_problem(self.items)
            each = [type(self)(own).over_optimum(cost) for own in trials.values()]
        counts = Counter(label for own in each for label in own)
        return table.assign(problems=[counts[label] for label, _ in table.index])

    def over_optimum(self, cost: searches.Cost = "seconds") -> dict[str, list[NDArray[np.float64]]]:
        """Per planner, every run's history over the optimum: `searches.over_optimum`."""
        known = self._references[self._references["kind"].isin(OPTIMA)]
        rows = competing(self._trials).index
        trials = [self.items[row] for row in rows]
        return searches.over_optimum(trials, known["reference"].to_dict(), cost)

    def suspicious(self) -> pd.DataFrame:
        """Return trials below the reference by more than its tolerance: bugs, or better optima."""
        table = self.gaps()
        refined = table["kind"] == "refined"
        tolerance = np.where(refined, REFINED_RTOL, BUG_RTOL)
        below_reference = table["gap"] < -tolerance
        below_proof = table["certified_duration"] < table["proved"] * (1 - BUG_RTOL)
        return table[below_reference | below_proof]
