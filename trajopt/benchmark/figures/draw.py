"""All figures of a run, in one folder per problem."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt.benchmark.analysis.results import Results
from trajopt.benchmark.analysis.searches import BEATEN_RTOL
from trajopt.benchmark.figures import explanation as gap_plots
from trajopt.benchmark.figures import plots
from trajopt.benchmark.trial import Trial
from trajopt.explain.decomposition import Explanation
from trajopt.explain.references import BEST_353, REFERENCES
from trajopt.problem import LimitName
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]


def draw(results: Results, folder: Path) -> list[Path]:
    """Draw every problem of the results into `folder/<problem>/`, as PNG and SVG.

    `durations`; `motion-<label>` of every planner with a certified trajectory, of several runs the
    median one; `convergence` where planners keep a history; `gaps` where any ran more than once.
    Returns the files written.
    """
    summary, gaps = results.summary(), results.gaps()
    trials: dict[tuple[str, str], list[Trial]] = {}
    for trial in results.items:
        trials.setdefault((trial.problem.name, trial.problem.digest()), []).append(trial)
    files = []
    for key, name in zip(trials, distinct_names(list(trials)), strict=True):
        own = folder / name
        own.mkdir(parents=True, exist_ok=True)
        files += _draw_problem(trials[key], _of(summary, key), _of(gaps, key), own)
    return files


def explain(trial: Trial, found: Explanation, folder: Path) -> list[Path]:
    """Draw `<problem>-<label>-seed<n>-waterfall` and `-limit-use`, as PNG and SVG."""
    label = f"{trial.problem.name}-{trial.label}-seed{trial.seed}"
    stem = folder / distinct_names([(label, "")])[0]
    folder.mkdir(parents=True, exist_ok=True)
    name = f"{trial.problem.name}: {trial.label}"
    files = []
    if steps := found.steps():
        panels = [(f"{name}, {title}", own) for title, own in steps.items()]
        files += plots.save(gap_plots.waterfalls(panels), Path(f"{stem}-waterfall"))
    title = f"{name}, {found.certified_duration:#.4g} s"
    use = gap_plots.limit_use(trial.problem, found.trajectory, found.optimum, title)
    return files + plots.save(use, Path(f"{stem}-limit-use"))


def _of(table: pd.DataFrame, key: tuple[str, str]) -> pd.DataFrame:
    name, digest = key
    return table[(table["problem"] == name) & (table["digest"] == digest)]


def _draw_problem(
    trials: Sequence[Trial], summary: pd.DataFrame, gaps: pd.DataFrame, folder: Path
) -> list[Path]:
    name = trials[0].problem.name
    files = plots.save(plots.durations(summary, name), folder / "durations")
    files += _draw_motions(trials, folder)
    best = min((t.certified_duration or np.inf for t in trials if t.planner == BEST_353), default=0)
    if histories := _histories(trials, best):
        known = best if 0 < best < np.inf else None
        files += plots.save(plots.convergence(histories, known, name), folder / "convergence")
    if (gaps.groupby("label")["gap"].count() > 1).any():
        files += plots.save(plots.gap_distribution(gaps, name), folder / "gaps")
    return files


def _draw_motions(trials: Sequence[Trial], folder: Path) -> list[Path]:
    """One figure per planner, the optimum behind all but its own."""
    groups = _by_label([t for t in trials if t.certified_trajectory is not None])
    names = distinct_names([(label, sha256(label.encode()).hexdigest()) for label in groups])
    reference, reference_name = _optimum(trials)
    files = []
    for runs, name in zip(groups.values(), names, strict=True):
        trial = _median_run(runs)
        trajectory = trial.certified_trajectory
        assert trajectory is not None
        behind = None if trial.planner in REFERENCES else reference
        title = _title(trial, len(runs))
        figure = plots.motion(trial.problem, trajectory, behind, title, reference_name)
        files += plots.save(figure, folder / f"motion-{name}")
    return files


def _title(trial: Trial, runs: int) -> str:
    which = f" (median of {runs} runs, seed {trial.seed})" if runs > 1 else ""
    return f"{trial.problem.name}: {trial.label}, {trial.certified_duration:#.4g} s{which}"


def _median_run(runs: Sequence[Trial]) -> Trial:
    """The run with the median certified duration; of an even number, the lower of the two."""
    ordered = sorted(runs, key=lambda t: (t.certified_duration or np.inf, t.seed))
    return ordered[(len(runs) - 1) // 2]


def _optimum(trials: Sequence[Trial]) -> tuple[Trajectory | None, str]:
    """The exact planners' shortest trajectory, and what it is an optimum of."""
    exact = [t for t in trials if t.planner in REFERENCES and t.solution.trajectory is not None]
    if not exact:
        return None, ""
    best = min(exact, key=lambda t: (t.certified_duration or np.inf, t.claimed_duration))
    if best.certified_trajectory is not None:
        return best.certified_trajectory, "exact optimum"
    limits: list[LimitName] = ["jerk", "position"]
    ignored = " or ".join(name for name in limits if best.problem.has(name))
    return best.solution.trajectory, f"optimum without {ignored} limits (lower bound)"


def _histories(trials: Sequence[Trial], best: float) -> dict[str, list[Array]]:
    """Per planner, the history of every run; a run that nothing could certify found nothing.

    Not of planners that beat the best 3-5-3: their evaluations are of something else.
    """
    kept = _by_label([t for t in trials if t.solution.history is not None])
    histories = {label: [_certified_history(t) for t in runs] for label, runs in kept.items()}
    least = {k: min(np.nanmin(h[:, 1], initial=np.inf) for h in v) for k, v in histories.items()}
    return {k: v for k, v in histories.items() if best * (1 - BEATEN_RTOL) <= least[k] < np.inf}


def _certified_history(trial: Trial) -> Array:
    history = np.vstack([[0.0, np.nan], np.array(trial.solution.history)])
    if trial.certified_duration is None:
        history[:, 1] = np.nan
    return history


def _by_label(trials: Sequence[Trial]) -> dict[str, list[Trial]]:
    groups: dict[str, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(trial.label, []).append(trial)
    return groups


def distinct_names(keys: Sequence[tuple[str, str]]) -> list[str]:
    """File names for `(name, digest)` pairs: portable, with a digest where names clash."""
    safe = [re.sub(r"[^A-Za-z0-9_.=+-]+", "_", name).strip("._")[:80] or "_" for name, _ in keys]
    count = Counter(name.casefold() for name in safe)
    return [
        f"{name}-{digest[:8]}" if count[name.casefold()] > 1 else name
        for name, (_, digest) in zip(safe, keys, strict=True)
    ]
