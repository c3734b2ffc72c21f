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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from pathlib import Path
from zlib import crc32

from trajopt.benchmark.suites import edges, families, literature, robots
from trajopt.core import built_in
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.problem import Problem
from trajopt.planners.kinematics import Robot

THE_PAPERS = "six-axis"

_PER_FAMILY = 18
# What a suite's problems share: an arm, a random family, a paper.
_SHARED = re.compile(r"(robots-.+)-w\d+(?:-jerk)?|(random-[a-z]+)-.+")


@cache
def problem_files() -> dict[str, Path]:
    """Every built-in problem file by name, the paper's own first."""
    files = built_in.files("problems")
    return {THE_PAPERS: files[THE_PAPERS], **files}


def find(name_or_path: str) -> Path | None:
    """The file of a problem, from its name or its path; None where a suite makes it in code.

    A path has a dot or a slash.

    Raises:
        UnknownName: with the names there are.
        InvalidInput: the file does not exist.
    """
    named = problem_files() | literature.files()
    if name_or_path in named:
        return named[name_or_path]
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.suffix or len(path.parts) > 1:
        raise InvalidInput(
            "problem",
            "a problem file that exists, or a built-in name",
            file=name_or_path,
        )
    _made(name_or_path)
    return None


def load(name_or_path: str) -> Problem:
    """A problem by name or path; errors name the file, key, joint and value."""
    file = find(name_or_path)
    if file is None:
        return _made(name_or_path)
    return Problem.from_toml(file)


def group(problem: Problem) -> str:
    """What a problem shares with others from which it is not independent.

    Of a suite's problem its arm, random family or paper; of any other its limits, which are the
    robot's.
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
    """The problem of a suite that is made in code; raises `UnknownName`."""
    for named in (robots.named, edges.named, families.named):
        problem = named(name)
        if problem is not None:
            return problem
    suite, _, _ = name.partition("-")
    if suite in ("robots", "edges"):
        known = [problem.name for problem in problems(suite)]
        raise UnknownName("problem", name, known)
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


@dataclass(frozen=True)
class Suite:
    """Problems that belong together; `stream` makes them, lazily and always the same ones.

    Where `stream` has no end, `size` is how many of them are meant by default.
    """

    name: str
    description: str
    version: int
    stream: Callable[[], Iterator[Problem]]
    size: int | None = None

    def problems(self, size: int | None = None) -> list[Problem]:
        """The first `size` problems, or fewer where there are no more."""
        if size is not None and size < 1:
            raise InvalidInput("size", "1 or more", value=size)
        return list(islice(self.stream(), size or self.size))


def suites() -> dict[str, Suite]:
    """Every suite by name; each random family is one too."""
    found = [
        Suite(
            THE_PAPERS,
            "the problem of Ma et al. 2024",
            version=1,
            stream=_the_papers,
        ),
        Suite(
            "edges",
            "degenerate problems, one kind each",
            version=edges.EDGES_VERSION,
            stream=_edges,
        ),
        Suite(
            "robots",
            f"{len(robots.arm_files())} real arms",
            version=robots.ROBOTS_VERSION,
            stream=robots.stream,
        ),
        Suite(
            "literature",
            "published problems, with the times published for them",
            version=literature.LITERATURE_VERSION,
            stream=literature.stream,
        ),
        Suite(
            "random",
            "its families by turns",
            version=families.VERSION,
            stream=families.stream,
            size=len(families.FAMILIES) * _PER_FAMILY,
        ),
    ]
    for name, family in families.FAMILIES.items():
        of_one_family = Suite(
            f"random-{name}",
            family.description,
            version=families.VERSION,
            stream=partial(families.stream, name),
            size=_PER_FAMILY,
        )
        found.append(of_one_family)
    return {suite.name: suite for suite in found}


def _the_papers() -> Iterator[Problem]:
    yield load(THE_PAPERS)


def _edges() -> Iterator[Problem]:
    """The small built-in files, then those made in code."""
    for name in problem_files():
        if name != THE_PAPERS:
            yield load(name)
    yield from edges.stream()


def problems(name: str, size: int | None = None) -> list[Problem]:
    """The problems of a suite, each with its own name; raises `UnknownName` or `InvalidInput`."""
    known = suites()
    if name not in known:
        raise UnknownName("suite", name, known)
    return known[name].problems(size)
