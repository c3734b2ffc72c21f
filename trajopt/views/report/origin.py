"""The origin of trials: the command that runs them again, its limits, code and machine."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.problem import Problem

_LIMITS = {
    "timeout_limit": ("--timeout", "time limit of a trial (s)"),
    "memory_limit": ("--memory", "memory limit of a trial (GiB)"),
    "jobs": ("--jobs", "trials side by side"),
}  # the key in provenance, the option that sets it, and the name in the table of facts
_NAMES = {
    "cpu": "processor",
    "isolation": "kept apart from the run by",
    "judge_digest": "digest of the code that judged",
} | {key: name for key, (_, name) in _LIMITS.items()}
_OF_A_PLANNER = ("planner_distribution", "planner_version", "planner_digest")
_NOTHING = {
    "commit": "not known",
    "cpu": "not known",
    "memory_limit": "none",
    "jobs": "not known",
    "isolation": "not known",
    "judge_digest": "not known",
}
_UNLIMITED = "inf"
_OF_A_MOTION = {"interpolation", "digest"}  # options of a `GivenMotion`
_OWN_SUITE_SIZE = 4  # problems: fewer are named one by one


def compare_command(
    items: Sequence[Trial], labels: Sequence[str], problems: Mapping[str, Problem]
) -> str:
    """The `trajopt compare` that runs the same trials again.

    An option is in it where all trials were run with the same value; planners that were given in
    Python are not, since the command line does not know them.

    Args:
        items: the trials.
        labels: their planners, with options.
        problems: by what the command line calls each: a name, or a file.
    """
    command = ["trajopt", "compare", *_asked(problems)]
    names = {trial.label: trial.planner for trial in items}
    files = motions(items)
    unknown = [*files, *scripted(items)]
    for label in labels:
        if names[label] not in unknown:
            command += ["--planner", label]
    for file in files:
        command += ["--motion", file]
    seeds = 1 + max(trial.seed for trial in items)
    command += ["--seeds", str(seeds)]
    for key, (option, _) in _LIMITS.items():
        values = {trial.provenance.get(key, "") for trial in items}
        value = values.pop()
        same = not values
        if same and value not in ("", _UNLIMITED):
            command += [option, value]
    return shlex.join(command)


def _asked(problems: Mapping[str, Problem]) -> list[str]:
    """The arguments that name the problems: whole suites by their names."""
    digests = {problem.digest() for problem in problems.values()}
    suites: list[str] = []
    covered: set[str] = set()
    for name in catalogue.suites():
        members = [key for key in problems if key.startswith(f"{name}-")]
        if len(members) < _OWN_SUITE_SIZE:
            continue
        whole = {problem.digest() for problem in catalogue.problems(name)}
        if whole <= digests and not whole <= covered:
            suites += ["--suite", name]
            covered |= whole
    named = [key for key, problem in problems.items() if problem.digest() not in covered]
    return named + suites


def facts(items: Sequence[Trial]) -> list[tuple[str, str]]:
    """Each fact of the trials' provenance once; where they differ, every value with its count."""
    found: dict[str, Counter[str]] = {}
    for trial in items:
        for key, value in trial.provenance.items():
            of_a_checkout = key == "sources" and not value
            if key in _OF_A_PLANNER or of_a_checkout:
                continue
            nothing = _NOTHING.get(key, "not installed")
            counts = found.setdefault(key, Counter())
            counts[value or nothing] += 1
    told = [("planners' code", planners_code(items))]
    for key, values in found.items():
        name = _NAMES.get(key, key)
        told.append((name, _counted(values)))
    return told


def planners_code(items: Sequence[Trial]) -> str:
    """`mintime 0.1.0: exact, pso; strangers-planners 1.2: mine`."""
    planners: dict[str, set[str]] = {}
    for trial in items:
        name = trial.provenance.get("planner_distribution", "")
        release = trial.provenance.get("planner_version", "")
        code = f"{name} {release}".strip() or "of no distribution"
        planners.setdefault(code, set()).add(trial.planner)
    told = []
    for code, names in planners.items():
        listed = ", ".join(sorted(names))
        told.append(f"{code}: {listed}")
    return "; ".join(told)


def scripted(items: Sequence[Trial]) -> list[str]:
    """Planners that are of no distribution: the command line does not know their names."""
    names = set()
    for trial in items:
        if trial.provenance.get("planner_distribution") == "":
            names.add(trial.planner)
    return sorted(names)


def motions(items: Sequence[Trial]) -> list[str]:
    """Motions that were judged beside the planners, by their files."""
    names = {trial.planner for trial in items if set(trial.options) == _OF_A_MOTION}
    return sorted(names)


def again(trial: Trial, problem: str) -> tuple[str, str]:
    """Return the command that runs a planner on a problem again, or the reason why it cannot.

    Args:
        trial: one of those that it ran.
        problem: what the command line calls the problem.

    Returns:
        The command without a seed, and words instead of it; one of them is empty.
    """
    if scripted([trial]):
        return "", f"{trial.planner} was given in Python: the script that did so runs it again."
    if motions([trial]):
        return "", f"{trial.planner} is a file: trajopt compare {problem} --motion judges it again."
    command = shlex.join(["trajopt", "plan", problem, "--planner", trial.label])
    return command, ""


def _counted(values: Counter[str]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return "; ".join(f"{value} ({count} trials)" for value, count in values.items())


def ranges(seeds: Sequence[int]) -> str:
    """Write sorted seeds as `0–5, 9`."""
    parts: list[list[int]] = []
    for seed in seeds:
        if not parts or parts[-1][-1] < seed - 1:
            parts.append([seed])
        parts[-1][1:] = [seed]
    said = ["–".join(map(str, dict.fromkeys(ends))) for ends in parts]
    return ", ".join(said)
