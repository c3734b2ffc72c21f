"""All figures of a run, in one folder per problem; those that show the same already are left."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.best_known import records
from trajopt.benchmark.judgement import Judgement
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import StoreError
from trajopt.core.problem import LimitName
from trajopt.core.trajectory import Trajectory
from trajopt.explain.decomposition import Explanation
from trajopt.explain.references import REFERENCES, references
from trajopt.views.analysis.searches import histories, searches
from trajopt.views.analysis.summary import Summary
from trajopt.views.figures import sampling
from trajopt.views.figures.drawing import Drawer, Drawing, VectorKind
from trajopt.views.figures.style import headline

Array = NDArray[np.float64]

NAME_LENGTH = 80  # characters of a file's name


def draw(
    trials: Sequence[Trial],
    folder: Path,
    drawer: Drawer | None = None,
) -> list[Path]:
    """Draw every problem of the trials into `folder/<problem>/`, as PNG.

    `durations`; `motion-<label>` of every planner with a certified trajectory, of several runs the
    median one; `convergence` where planners keep a history; `gaps` where any ran more than once.

    Args:
        trials: of one comparison.
        folder: where the problems' folders are, or will be.
        drawer: has processes that may help, and may have begun (`ahead`).

    Returns:
        The files, also of figures that were there already and show the same.

    Raises:
        NotDrawn: some cannot be drawn; the others are by then.
    """
    drawer = drawer or Drawer()
    return drawer.finish(_drawings(trials, folder))


def ahead(trials: Sequence[Trial], folder: Path) -> Iterator[Drawing]:
    """Motions that can be drawn while other planners still run: only references change them."""
    for own, name in _problems(trials):
        if set(references(own[0].problem)) <= {trial.planner for trial in own}:
            yield from _motions(own, folder / name)


def write(trials: Sequence[Trial], folder: Path, kind: VectorKind) -> None:
    """Write the figures that `draw` makes into `folder/<problem>/`, as SVG or PDF for a paper.

    Raises:
        StoreError: where the disk refuses.
    """
    try:
        for drawing in _drawings(trials, folder):
            drawing.write(kind)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from error


def _drawings(trials: Sequence[Trial], folder: Path) -> list[Drawing]:
    """The figures of every problem."""
    drawings: list[Drawing] = []
    for own, name in _problems(trials):
        drawings += _of_problem(own, folder / name)
    return drawings


def _problems(trials: Sequence[Trial]) -> Iterator[tuple[list[Trial], str]]:
    """The trials of every problem, and its folder's name."""
    problems: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        key = trial.problem.name, trial.problem.digest()
        problems.setdefault(key, []).append(trial)
    names = distinct_names(list(problems))
    yield from zip(problems.values(), names, strict=True)


def explain(trial: Trial, found: Explanation, folder: Path) -> list[Path]:
    """Draw `<problem>-<label>-seed<n>-waterfall` and `-limit-use`, as PNG and SVG."""
    from trajopt.views.figures import explanation, plots  # Matplotlib: only where it draws

    label = f"{trial.problem.name}-{trial.label}-seed{trial.seed}"
    (stem,) = distinct_names([(label, "")])
    folder.mkdir(parents=True, exist_ok=True)
    name = f"{trial.problem.name}: {trial.label}"
    files: list[Path] = []
    if steps := found.steps():
        panels = []
        for which, own in steps.items():
            over = headline(name, f", {which}")
            panels.append((over, own))
        climb = explanation.waterfalls(panels)
        files += plots.save(climb, folder / f"{stem}-waterfall")
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
    folder.mkdir(parents=True, exist_ok=True)
    return plots.save(figure, folder / stem)[0]


def _of_problem(trials: Sequence[Trial], folder: Path) -> list[Drawing]:
    title = headline(trials[0].problem.name)
    summary = Summary(trials)
    durations = {"summary": summary.lines(), "title": title}
    drawings = [Drawing("durations", durations, folder / "durations")]
    drawings += _motions(trials, folder)
    if convergence := _convergence(trials):
        drawings.append(
            Drawing("convergence", convergence | {"title": title}, folder / "convergence")
        )
    gaps = _gaps(summary)
    if any(np.isfinite(runs).sum() > 1 for runs in gaps.values()):
        runs = {"gaps": gaps, "title": title}
        drawings.append(Drawing("gap_distribution", runs, folder / "gaps"))
    return drawings


def _gaps(summary: Summary) -> dict[str, Array]:
    """Every planner's on one problem, ratios minus 1; NaN where a run has none."""
    gaps = {}
    for label, runs in by_label(summary.trials).items():
        gaps[label] = np.array([summary.gap(trial) for trial in runs])
    return gaps


def _motions(trials: Sequence[Trial], folder: Path) -> Iterator[Drawing]:
    """One figure per planner, the optimum behind all but its own."""
    certified = [trial for trial in trials if trial.certified_duration is not None]
    groups = by_label(certified)
    keys = [(label, sha256(label.encode()).hexdigest()) for label in groups]
    reference, reference_name = _optimum(trials)
    for runs, name in zip(groups.values(), distinct_names(keys), strict=True):
        trial = median_run(runs)
        if trial is None:
            continue
        motion = {
            "problem": trial.problem,
            "trajectory": trial.certified_trajectory,
            "reference": None if trial.planner in REFERENCES else reference,
            "title": _title(trial, len(runs)),
            "reference_name": reference_name,
        }
        yield Drawing("motion", motion, folder / f"motion-{name}")


def _title(trial: Trial, runs: int) -> str:
    duration = f", {trial.certified_duration:#.4g} s"
    if runs > 1:
        duration += f" (median of {runs} runs, seed {trial.seed})"
    return headline(f"{trial.problem.name}: {trial.label}", duration)


def _optimum(trials: Sequence[Trial]) -> tuple[Trajectory | None, str]:
    """The exact planners' shortest trajectory, and what it is an optimum of; or the record's."""
    recorded = _recorded(trials)
    if recorded is not None:
        return recorded, "best known"
    asked = [trial for trial in trials if trial.planner in REFERENCES]
    answered = [trial for trial in asked if trial.solution.trajectory is not None]
    if not answered:
        return None, ""
    best = min(answered, key=lambda t: (t.certified_duration or np.inf, t.claimed_duration))
    if best.certified_trajectory is not None:
        return best.certified_trajectory, "exact optimum"
    limits: list[LimitName] = ["jerk", "position"]
    ignored = " or ".join(name for name in limits if best.problem.has(name))
    return best.solution.trajectory, f"best known without {ignored} limits (relaxed)"


def _recorded(trials: Sequence[Trial]) -> Trajectory | None:
    """The recorded motion of the problem, where it is what gaps are measured against."""
    for reference in Summary(trials).references.values():
        if reference.recorded:
            return records.answer(trials[0].problem).trajectory
    return None


def _convergence(trials: Sequence[Trial]) -> dict[str, Any]:
    """What the figure of it shows: the certified histories of the searches, if there are any."""
    found = histories(trials)
    best, runs = found
    searching = searches([found])
    curves = {}
    for label, own in runs.items():
        if label in searching:
            curves[label] = sampling.over_runs(own)
    if not curves:
        return {}
    return {"curves": curves, "best": best if np.isfinite(best) else None}


def median_run(runs: Sequence[Trial]) -> Trial | None:
    """The run with the median certified duration (the lower of two), of those that have one."""
    certified = [trial for trial in runs if trial.certified_duration is not None]
    ordered = sorted(certified, key=lambda t: (t.certified_duration or np.inf, t.seed))
    while ordered:
        middle = ordered.pop((len(ordered) - 1) // 2)
        if middle.certified_trajectory is not None:  # computed here, for the run that is shown only
            return middle
    return None


def by_label(trials: Sequence[Trial]) -> dict[str, list[Trial]]:
    """Each planner's trials, by its name with its options."""
    groups: dict[str, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(trial.label, []).append(trial)
    return groups


def distinct_names(keys: Sequence[tuple[str, str]]) -> list[str]:
    """File names for `(name, digest)` pairs: portable, with a digest where names clash."""
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
