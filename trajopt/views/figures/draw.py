"""The figures of trials, one folder per problem.

    draw(trials, Path("results/figures"))           # what a comparison shows, as PNG
    write(results, Path("svg"), "svg")              # these and every motion, for a paper

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

from trajopt.benchmark.best_known import records
from trajopt.benchmark.trial import Trial
from trajopt.core.arrays import Array
from trajopt.core.exceptions import StoreError
from trajopt.core.limits import KINDS
from trajopt.core.trajectory import Trajectory
from trajopt.explain.references import PROVERS, REFERENCES
from trajopt.planners.planner import Planner
from trajopt.views.analysis.curves import anytime, counted, everywhere, gap_shares, profile
from trajopt.views.analysis.gap_reference import references
from trajopt.views.analysis.overview import competing, measured
from trajopt.views.analysis.pairwise import medians, shortest
from trajopt.views.analysis.results import Tables
from trajopt.views.analysis.searches import Cost, histories, searches
from trajopt.views.analysis.versions import by_label, by_problem
from trajopt.views.figures import sampling
from trajopt.views.figures.shown_motion import ShownMotion
from trajopt.views.figures.style import KNOWN, SPOKEN, headline, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trajopt.benchmark.front import Beside, Front
    from trajopt.explain.decomposition import Explanation
    from trajopt.judgement import Judgement
    from trajopt.retiming import Retiming

Picture = tuple[str, Callable[[], "Figure"]]  # a file's name without suffix, and what draws it

MOTIONS = 3  # number of planners whose motions are drawn, per problem
# Planners whose motions are drawn after those of a user's own planners.
LOOKED_FOR = ("toppra", "ruckig-stop", "issa")
NAME_LENGTH = 80  # characters of a file's name


def draw(trials: Sequence[Trial], folder: Path) -> list[Path]:
    """Draw every problem of a comparison into `folder/<problem>/`, as PNG.

    The figures are `durations`; `convergence` if planners keep a history; `gaps` if any ran more
    than once; `overlay` of a few motions on one time axis, and `motion-<label>` of each of them.
    These are the motions of planners from elsewhere (of many the shortest, the middle and the
    longest), then of TOPP-RA, Ruckig and ISSA, then the shortest ones. Of several runs the median
    one is drawn. A folder whose figures already show these trials is left as it is.

    Returns:
        The files. A figure that cannot be drawn is a warning.
    """
    files = []
    for own, name in _problems(trials):
        files += _draw_problem(own, folder / name, _order(trials))
    return files


def _order(trials: Sequence[Trial]) -> list[str]:
    """Return all planners in the order in which they have their colours."""
    return sorted({trial.label for trial in trials})


def of_suite(results: Tables) -> Iterator[Picture]:
    """Yield the figures of all problems, a column wide: `profile`, `gaps` and `anytime-…`.

    In the first two are planners that were run on every problem, all over the same problems.
    """
    from trajopt.views.figures import suite

    order = _order(results.items)
    best_first = results.planners().index
    trials = results.trials()
    ran = everywhere(medians(trials))
    durations = medians(competing(trials))
    labels = [label for label in best_first if label in ran and label in durations]
    shown = profile(durations[labels], shortest(trials))
    counts = counted(durations[labels])
    yield "profile", partial(suite.profile, shown, order, counts)
    measurable = measured(results.gaps())
    if shares := gap_shares(measurable, labels):
        counts = counted(medians(measurable)[list(shares)])
        yield "gaps", partial(suite.gaps, shares, order, counts)
    costs: tuple[Cost, ...] = ("seconds", "evaluations")
    for cost in costs:
        relative = results.over_optimum(cost)
        ordered = {label: relative[label] for label in best_first if label in relative}
        if ordered:
            yield f"anytime-{cost}", partial(suite.anytime, anytime(ordered), order, cost)


def write(
    results: Tables,
    folder: Path,
    kind: Literal["svg", "pdf"],
    *,
    each_problem: bool = True,
    for_dark_pages: bool = False,
) -> None:
    """Write the figures of `draw`, and the motion of every planner, as SVG or PDF.

    Of several problems the figures `of_suite` come first.

    Args:
        results: The trials.
        folder: Where the figures go.
        kind: Of the files.
        each_problem: Of several problems, whether each one's own figures are written too.
        for_dark_pages: Whether black is light, on a transparent ground.

    Raises:
        StoreError: where the disk refuses.
    """
    from trajopt.views.figures import plots
    from trajopt.views.figures.dark import dark

    def made(picture: Callable[[], Figure]) -> Figure:
        return dark(picture()) if for_dark_pages else picture()

    trials = results.items
    try:
        if len(by_problem(trials)) > 1:
            for stem, picture in of_suite(results):
                plots.write(made(picture), folder / f"{stem}.{kind}")
            if not each_problem:
                return
        for own, name in _problems(trials):
            for stem, picture in _pictures(own, _order(trials), every_motion=True):
                plots.write(made(picture), folder / name / f"{stem}.{kind}")
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from error


def explain(trial: Trial, found: Explanation, folder: Path) -> list[Path]:
    """Draw `<problem>-<label>-seed<n>-waterfall` and `-limit-use`, as PNG and SVG."""
    from trajopt.views.figures import explanation, plots

    problem = trial.problem.name
    name = f"{problem}: {trial.label}"
    stem = _portable(f"{problem}-{trial.label}-seed{trial.seed}")
    files: list[Path] = []
    panels = []
    for which, own in found.steps().items():
        title = headline(name, f", {which}")
        panels.append((title, own))
    if panels:
        climb = explanation.waterfalls(panels, planner=trial.label)
        files += plots.save(climb, folder / f"{stem}-waterfall")
    use = explanation.limit_use(
        trial.problem,
        found.trajectory,
        found.optimum,
        headline(name, f", {found.certified_duration:#.4g} s"),
        trial.label,
    )
    files += plots.save(use, folder / f"{stem}-limit-use")
    return files


def judged(found: Judgement, folder: Path) -> Path:
    """Draw a motion as it is, its limits, and the optimum behind: `<problem>-<motion>.png`."""
    from trajopt.views.figures import motions, plots

    name = f"{found.problem.name}-{found.motion.name}"
    optimum = found.explanation.optimum if found.explanation else None
    verdict = f", {found.claimed_duration:#.4g} s"
    if not found.certificate.valid:
        verdict += ", slowing down does not help"
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
    return plots.write(figure, folder / f"{_portable(name)}.png")


def retimed(found: Retiming, folder: Path) -> Path:
    """Draw the speed along a path beside the ceiling of each limit: `<path>-along.png`."""
    from trajopt.views.figures import along, plots

    title = headline(f"{found.name} along its path", f", {found.duration:#.4g} s")
    return plots.write(along.speed(found, title), folder / f"{_portable(found.name)}-along.png")


def front(found: Front, beside: Sequence[Beside], folder: Path) -> list[Path]:
    """Draw a front and the motions beside it: `<problem>-front-<measure>`, as PNG, SVG and PDF."""
    from trajopt.views.figures import front as fronts
    from trajopt.views.figures import plots

    figure = fronts.curve(found, beside)
    stem = _portable(f"{found.problem.name}-front-{found.measure}")
    files = plots.save(figure, folder / stem)
    return [*files, plots.write(figure, folder / f"{stem}.pdf")]


def _problems(trials: Sequence[Trial]) -> Iterator[tuple[list[Trial], str]]:
    """Yield the trials of every problem, and the name of its folder."""
    problems = by_problem(trials)
    keys = [(own[0].problem.name, digest) for digest, own in problems.items()]
    yield from zip(problems.values(), distinct_names(keys), strict=True)


def _draw_problem(trials: Sequence[Trial], folder: Path, order: Sequence[str]) -> list[Path]:
    """Draw the figures of one problem, unless its stamp says that they show these trials.

    The stamp is a file beside the folder: a digest of the trials and of the files' names.
    """
    stamp = folder.with_name(f".{folder.name}.trials")
    if stamp.is_file() and stamp.read_bytes() == _digest(trials, folder, order):
        return sorted(folder.glob("*.png"))
    from trajopt.views.figures import plots

    for earlier in folder.glob("motion-*.png"):
        earlier.unlink()  # the planners that are shown may be others
    files = []
    failed = False
    for stem, picture in _pictures(trials, order):
        file = folder / f"{stem}.png"
        try:
            files.append(plots.write(picture(), file))
        except Exception as error:
            failed = True
            warnings.warn(f"{file}: not drawn: {error}", stacklevel=3)
    if not failed:
        stamp.write_bytes(_digest(trials, folder, order))
    return files


def _digest(trials: Sequence[Trial], folder: Path, order: Sequence[str]) -> bytes:
    """Return a digest of the trials' identities, starts and verdicts, and of files and order."""
    names = [*order, *(file.name for file in folder.glob("*.png"))]
    for trial in trials:
        names.append(f"{trial.id} {trial.label} {trial.started} {trial.status}")
    text = "\n".join(sorted(names))
    return sha256(text.encode()).digest()


def _pictures(
    trials: Sequence[Trial], order: Sequence[str], *, every_motion: bool = False
) -> Iterator[Picture]:
    """Yield the figures of one problem; planners have their colours in this order."""
    from trajopt.views.figures import plots

    title = headline(trials[0].problem.name)
    results = Tables(trials)
    yield "durations", partial(plots.durations, results.lines(), title)
    yield from _overlay(trials, order)
    yield from _motions(trials, order, every_motion=every_motion)
    if curves := _convergence(trials):
        best = histories(trials).best
        known = best if np.isfinite(best) else None
        yield "convergence", partial(plots.convergence, curves, known, title, order)
    gaps = {}
    several = False
    for label, runs in results.gaps().groupby("label", sort=False):
        several |= runs["gap"].count() > 1
        gaps[label] = runs["gap"].to_numpy()
    if several:
        yield "gaps", partial(plots.gap_distribution, gaps, title)


def _convergence(trials: Sequence[Trial]) -> dict[str, tuple[Array, Array]]:
    """Return the curve of every search of the best 3-5-3 whose median is ever certified."""
    found = histories(trials)
    curves = {}
    for label in searches([found]):
        spent, quartiles = sampling.over_runs(found.runs[label])
        if np.isfinite(quartiles[1]).any():
            curves[label] = spent, quartiles
    return curves


def _motions(
    trials: Sequence[Trial], order: Sequence[str], *, every_motion: bool
) -> Iterator[Picture]:
    """Yield a figure per planner, the optimum on top of all but its own."""
    from trajopt.views.figures import motions
    from trajopt.views.figures.plots import planner_look

    medians = _medians(trials)
    labels = [trial.label for trial in medians]
    digests = [sha256(label.encode()).hexdigest() for label in labels]
    keys = list(zip(labels, digests, strict=True))
    names = dict(zip(labels, distinct_names(keys), strict=True))
    optimum, optimum_name = _optimum(trials)
    for trial in medians if every_motion else _telling(medians):
        assert trial.certified_trajectory is not None
        picture = partial(
            motions.motion,
            trial.problem,
            trial.certified_trajectory,
            None if trial.planner in REFERENCES else optimum,
            title=_title(trial, trials),
            reference_name=optimum_name,
            own_name=text(trial.label),
            colour=planner_look(trial.label, order)["color"],
        )
        yield f"motion-{names[trial.label]}", picture


def overlaid(trials: Sequence[Trial]) -> Figure | None:
    """Draw the motions of a few planners on one problem on one time axis; None without two."""
    found = dict(_overlay(trials, _order(trials)))
    return found["overlay"]() if found else None


def _overlay(trials: Sequence[Trial], order: Sequence[str]) -> Iterator[Picture]:
    """Yield the motions of a few planners and the optimum on one time axis."""
    from trajopt.views.figures import overlay

    shown = shown_motions(trials)
    if len(shown) > 1:
        yield "overlay", partial(overlay.overlay, trials[0].problem, shown, order)


def shown_motions(trials: Sequence[Trial], *, every: bool = False) -> list[ShownMotion]:
    """Return the optimum and the median motions of a few planners, or of every one, by duration."""
    medians = _medians(trials)
    optimum, name = _optimum(trials)
    chosen = sorted(medians, key=_duration) if every else _telling(medians)
    shown = [
        ShownMotion(
            trial.label,
            SPOKEN.get(trial.label, trial.label),
            trial.certified_trajectory,
            max(1.0, trial.dilation or 1.0),
        )
        for trial in chosen
        if trial.certified_trajectory is not None and trial.planner not in REFERENCES
    ]
    if optimum is not None:
        shown.insert(0, ShownMotion("exact", name, optimum))
    return shown


def _telling(medians: Sequence[Trial]) -> list[Trial]:
    """Return the trials whose motions are drawn.

    References are left out, since they are drawn behind the others. If there are no others, the
    first reference is kept.
    """
    references = {*REFERENCES, *PROVERS}
    compared = [trial for trial in medians if trial.planner not in references]
    ordered = sorted(compared, key=lambda trial: (_interest(trial), _duration(trial)))
    own = [trial for trial in ordered if _interest(trial) == 0]
    if len(own) > MOTIONS:
        return [own[0], own[len(own) // 2], own[-1]]
    return sorted(ordered[:MOTIONS], key=_duration) or list(medians[:1])


def _interest(trial: Trial) -> int:
    """Return the rank of a planner's motion among those that are drawn."""
    if trial.planner not in KNOWN:
        return 0
    if trial.planner in LOOKED_FOR:
        return 1 + LOOKED_FOR.index(trial.planner)
    return 1 + len(LOOKED_FOR)


def _medians(trials: Sequence[Trial]) -> list[Trial]:
    """Return the median run of every planner that has an answer."""
    runs = (median_run(own) for own in by_label(trials).values())
    return [run for run in runs if run]


def _title(trial: Trial, trials: Sequence[Trial]) -> str:
    duration = f", {trial.certified_duration:#.4g} s"
    runs = 0
    for other in trials:
        if other.label == trial.label and other.certified_duration:
            runs += 1
    if runs > 1:
        duration += f" (median of {runs} runs, seed {trial.seed})"
    return headline(f"{trial.problem.name}: {trial.label}", duration)


def _optimum(trials: Sequence[Trial]) -> tuple[Trajectory | None, str]:
    """Return the trajectory behind all others, and its name.

    It is the record if gaps are measured against it, or else the shortest reference.
    """
    problem = trials[0].problem
    for reference in references(trials).values():
        if reference.recorded:
            record = records.find(problem)
            name = "optimum" if record is not None and record.closed else "best known"
            return records.answer(problem).trajectory, name
    answered = []
    for trial in trials:
        if trial.planner in REFERENCES and trial.claimed_duration:
            answered.append(trial)
    if not answered:
        return None, ""
    best = min(answered, key=lambda trial: (_duration(trial), trial.claimed_duration))
    certified = best.certified_trajectory
    if certified is not None:
        return certified, "exact optimum"
    unknown = [key for key in problem.limits.kinds if key not in Planner.knows]
    ignored = " or ".join(KINDS[key].name() for key in unknown)
    return best.solution.trajectory, f"best known without {ignored} limits (relaxed)"


def _duration(trial: Trial) -> float:
    """Return the certified duration, s; infinite without one."""
    return trial.certified_duration or np.inf


def median_run(runs: Sequence[Trial]) -> Trial | None:
    """Return the run with the median certified duration (the lower of two), if any has one."""
    certified = [trial for trial in runs if trial.certified_duration is not None]
    ordered = sorted(certified, key=lambda trial: (_duration(trial), trial.seed))
    while ordered:
        lower = (len(ordered) - 1) // 2
        middle = ordered.pop(lower)
        if middle.certified_trajectory is not None:  # computed for the run that is shown only
            return middle
    return None


def distinct_names(keys: Sequence[tuple[str, str]]) -> list[str]:
    """Return portable file names for `(name, digest)` pairs, with a digest where names clash."""
    portable = [_portable(name) for name, _ in keys]
    count = Counter(name.casefold() for name in portable)
    names = []
    for name, (_, digest) in zip(portable, keys, strict=True):
        if count[name.casefold()] > 1:
            name += f"-{digest[:8]}"
        names.append(name)
    return names


def _portable(name: str) -> str:
    """Return the name without what file systems refuse, at most `NAME_LENGTH` characters."""
    safe = re.sub(r"[^A-Za-z0-9_.=+-]+", "_", name)
    bare = safe.strip("._")
    return bare[:NAME_LENGTH] or "_"
