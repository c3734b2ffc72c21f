"""What people read in the terminal: tables, progress, messages (rich). Joints count from 1."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

if TYPE_CHECKING:
    from trajopt.benchmark.store.verification import Verification
    from trajopt.benchmark.trial import Trial
    from trajopt.explain.active_limits import Binding
    from trajopt.explain.decomposition import Explanation
    from trajopt.problem import Problem

OUT, ERR = Console(highlight=False), Console(stderr=True, highlight=False)


def listing(planners: Sequence[dict[str, Any]], problems: Sequence[dict[str, Any]]) -> None:
    """Planners with their options, then problems."""
    table = Table("planner", "what it is, and its options", box=None, pad_edge=False)
    for p in planners:
        options = ", ".join(f"{k}={v}" for k, v in p["options"].items())
        state = "" if p["available"] else f"\n[red]not available: {p['missing']}[/red]"
        table.add_row(
            f"[bold]{p['name']}[/bold]", f"{p['description']}\n[dim]{options}[/dim]{state}"
        )
    OUT.print(table)
    table = Table("problem", "joints", "waypoints", "limits", box=None, pad_edge=False)
    for p in problems:
        table.add_row(
            f"[bold]{p['name']}[/bold]",
            str(p["joints"]),
            str(p["waypoints"]),
            ", ".join(p["limits"]),
        )
    OUT.print()
    OUT.print(table)


def plan(trial: Trial, file: Path) -> None:
    """One trial: the verdict, then the worst value of each kind."""
    OUT.print(
        f"[bold]{escape(trial.label)}[/bold] on {escape(f'{trial.problem.name} ({file})')}: "
        f"[bold]{trial.status}[/bold]",
        soft_wrap=True,
    )
    if trial.message:
        OUT.print(trial.message.strip().splitlines()[-1], markup=False)
    for name, value in (
        ("claimed", trial.claimed_duration),
        ("certified", trial.certified_duration),
        ("lower bound", trial.lower_bound),
    ):
        if value is not None:
            OUT.print(f"  {name:<12}{value:.6f} s")
    certified = trial.certified_trajectory
    if certified is not None:
        passed = ", ".join(f"{t:.6g}" for t in certified.waypoint_times)
        OUT.print(f"  {'waypoints':<12}{passed} s")
    OUT.print(
        f"  {'computing':<12}{trial.solve_time:.3f} s, after {trial.setup_time:.3f} s of setup"
    )
    if trial.certificate:
        OUT.print(_certificate(trial.certificate.as_dict()))


def _certificate(found: dict[str, Any]) -> Table:
    table = Table("worst", "value", "joint", "time [s]", box=None, pad_edge=False)
    units = {"position": "rad", "waypoint": "rad"}
    derivatives = ("rad", "rad/s", "rad/s²")
    for kind in ("velocity", "acceleration", "jerk", "position", "waypoint", "continuity"):
        worst = found[kind]
        if worst is None:
            continue
        unit = units.get(kind) or derivatives[worst.get("order", 0)]
        value = (
            f"{worst['ratio']:.6f} of limit" if "ratio" in worst else f"{worst['error']:.2e} {unit}"
        )
        table.add_row(kind, value, str(worst["joint"]), f"{worst['time']:.6f}")
    return table


@contextmanager
def progress(total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar over trials on stderr; call what it yields with the number just finished."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=ERR, disable=not ERR.is_terminal, transient=True) as bar:
        task = bar.add_task("trials", total=total)
        yield lambda count: bar.advance(task, count)


@contextmanager
def waiting(message: str) -> Iterator[None]:
    """A spinner on stderr, in a terminal."""
    if not ERR.is_terminal:
        yield
        return
    with ERR.status(message):
        yield


def option_lines(label: str) -> str:
    """A planner's label, an option a line: folding one in the middle would be hard to read."""
    name, _, options = label.partition(":")
    return escape("\n  ".join([name, *filter(None, options.split(","))]))


def explanation(trial: Trial, found: Explanation, figures: Sequence[Path]) -> None:
    """A gap in five lines, as a colleague would put it, and where its figures are."""
    for line in _explained(trial, found):
        OUT.print(f"- {line}", markup=False)
    OUT.print(f"figures: {', '.join(f.name for f in figures if f.suffix == '.png')} in "
               f"{figures[0].parent}", soft_wrap=True, markup=False)  # fmt: skip


def _explained(trial: Trial, found: Explanation) -> Iterator[str]:
    seed = f" (seed {trial.seed})" if trial.solution.history is not None else ""
    what = f"{trial.label}{seed} takes {found.certified_duration:.4f} s on {trial.problem.name}"
    if found.exact is None:
        yield f"{what}; no optimum to compare with: {found.notes['gap']}."
    else:
        yield f"{what}, {found.gap:.3f} times the best known optimum, {found.exact:.4f} s."
    steps = {title: dict(own) for title, own in found.steps().items()}
    if path := steps.get("path and timing"):
        yield (
            f"The best timing of its own path takes {path['route']:.4f} s: its timing costs "
            f"{_percent(found.timing_gap)}, its path {_percent(found.route_gap)}."
        )
    else:
        why = found.notes.get("timing_gap") or found.notes.get("route_gap")
        yield f"Its timing and its path cannot be told apart: {why}."
    if family := steps.get("the 3-5-3 family"):
        yield (
            f"The best 3-5-3 takes {family['shape']:.4f} s: its optimiser costs "
            f"{_percent(found.optimiser_gap)}, the 3-5-3 shape {_percent(found.shape_gap)}, its "
            f"smoothness {_percent(found.smoothness_gap)}."
        )
    else:
        yield f"No 3-5-3 decomposition: {found.notes.get('shape_gap')}."
    yield _busy(trial.problem, found)
    yield _holding(found)


def _percent(ratio: float | None) -> str:
    return "–" if ratio is None else f"{100 * (ratio - 1):.2f} %"


def _busy(problem: Problem, found: Explanation) -> str:
    from trajopt.explain.active_limits import busy

    own = f"Some joint is at a limit for {100 * busy(problem, found.trajectory):.0f} % of its time"
    if found.optimum is None:
        return f"{own}."
    return f"{own}; in the optimum, for {100 * busy(problem, found.optimum):.0f} %."


def _holding(found: Explanation) -> str:
    """The limits worth most, each with its longest stretch."""
    if not found.binding:
        return "No limit holds it back: none is used to 99 %."
    longest: dict[tuple[int, str], Binding] = {}
    for b in sorted(found.binding, key=lambda b: b.start - b.end):
        longest.setdefault((b.joint, b.limit), b)
    worthy = sorted(longest.values(), key=lambda b: -(b.worth or 0.0))
    worthy = [b for b in worthy if (b.worth or 0.0) > 1e-5 * found.certified_duration]
    if not worthy:
        return "It reaches limits, but no single one of them is worth any time."
    held = [
        f"{b.limit} of joint {b.joint + 1} at {b.start:.2f}–{b.end:.2f} s "
        f"({1000 * (b.worth or 0.0):.1f} ms)"
        for b in worthy[:3]
    ]
    return f"Held back by {', '.join(held)}: saved with 1 % more, by {found.notes['worth']}."


def bound(table: dict[str, Any], message: str) -> None:
    """What is proved about a problem's minimum time; the planner's message says what is missing."""
    alone = f", joint {table['joint']} alone" if table["joint"] else ""
    what = f"{table['problem']} ({table['problem_file']}), {table['family']}{alone}"
    OUT.print(f"{escape(what)}: [bold]{table['status']}[/bold]", soft_wrap=True)
    OUT.print(f"  lower bound {table['lower_bound']:.9f} s")
    if table["relative_gap"] < float("inf"):
        OUT.print(f"  upper bound {table['upper_bound']:.9f} s, a verified trajectory's duration")
        OUT.print(f"  gap         {100 * table['relative_gap']:.6f} %")
    else:
        OUT.print("  upper bound none")
        OUT.print(f"  {escape(message)}", soft_wrap=True)
    OUT.print(f"  computing   {table['solve_time']:.2f} s")


def verification(found: Verification) -> None:
    """Claimed against certified, trial by trial, and what does not hold."""
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("problem")
    table.add_column("planner", overflow="fold", ratio=1)
    for name in ("seed", "claimed s", "certified s", "dilation", "verdict"):
        table.add_column(name, justify="right", no_wrap=True)
    for trial in found.trials:
        table.add_row(
            escape(trial.problem),
            option_lines(trial.planner),
            "–" if trial.seed is None else str(trial.seed),
            _number(trial.claimed_duration),
            _number(trial.certified_duration),
            _number(trial.dilation),
            trial.status if trial.holds else "[bold red]DOES NOT HOLD[/bold red]",
        )
    OUT.print(table)
    for line in found.summary():
        OUT.print(line, markup=False)
    for trial in found.trials:
        if not trial.holds:
            name = f"{trial.planner} on {trial.problem}, seed {trial.seed}, trial {trial.id}"
            why = "; ".join([*trial.differences, *filter(None, trial.flaws)])
            OUT.print(f"{name}: {why}", markup=False)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.6f}"
