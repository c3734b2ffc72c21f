"""Problems and suites of problems by name.

    catalogue.load("six-axis")                # a built-in file, or a path
    catalogue.load("robots-ur5e-w4")          # a problem of a suite
    catalogue.problems("robots")              # every problem of a suite
    catalogue.problems("random", size=600)    # a random suite goes on as long as one likes

Results are stored under the digests of problems: a problem that changes never mixes with old
results.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np

from trajopt.benchmark.suites import (
    arms,
    chunks,
    demands,
    edges,
    families,
    literature,
    mixes,
    moving,
    rivals_own,
    robots,
    sections,
)
from trajopt.benchmark.suites.suite import Suite
from trajopt.core import built_in, files
from trajopt.core.arrays import Array
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.problem import Problem, check_problem
from trajopt.formats.motion import ENDINGS
from trajopt.planners.kinematics import Robot

PAPER_PROBLEM = "six-axis"

_PROBLEMS_PER_FAMILY = 18
# Names of problems that share an arm or a random family.
_SHARED = re.compile(r"(robots-.+)-w\d+(?:-jerk)?|(random-[a-z]+)-.+")


@cache
def problem_files() -> dict[str, Path]:
    """Every built-in problem file by name, the paper's own first."""
    files = built_in.files("problems")
    return {PAPER_PROBLEM: files[PAPER_PROBLEM], **files}


def find(name_or_path: str) -> Path | None:
    """Return the file of a problem, given its name or path; None where code makes the problem.

    A path has a dot or a slash.

    Raises:
        UnknownName: There is no such problem; names those that exist.
        InvalidInput: The file does not exist.
    """
    named = problem_files() | literature.files()
    if name_or_path in named:
        return named[name_or_path]
    path = Path(name_or_path)
    if path.exists() and not path.is_dir():  # of a pipe the reader says that it is one
        return path
    if path.suffix or len(path.parts) > 1:
        raise files.absent(Path(name_or_path), ", or a built-in name")
    _made(name_or_path)
    return None


def load(name_or_path: str) -> Problem:
    """Return a problem by its built-in name, or read its file.

    Args:
        name_or_path: `six-axis`, the name of a suite's problem (`robots-ur5e-w4`), or a path, which
            has a dot or a slash.

    Raises:
        UnknownName: There is no such problem; names those that exist.
        InvalidInput: The file does not exist, or its own errors: file, key, joint and value.
    """
    file = find(name_or_path)
    if file is None:
        return _made(name_or_path)
    return Problem.from_toml(file)


def given(problem: object) -> Problem:
    """Return the problem itself, or load the one of this name or path.

    Raises:
        WrongType: It is neither a problem nor a name or path.
        InvalidInput: The path is that of a motion, or the file has an error.
    """
    if isinstance(problem, str | Path):
        if Path(problem).suffix in ENDINGS:
            right = (
                "a problem's name or file (.toml); a motion goes behind it: judge(problem, motion)"
            )
            raise InvalidInput("problem", right, value=str(problem))
        return load(str(problem))
    return check_problem(problem)


def group(problem: Problem) -> str:
    """Name the group of problems that are not independent of this one.

    Problems of a suite are grouped by arm, random family or paper, and all others by their limits,
    which are the robot's.
    """
    name = problem.name
    shared = _SHARED.fullmatch(name)
    if shared is not None:
        return shared[1] or shared[2]
    if name in literature.files():
        paper, _, _ = name.partition("-")
        return paper
    if name in problem_files() or name.startswith("edges-"):
        return name
    limits = [values.tolist() for values in problem.limits.by_name().values()]
    digest = crc32(repr(limits).encode())
    return f"limits {digest:08x}"


def _made(name: str) -> Problem:
    """Return the problem of a suite that is made in code; raise `UnknownName` otherwise."""
    known = suites()
    for suite in known.values():
        problem = suite.named(name)
        if problem is not None:
            return problem
    prefix, _, _ = name.lower().partition("-")
    if prefix in known:
        raise UnknownName("problem", name, [problem.name for problem in problems(prefix)])
    literature.refuse_beyond(name)
    raise UnknownName("problem", name, problem_files() | literature.files())


def robot_files() -> dict[str, Path]:
    """Every built-in robot file by name."""
    return built_in.files("kinematics")


def robot(name_or_path: str) -> Robot:
    """A robot by built-in name or path; raises `UnknownName`, or `InvalidInput` naming the key."""
    path = robot_files().get(name_or_path, Path(name_or_path))
    if not path.is_file():
        raise UnknownName("robot", name_or_path, robot_files())
    return Robot.from_toml(path)


def chain(problem: Problem) -> LinkChain | None:
    """Return the link frames of a problem's joints; None where they are not known.

    A problem without its own, as stored results have it, has those of the built-in robot with the
    same velocity limits, and the same joint names where it has any.
    """
    if problem.chain is not None:
        return problem.chain
    velocity = problem.limits.in_all_segments(tightest=False).velocity
    for names, own, links in _robots():
        same_names = not names or problem.joint_names in ((), names)
        if same_names and np.array_equal(own, velocity):
            return links
    return None


@cache
def _robots() -> list[tuple[tuple[str, ...], Array, LinkChain]]:
    """Return joint names, velocity limits and link frames of each built-in robot that has some."""
    paper = load(PAPER_PROBLEM)
    found = [(paper.joint_names, paper.limits.velocity, robot(PAPER_PROBLEM).chain)]
    arms = [robots.arm(name) for name in robots.arm_files()]
    found += [
        (own.joint_names, own.limits.velocity, own.chain) for own in arms if own.chain is not None
    ]
    return found


def suites() -> dict[str, Suite]:
    """Return every suite by name; each random family is a suite too."""
    found = [
        Suite(PAPER_PROBLEM, "the problem of Ma et al. 2024", 1, partial(_files, PAPER_PROBLEM)),
        Suite("edges", "degenerate problems, one kind each", edges.VERSION, _edges, edges.named),
        Suite(
            "robots",
            f"{len(robots.SUITE_ARMS)} real arms",
            robots.VERSION,
            robots.stream,
            robots.named,
        ),
        literature.SUITE,
        moving.SUITE,
        sections.SUITE,
        demands.SUITE,
        mixes.SUITE,
        rivals_own.SUITE,
        arms.SUITE,
        chunks.SUITE,
        Suite(
            "random",
            "its families by turns",
            families.VERSION,
            families.stream,
            families.named,
            size=len(families.FAMILIES) * _PROBLEMS_PER_FAMILY,
        ),
    ]
    for name, family in families.FAMILIES.items():
        stream = partial(families.stream, name)
        version, size = families.VERSION, _PROBLEMS_PER_FAMILY
        found.append(Suite(f"random-{name}", family.description, version, stream, size=size))
    return {suite.name: suite for suite in found}


def _files(*names: str) -> Iterator[Problem]:
    for name in names:
        yield load(name)


def _edges() -> Iterator[Problem]:
    """Yield the small built-in problems, then the degenerate ones."""
    yield from _files(*list(problem_files())[1:])
    yield from edges.stream()


def problems(name: str, size: int | None = None) -> list[Problem]:
    """Return the problems of a suite, each with its own name.

    Raises:
        UnknownName: There is no such suite.
        InvalidInput: The size is below 1.
    """
    known = suites()
    if name not in known and name in {listed.problem.name for listed in every_problem().values()}:
        right = "the name of a suite; this is a problem's, which goes without --suite"
        raise InvalidInput("suite", right, value=name)
    if name not in known:
        raise UnknownName("suite", name, known)
    return known[name].problems(size)


class Listed(NamedTuple):
    """A problem and the first suite that has it."""

    suite: str
    problem: Problem


@cache
def every_problem() -> dict[str, Listed]:
    """Return the recorded problems of all suites, each once, by their digests."""
    found: dict[str, Listed] = {}
    for name, suite in suites().items():
        for problem in problems(name) if suite.recorded else ():
            found.setdefault(problem.digest(), Listed(name, problem))
    return found
