"""The figures of trials, one folder per problem.

    draw(trials, Path("results/figures"))           # what a comparison shows, as PNG
    write(trials, Path("svg"), "svg")               # these and every motion, for a paper

Matplotlib is imported where something is drawn.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.best_known import records
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import StoreError
from trajopt.core.problem import LimitName
from trajopt.core.trajectory import Trajectory
from trajopt.explain.references import PROOF, REFERENCES
from trajopt.views.analysis.searches import histories, searches
from trajopt.views.analysis.summary import Summary
from trajopt.views.figures import sampling
from trajopt.views.figures.style import headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trajopt.benchmark.judgement import Judgement
    from trajopt.explain.decomposition import Explanation

Array = NDArray[np.float64]
Picture = tuple[str, Callable[[], "Figure"]]  # a file's name without suffix, and what draws it

NAME_LENGTH = 80  # characters of a file's name


def draw(trials: Sequence[Trial], folder: Path) -> list[Path]:
    """Draw every problem of a comparison into `folder/<problem>/`, as PNG.

    `durations`; `convergence` where planners keep a history; `gaps` where any ran more than once;
    `motion-<label>` of the shortest, the middle and the longest planner that is no reference, of
    several runs the median one. A folder whose figures show these trials is left as it is.

    Returns:
        The files. A figure that cannot be drawn is a warning.
    """
    files = []
    for own, name in _problems(trials):
        files += _draw_problem(own, folder / name)
    return files


def write(trials: Sequence[Trial], folder: Path, kind: Literal["svg", "pdf"]) -> None:
    """Write the figures of `draw`, and the motion of every planner, as SVG or PDF.

    Raises:
        StoreError: where the disk refuses.
    """
    from trajopt.views.figures import plots

    try:
        for own, name in _problems(trials):
            for stem, picture in _pictures(own, every_motion=True):
                plots.write(picture(), folder / name / f"{stem}.{kind}")
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from error


def explain(trial: Trial, found: Explanation, folder: Path) -> list[Path]:
    """Draw `<problem>-<label>-seed<n>-waterfall` and `-limit-use`, as PNG and SVG."""
    from trajopt.views.figures import explanation, plots

    label = f"{trial.problem.name}-{trial.label}-seed{trial.seed}"
    (stem,) = distinct_names([(label, "")])
    name = f"{trial.problem.name}: {trial.label}"
    files: list[Path] = []
    if steps := found.steps():
        panels = [(headline(name, f", {which}"), own) for which, own in steps.items()]
        files += plots.save(explanation.waterfalls(panels), folder / f"{stem}-waterfall")
    title = headline(name, f", {found.certified_duration:#.4g} s")
    use = explanation.limit_use(trial.problem, found.trajectory, found.optimum, title)
    return files + plots.save(use, folder / f"{stem}-limit-use")


def judged(found: Judgement, folder: Path) -> Path:
    """Draw a motion as it is, its limits, and the optimum behind: `<problem>-<motion>.png`."""
    from trajopt.views.figures import motions, plots

    optimum = None if found.explanation is None else found.explanation.optimum
    verdict = f", {found.claimed_duration:#.4g} s"
    if not found.certificate.valid:
        verdict += ", no slow-down mends it"
    elif not found.certificate.feasible:
        verdict += f", {found.certified_duration:#.4g} s within the limits"
    figure = motions.motion(
        found.problem,
        found.trajectory,
        optimum,
        title=headline(f"{found.problem.name}: {found.motion.name}", verdict),
        reference_name="best known optimum",
        own_name="motion as executed",
    )
    (stem,) = distinct_names([(f"{found.problem.name}-{found.motion.name}", "")])
    return plots.write(figure, folder / f"{stem}.png")


def _problems(trials: Sequence[Trial]) -> Iterator[tuple[list[Trial], str]]:
    """Yield the trials of every problem, and the name of its folder."""
    problems: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        key = trial.problem.name, trial.problem.digest()
        problems.setdefault(key, []).append(trial)
    names = distinct_names(list(problems))
    yield from zip(problems.values(), names, strict=True)


def _draw_problem(trials: Sequence[Trial], folder: Path) -> list[Path]:
    """Draw the figures of one problem, unless its stamp says that they show these trials.

    The stamp is a file beside the folder: a digest of the trials and of the files' names.
    """
    stamp = folder.with_name(f".{folder.name}.trials")
    if stamp.is_file() and stamp.read_bytes() == _digest(trials, folder):
        return sorted(folder.glob("*.png"))
    from trajopt.views.figures import plots

    for earlier in folder.glob("motion-*.png"):
        earlier.unlink()  # the planners that are shown may be others
    files = []
    failed = False
    for stem, picture in _pictures(trials):
        file = folder / f"{stem}.png"
        try:
            files.append(plots.write(picture(), file))
        except Exception as error:
            failed = True
            warnings.warn(f"{file}: not drawn: {error}", stacklevel=3)
    if not failed:
        stamp.write_bytes(_digest(trials, folder))
    return files


def _digest(trials: Sequence[Trial], folder: Path) -> bytes:
    """Return a digest of the trials' identities, starts and verdicts, and of the files' names."""
    rows = [f"{trial.id} {trial.label} {trial.started} {trial.status}" for trial in trials]
    names = [file.name for file in folder.glob("*.png")]
    return sha256("\n".join(sorted(rows + names)).encode()).digest()


def _pictures(trials: Sequence[Trial], *, every_motion: bool = False) -> Iterator[Picture]:
    """Yield the figures of one problem."""
    from trajopt.views.figures import plots

    title = headline(trials[0].problem.name)
    summary = Summary(trials)
    yield "durations", partial(plots.durations, summary.lines(), title)
    yield from _motions(trials, every_motion=every_motion)
    found = histories(trials)
    searching = searches([found])
    curves = {
        label: sampling.over_runs(own) for label, own in found.runs.items() if label in searching
    }
    if curves:
        best = found.best if np.isfinite(found.best) else None
        yield "convergence", partial(plots.convergence, curves, best, title)
    gaps = {
        label: np.array([summary.gap(trial) for trial in runs])
        for label, runs in by_label(trials).items()
    }
    if any(np.isfinite(runs).sum() > 1 for runs in gaps.values()):
        yield "gaps", partial(plots.gap_distribution, gaps, title)


def _motions(trials: Sequence[Trial], *, every_motion: bool) -> Iterator[Picture]:
    """Yield a figure per planner, the optimum behind all but its own."""
    from trajopt.views.figures import motions

    groups = by_label(trials)
    medians = [run for runs in groups.values() if (run := median_run(runs))]
    keys = [(trial.label, sha256(trial.label.encode()).hexdigest()) for trial in medians]
    names = dict(zip([trial.label for trial in medians], distinct_names(keys), strict=True))
    optimum, optimum_name = _optimum(trials)
    for trial in medians if every_motion else _telling(medians):
        assert trial.certified_trajectory is not None
        picture = partial(
            motions.motion,
            trial.problem,
            trial.certified_trajectory,
            None if trial.planner in REFERENCES else optimum,
            title=_title(trial, groups[trial.label]),
            reference_name=optimum_name,
        )
        yield f"motion-{names[trial.label]}", picture


def _telling(medians: Sequence[Trial]) -> list[Trial]:
    """Return the shortest, the middle and the longest trial of the planners to be compared.

    References are left out: they are drawn behind the others. Without others the first is kept.
    """
    compared = [trial for trial in medians if trial.planner not in (*REFERENCES, PROOF)]
    ordered = sorted(compared or medians[:1], key=_duration)
    chosen = {0, len(ordered) // 2, len(ordered) - 1}
    return [trial for rank, trial in enumerate(ordered) if rank in chosen]


def _title(trial: Trial, runs: Sequence[Trial]) -> str:
    duration = f", {trial.certified_duration:#.4g} s"
    certified = sum(run.certified_duration is not None for run in runs)
    if certified > 1:
        duration += f" (median of {certified} runs, seed {trial.seed})"
    return headline(f"{trial.problem.name}: {trial.label}", duration)


def _optimum(trials: Sequence[Trial]) -> tuple[Trajectory | None, str]:
    """Return the trajectory behind all others, and its name.

    It is the record, where gaps are measured against that, or the shortest of the references.
    """
    problem = trials[0].problem
    if any(reference.recorded for reference in Summary(trials).references.values()):
        return records.answer(problem).trajectory, "best known"
    asked = [trial for trial in trials if trial.planner in REFERENCES]
    answered = [trial for trial in asked if trial.solution.trajectory is not None]
    if not answered:
        return None, ""
    best = min(answered, key=lambda trial: (_duration(trial), trial.claimed_duration))
    if best.certified_trajectory is not None:
        return best.certified_trajectory, "exact optimum"
    limits: list[LimitName] = ["jerk", "position"]
    ignored = " or ".join(name for name in limits if problem.has(name))
    return best.solution.trajectory, f"best known without {ignored} limits (relaxed)"


def _duration(trial: Trial) -> float:
    """Return the certified duration, s; infinite without one."""
    return trial.certified_duration or np.inf


def median_run(runs: Sequence[Trial]) -> Trial | None:
    """Return the run with the median certified duration (the lower of two), if any has one."""
    certified = [trial for trial in runs if trial.certified_duration is not None]
    ordered = sorted(certified, key=lambda trial: (_duration(trial), trial.seed))
    while ordered:
        middle = ordered.pop((len(ordered) - 1) // 2)
        if middle.certified_trajectory is not None:  # computed for the run that is shown only
            return middle
    return None


def by_label(trials: Sequence[Trial]) -> dict[str, list[Trial]]:
    """Return each planner's trials, by its name with its options."""
    groups: dict[str, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(trial.label, []).append(trial)
    return groups


def distinct_names(keys: Sequence[tuple[str, str]]) -> list[str]:
    """Return portable file names for `(name, digest)` pairs, with a digest where names clash."""
    safe = []
    for name, _ in keys:
        portable = re.sub(r"[^A-Za-z0-9_.=+-]+", "_", name).strip("._")
        safe.append(portable[:NAME_LENGTH] or "_")
    count = Counter(name.casefold() for name in safe)
    names = []
    for name, (_, digest) in zip(safe, keys, strict=True):
        clashes = count[name.casefold()] > 1
        names.append(f"{name}-{digest[:8]}" if clashes else name)
    return names
