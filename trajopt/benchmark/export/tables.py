"""All trials in formats that other programs read: CSV, Parquet, IOHprofiler.

write(Results("results"), "csv", Path("trials.csv"))
write(Results("results"), "ioh", Path("ioh"))        # a folder; zip it for IOHanalyzer's page
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt.benchmark.analysis.results import Results
from trajopt.benchmark.store import atomic
from trajopt.benchmark.store.schema import pack
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import InvalidInput, StoreError
from trajopt.planner import backend
from trajopt.problem import Problem

Array = NDArray[np.float64]

IOH_VERSION = "0.3.5"  # of the format; IOHanalyzer reads JSON from 0.3.3 on


def write(results: Results, to: str, path: Path) -> None:
    """Write all trials to a file (`csv`, `parquet`: see `table`) or a new folder (`ioh`).

    Raises `InvalidInput` for another format, `StoreError` where the disk refuses, where the folder
    holds files already, or for `ioh` if no trial has a history, and `MissingBackend` for `parquet`
    without pyarrow.
    """
    if to not in _WRITERS:
        raise InvalidInput("--to", " or ".join(_WRITERS), value=to)
    _WRITERS[to](results, path)


def table(results: Results) -> pd.DataFrame:
    """`results.gaps()` (s; NaN where there is none) and what each trial came from.

    Further columns: `options`, all of them as JSON, NaN and infinity as `{"$float": "nan"}`;
    `batch`, runs solved together; `started`, UTC; and `provenance_*`, the commit, the machine and
    the versions, empty where not installed.
    """
    items = results.items
    names = dict.fromkeys(name for t in items for name in t.provenance)
    texts = {"options": [_options(t) for t in items]}
    texts |= {f"provenance_{n}": [str(t.provenance.get(n, "")) for t in items] for n in names}
    started = pd.to_datetime([t.started for t in items], utc=True, format="ISO8601").as_unit("us")
    numbers = {"batch": np.array([t.batch for t in items], dtype=int), "started": started}
    return pd.concat(
        [results.gaps(), pd.DataFrame(numbers), pd.DataFrame(texts, dtype="str")], axis=1
    )


def without_history(results: Results) -> list[str]:
    """Planners that `ioh` leaves out: none of their trials has a history of two evaluations.

    The joints of per-joint swarms are searched on their own: there is no curve of the whole.
    """
    kept = {t.label for t in results.items if _has_curve(t)}
    return [n for n in dict.fromkeys(t.label for t in results.items) if n not in kept]


def _csv(results: Results, path: Path) -> None:
    """UTF-8, RFC 4180, floats with all their digits."""
    trials, end = table(results), "\r\n"  # so that texts with a lone \r in them are quoted
    atomic.write(path, lambda place: trials.to_csv(place, index=False, lineterminator=end))


def _parquet(results: Results, path: Path) -> None:
    backend("pyarrow")
    trials = table(results)
    atomic.write(path, lambda place: trials.to_parquet(place, engine="pyarrow", index=False))


def _ioh(results: Results, path: Path) -> None:
    """Convergence histories as IOHexperimenter's logger writes them, to be minimised.

    A function is a problem, numbered by name; its dimension the number of segments, whose times
    the swarms search. An algorithm, a folder, is a planner with its options; each trial is a run.
    `raw_y` is the best duration (s) times the dilation that the run's answer needed. It is `inf`
    until there is one, and to the end if nothing was certified. A planner's trials on a problem are
    left out if none of them has a history of two evaluations: IOHanalyzer 0.1.8 stumbles over one.
    Files are numbered, not named: it unpacks what has "tar" in its path, and takes "csv" for CSV.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".", dir=path.parent) as scratch:
            place = Path(scratch) / "ioh"
            for number, folder, trials in _experiments(results.items):
                _experiment(place / folder, number, trials)
            if not place.exists():
                raise StoreError("nothing to write: no trial has a history of two evaluations")
            place.rename(path)
    except OSError as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"{path}: cannot be written: {error.strerror}") from error


_WRITERS: dict[str, Callable[[Results, Path], None]] = {
    "csv": _csv, "parquet": _parquet, "ioh": _ioh,
}  # fmt: skip


def _experiments(items: Sequence[Trial]) -> list[tuple[int, str, list[Trial]]]:
    """Number of the function, folder of the algorithm, and their runs by seed."""
    problems = sorted({(t.problem.name, t.problem.digest()) for t in items})
    functions = {digest: number for number, (_, digest) in enumerate(problems, 1)}
    labels = enumerate(sorted({t.label for t in items}), 1)
    folders = {label: f"algorithm_{number}" for number, label in labels}
    groups: dict[tuple[int, str], list[Trial]] = {}
    for t in sorted(items, key=lambda t: (t.seed, t.id)):
        groups.setdefault((functions[t.problem.digest()], folders[t.label]), []).append(t)
    searched = [k for k, runs in groups.items() if any(map(_has_curve, runs))]
    return [(*key, groups[key]) for key in sorted(searched)]


def _has_curve(trial: Trial) -> bool:
    return trial.solution.history is not None and len(_curve(trial)) > 1


def _experiment(folder: Path, number: int, trials: list[Trial]) -> None:
    """Write one algorithm's runs on one function."""
    problem = trials[0].problem
    name = f"IOHprofiler_f{number}"
    data = Path(f"data_f{number}", f"{name}_DIM{problem.segments}.dat")
    curves = [_curve(t) for t in trials]
    (folder / data).parent.mkdir(parents=True)
    (folder / data).write_text("".join(map(_block, curves)), encoding="utf-8", newline="\n")
    runs = [_run(t, curve) for t, curve in zip(trials, curves, strict=True)]
    scenario = {"dimension": problem.segments, "path": data.as_posix(), "runs": runs}
    meta = _described(number, problem, trials) | {"scenarios": [scenario]}
    text = json.dumps(meta, indent=1, allow_nan=False)
    (folder / f"{name}.json").write_text(text, encoding="utf-8")


def _described(number: int, problem: Problem, trials: list[Trial]) -> dict[str, Any]:
    sources = [t.provenance for t in trials]
    origins = {f"trajopt {p.get('trajopt', '')}, commit {p.get('commit', '')}" for p in sources}
    return {
        "version": IOH_VERSION, "suite": "trajopt",
        "function_id": number, "function_name": problem.name, "maximization": False,
        "algorithm": {"name": trials[0].label, "info": _options(trials[0])},
        "experiment_attributes": [{"provenance": "; ".join(sorted(origins))}],
        "run_attributes": ["seed"], "attributes": ["evaluations", "raw_y"],
    }  # fmt: skip


def _run(trial: Trial, curve: Array) -> dict[str, Any]:
    """One run's summary; JSON knows no infinity, so the largest number stands for no answer."""
    best = curve[-1, 1]
    reached = int(curve[np.argmin(curve[:, 1]), 0])
    certified = trial.certified_trajectory
    times = [] if certified is None else np.diff(certified.waypoint_times).tolist()
    y = float(best) if np.isfinite(best) else sys.float_info.max
    summary = {"evals": reached, "y": y, "x": times}
    return {"instance": 1, "evals": int(curve[-1, 0]), "best": summary, "seed": trial.seed}


def _curve(trial: Trial) -> Array:
    """Evaluations and the best certified by then (s): `(m, 2)`, at 1, each improvement, the end.

    Readers tell runs apart by their first evaluation, and take what was spent from the last.
    """
    history = np.empty((0, 2)) if trial.solution.history is None else trial.solution.history
    spent, best = history[np.isfinite(history[:, 0])].T
    spent = np.floor(np.maximum(1, [1, *spent, max([trial.solution.evaluations or 1, *spent])]))
    best = np.array([np.inf, *_certified(trial, best), np.inf])
    order = np.argsort(spent, kind="stable")
    spent, best = spent[order], np.minimum.accumulate(best[order])
    last = np.r_[spent[1:] != spent[:-1], True]  # of the rows at the same evaluation
    spent, best = spent[last], best[last]
    ends = np.isin(spent, spent[[0, -1]])
    curve: Array = np.column_stack([spent, best])[ends | np.r_[True, best[1:] != best[:-1]]]
    return curve


def _certified(trial: Trial, best: Array) -> Array:
    """What a history's durations (s) are once dilated as the run's answer was; inf for none."""
    if trial.certified_duration is None or trial.certificate is None:
        return np.full(len(best), np.inf)
    return np.where(np.isfinite(best), best * max(1.0, trial.certificate.dilation), np.inf)


def _block(curve: Array) -> str:
    rows = [f"{spent:.0f} {best!r}" for spent, best in curve.tolist()]
    return "\n".join(["evaluations raw_y", *rows, ""])


def _options(trial: Trial) -> str:
    plain = json.loads(json.dumps(dict(trial.options), default=str))
    return json.dumps(pack(plain), sort_keys=True, ensure_ascii=False)
