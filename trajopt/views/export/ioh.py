"""Convergence histories for IOHprofiler (IOHanalyzer), as IOHexperimenter's logger writes them.

A function is a problem, numbered by name; its dimension the number of segments, whose times the
swarms search. An algorithm, a folder, is a planner with its options; each trial is a run. `raw_y`
is the best certified duration, s: `inf` until there is one, and to the end if nothing was
certified. A planner's trials on a problem are left out if none of them has a history of two
evaluations: IOHanalyzer 0.1.8 stumbles over one. Names are in the JSON files only, whatever
characters they hold; files are numbered: IOHanalyzer unpacks what has "tar" in its path, and takes
"csv" for CSV.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from trajopt.benchmark.store.document import pack
from trajopt.benchmark.trial import Trial
from trajopt.core.arrays import Array
from trajopt.core.exceptions import StoreError
from trajopt.views.analysis.results import Results

VERSION = "0.3.5"  # the format's; IOHanalyzer reads JSON from 0.3.3 on
HEADER = "evaluations raw_y"


def write(results: Results, path: Path) -> None:
    """Write the histories into a new folder, to be minimised.

    Raises:
        StoreError: if no trial has a history of two evaluations, where the disk refuses, or where
            the folder holds files already.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".", dir=path.parent) as scratch:
            place = Path(scratch) / "ioh"
            for experiment in _experiments(results.items):
                _write_experiment(place, experiment)
            if not place.exists():
                raise StoreError("nothing to write: no trial has a history of two evaluations")
            place.rename(path)
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror}") from error


def without_history(results: Results) -> list[str]:
    """Planners that are left out: none of their trials has a history of two evaluations.

    The joints of per-joint swarms are searched on their own: there is no curve of the whole.
    """
    labels = dict.fromkeys(trial.label for trial in results.items)
    written = {trial.label for trial in results.items if _has_curve(trial)}
    return [label for label in labels if label not in written]


class _Experiment(NamedTuple):
    """One algorithm's runs on one function, by seed."""

    function: int
    algorithm: int
    trials: list[Trial]


def _experiments(items: Sequence[Trial]) -> Iterator[_Experiment]:
    """Yield the experiments with a history, by function and algorithm."""
    names = {trial.problem.digest(): trial.problem.name for trial in items}
    groups: dict[tuple[str, str], list[Trial]] = {}
    for trial in sorted(items, key=lambda trial: (trial.seed, trial.id)):
        key = (trial.problem.digest(), trial.label)
        group = groups.setdefault(key, [])
        group.append(trial)
    functions = sorted(names, key=lambda digest: (names[digest], digest))
    algorithms = sorted({trial.label for trial in items})
    for function, digest in enumerate(functions, 1):
        for algorithm, label in enumerate(algorithms, 1):
            trials = groups.get((digest, label), [])
            if any(_has_curve(trial) for trial in trials):
                yield _Experiment(function, algorithm, trials)


def _has_curve(trial: Trial) -> bool:
    if trial.solution.history is None:
        return False
    return len(_curve(trial)) > 1


def _write_experiment(place: Path, experiment: _Experiment) -> None:
    folder = place / f"algorithm_{experiment.algorithm}"
    number = experiment.function
    name = f"IOHprofiler_f{number}"
    trials = experiment.trials
    segments = trials[0].problem.segments
    runs = []
    blocks = []
    for trial in trials:
        curve = _curve(trial)
        runs.append(_run(trial, curve))
        blocks.append(_block(curve))
    data = Path(f"data_f{number}") / f"{name}_DIM{segments}.dat"
    file = folder / data
    file.parent.mkdir(parents=True)
    file.write_text("".join(blocks), encoding="utf-8", newline="\n")
    scenario = {
        "dimension": segments,
        "path": data.as_posix(),
        "runs": runs,
    }
    meta = _described(experiment) | {"scenarios": [scenario]}
    text = json.dumps(meta, indent=1, allow_nan=False)
    (folder / f"{name}.json").write_text(text, encoding="utf-8")


def _described(experiment: _Experiment) -> dict[str, Any]:
    first = experiment.trials[0]
    origins = set()
    for trial in experiment.trials:
        release = trial.provenance.get("mintime", "")
        commit = trial.provenance.get("commit", "")
        origins.add(f"trajopt {release}, commit {commit}")
    provenance = "; ".join(sorted(origins))
    return {
        "version": VERSION,
        "suite": "trajopt",
        "function_id": experiment.function,
        "function_name": first.problem.name,
        "maximization": False,
        "algorithm": {
            "name": first.label,
            "info": json.dumps(pack(first.options), sort_keys=True, ensure_ascii=False),
        },
        "experiment_attributes": [{"provenance": provenance}],
        "run_attributes": ["seed"],
        "attributes": ["evaluations", "raw_y"],
    }


def _run(trial: Trial, curve: Array) -> dict[str, Any]:
    """Return one run's summary; the largest number stands for a missing answer."""
    spent, best = curve.T
    last = float(best[-1])
    shortest = min(last, sys.float_info.max)
    certified = trial.certified_trajectory
    times = []
    if certified is not None:
        times = np.diff(certified.waypoint_times).tolist()
    reached = spent[np.argmin(best)]
    return {
        "instance": 1,
        "evals": int(spent[-1]),
        "best": {
            "evals": int(reached),
            "y": shortest,
            "x": times,
        },
        "seed": trial.seed,
    }


def _curve(trial: Trial) -> Array:
    """Return evaluations and the best certified by then (s), `(m, 2)`.

    Rows are at 1 evaluation, at each improvement, and at the end.

    Readers tell runs apart by their first evaluation, and take what was spent from the last.
    """
    history = trial.certified_history
    # the first evaluation has no answer unless a row gives one
    spent, best = np.insert(history, 0, [1.0, np.inf], axis=0).T
    spent = np.floor(np.maximum(1.0, spent))
    best = np.where(np.isfinite(best), best, np.inf)
    # keep the last row of one evaluation, the first row of one best, and the end
    last = np.diff(spent, append=np.inf) > 0
    spent = spent[last]
    best = best[last]
    before = best[:-1]
    falls = best[1:] < before
    shown = np.concatenate([[True], falls])
    shown[-1] = True
    return np.column_stack([spent[shown], best[shown]])


def _block(curve: Array) -> str:
    lines = [HEADER]
    for spent, best in curve.tolist():
        lines.append(f"{spent:.0f} {best!r}")
    return "\n".join([*lines, ""])
