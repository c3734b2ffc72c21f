"""What every kind of limit offers: reading, judging, scaling, words and figures.

The judge, files, tables and figures call these methods and name no kind. The four kinds of every
robot are in `joint_limit`. A new kind is one subclass in one file. Its `key` registers it in
`KINDS`, over which all other code iterates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.limits import strangers
from trajopt.core.out_of_scope import out_of_scope

if TYPE_CHECKING:
    from trajopt.core.chain import LinkChain
    from trajopt.core.limits.rows import JointState, Row
    from trajopt.core.problem import Problem
    from trajopt.core.trajectory import Trajectory

KINDS: dict[str, type[Limit]] = {}
"""Every kind of limit by its key, in the order of tables and files."""


class Use(NamedTuple):
    """The worst use of one limit.

    Attributes:
        value: a ratio, 1 at the limit. For kinds whose use is no ratio (`Limit.is_ratio`): the
            excess over the limit in SI units, below 0 inside.
        joint: index from 0; None where the limit is not one joint's.
        time: s.
    """

    value: float
    joint: int | None
    time: float


class Interval(NamedTuple):
    """An interval of time in which a limit is active: joint or None, start and end, s."""

    joint: int | None
    start: float
    end: float


class Limit(ABC):
    """A limit of a whole motion. Its numbers are SI: rad (or m) and s.

    Attributes:
        key: its name in problem files, certificates, JSON, HDF5 and tables.
        degree: dilating by `k` divides the use by `k ** degree`; None where no dilation helps.
        power: its rows state the use to this power: 2 for a speed whose row is a square.
        is_ratio: whether the use is a ratio, measured on the repaired motion. If not, it is an
            excess in SI units, measured on the given motion; above the tolerance it is a flaw.
        short: its name in a figure's labels.
        smooth: the highest derivative that must be continuous; the repair makes it so.
        forgiven: whether a planner that does not know the kind may ignore it. The verifier then
            dilates or reports its answer. With any other kind such a planner refuses the problem.
        separate: whether it limits each joint by itself, whatever the others do. Then it can be
            stated in other units of length, joint by joint (`in_units`).
        by_segment: whether a segment may have its own (`[[limits.segment]]`).
        of_chain: whether `true` in a file means the limit that an arm's drives have (`for_chain`).
        monotone: whether a motion that keeps it, slowed down, keeps it.
        flag: what its option on the command line means, which takes one number; empty where it has
            none. The option's name is that of its key.
        flag_is_text: whether the option takes a text instead, as a file states it.
    """

    key: ClassVar[str]
    short: ClassVar[str]
    degree: ClassVar[int | None] = 1
    power: ClassVar[int] = 1
    is_ratio: ClassVar[bool] = True
    smooth: ClassVar[int] = 0
    forgiven: ClassVar[bool] = False
    separate: ClassVar[bool] = False
    by_segment: ClassVar[bool] = False
    of_chain: ClassVar[bool] = False
    monotone: ClassVar[bool] = True
    flag: ClassVar[str] = ""
    flag_is_text: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "key" in vars(cls):
            strangers.enter(cls, KINDS)
            cls.short = vars(cls).get("short", cls.name())

    # --- numbers, and how they are written ---

    numbers: Array
    """All its numbers in rows, for digests and stores; NaN where nothing is limited."""

    @classmethod
    @abstractmethod
    def of_numbers(cls, numbers: Array) -> Self:
        """Return the limit of `numbers`; NaN stands for no limit. Raises `InvalidInput`."""

    @classmethod
    @abstractmethod
    def read(cls, value: Any, joints: int) -> Self:
        """Return the limit of a value in a problem file or in Python.

        Raises:
            InvalidInput: Names the key, the joint, the value, and what would be right.
        """

    @abstractmethod
    def table(self) -> Any:
        """Return the limit in the form that `read` takes, for TOML."""

    @property
    @abstractmethod
    def bounds(self) -> Bools:
        """Return which joints it bounds, `(joints,)`."""

    # --- segments that differ ---

    @property
    def segments(self) -> int | None:
        """Return the number of segments it has numbers for; None if all have the same limit."""
        return None

    @classmethod
    def read_segment(cls, segment: int, value: Any, joints: int) -> Self:
        """Return the limit of one segment (from 0), as its table states it.

        Raises:
            InvalidInput: Names the key, the segment, the joint, the value, and what would be right.
        """
        raise NotImplementedError

    @classmethod
    def of_each(cls, each: Sequence[Self | None]) -> Self:
        """Return the limit that is one of these in each segment; None where none was stated."""
        raise NotImplementedError

    def of_segment(self, segment: int) -> Any:
        """Return the table of one segment (from 0) in a problem file; None if it needs none."""
        return None

    def of_segments(self, numbers: Indices) -> Self:
        """Return the limit of some segments, by index."""
        return self

    def in_all_segments(self, *, tightest: bool) -> Self:
        """Return one limit for all segments: the tightest, or the widest, of each joint."""
        return self

    # --- the limit for fewer joints, in other units, or wider ---

    @abstractmethod
    def only(self, joints: Array) -> Self | None:
        """Return the limit of some joints, by index; None if it also depends on other joints."""

    @abstractmethod
    def converted(self, sizes: Array) -> Self:
        """Return the limit in rad (or m), whose lengths were written in units of these sizes.

        `sizes` has one of each joint, `(joints,)`: a file may state degrees.
        """

    def in_units(self, time: float, lengths: Array | float) -> Self:
        """Return the limit with times in units of `time`, s, and positions in `lengths`, rad.

        `lengths` is one number for all joints, or `(joints, 1)`. Only `separate` limits have other
        units: planners that need them are not asked to plan for others.
        """
        raise NotImplementedError

    @abstractmethod
    def widened(self, joint: int | None, by: float, segment: int | None = None) -> Self:
        """Return the limit, wider by the fraction `by` for one joint, or for all if it is None.

        `segment` widens it in one segment only, by index, where segments differ.
        """

    def for_chain(self, chain: LinkChain | None) -> Limit:
        """Return the limit of an arm with these link frames; itself where it needs none.

        Raises:
            InvalidInput: The limit needs link frames, and the robot has none.
        """
        return self

    def contradicted(self, problem: Problem) -> InvalidInput | None:
        """Return the error of a problem whose way is not possible under it; None where it may be.

        It names the joint, the waypoint, the value, and what would be right.
        """
        return None

    # --- what it asks of a state ---

    def rows(self, at: JointState) -> Iterator[Row]:
        """Yield its inequalities at a state (`trajopt.core.limits.rows`).

        Planners that know no kind of limit by name plan with them. Only the planners that name a
        kind plan for one without rows. The number of rows, and what each computes, depend on the
        limit's numbers alone. Of a `separate` kind the state may have other units, and then the
        limit has them too (`in_units`).
        """
        raise NotImplementedError

    def path_rows(self, at: JointState) -> Iterator[Row]:
        """Yield its inequalities in the form in which a path is timed; by default `rows`.

        Along a path with speed `w`, acceleration `x` and jerk `y` of its parameter, the value of a
        row must be a sum of 1, `w`, `w²`, `x`, `w³`, `w x` and `y` times functions of position, and
        its bounds may be functions of position. `at` holds arrays.
        """
        return self.rows(at)

    @classmethod
    def has_rows(cls) -> bool:
        """Return whether it states its inequalities."""
        return cls.rows is not Limit.rows

    # --- a motion under it ---

    @abstractmethod
    def worst(self, motion: Trajectory) -> Use:
        """Return the exact worst use, rounded upwards."""

    def at_instants(self, motion: Trajectory, smooth: Indices) -> Use | None:
        """Return the worst use in segments that take no time; None where none counts.

        Args:
            motion: a motion.
            smooth: the highest derivative of each joint that does not jump, `(joints,)`.
        """
        return None

    def dilation(self, use: Use, motion: Trajectory) -> float:
        """Return the least dilation that brings a motion within the limit, infinite if none does.

        Args:
            use: the motion's worst use.
            motion: the motion, for kinds whose use is no power of the dilation.
        """
        return 0.0 if self.degree is None else use.value ** (1 / self.degree)

    def keeps(self, use: Use, rtol: float) -> bool:
        """Return whether a dilation by less than `1 + rtol` brings this use within the limit."""
        return self.degree is None or use.value ** (1 / self.degree) <= 1 + rtol

    def hopeless(self, use: Use, motion: Trajectory, problem: Problem) -> str:
        """Return why no dilation brings a motion within the limit, in words."""
        return f"{where(use, problem)}: no dilation brings it within its {self.name()} limit"

    @abstractmethod
    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        """Yield the exact intervals in which more than `share` of the limit is used, per piece."""

    @abstractmethod
    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        """Return the use of each bounded joint at times `(m,)`, s, for figures.

        The key is None where the limit is not one joint's.
        """

    def edges(self, motion: Trajectory, times: Array) -> Mapping[tuple[int, int], Array]:
        """Return the bounds of derivatives that change along a motion, for figures.

        The key is order and joint, the value the lowest and highest derivative at times `(m,)`, s,
        `(2, m)`.
        """
        return {}

    def infeasible(self, problem: Problem) -> str | None:
        """Return why no motion through the waypoints keeps the limit; None where that is not known.

        A reason must be a proof: planners that know the limit then answer `infeasible`.
        """
        return None

    def least_times(self, problem: Problem) -> Array:
        """Return times, s, that segments take at least under this limit, `(segments,)`.

        They must be proved, in closed form: they make the lower bounds of planners that leave the
        limit out larger.
        """
        return np.zeros(problem.segments)

    def velocities(self, joint: int, lowest: Array, highest: Array) -> tuple[Array, Array]:
        """Return the lowest and highest velocity that it allows at any position of a range.

        `lowest` and `highest` are the ends of ranges of this joint's position. The velocities are
        infinite where the limit bounds none.
        """
        return np.full(len(lowest), -np.inf), np.full(len(lowest), np.inf)

    # --- words ---

    @classmethod
    def name(cls) -> str:
        """Return the name of the kind in words."""
        return cls.key.replace("_", " ")

    def unit(self, problem: Problem) -> str:
        """Return the unit of its numbers; empty where they have several."""
        return ""

    def of_joint(self, joint: int, problem: Problem) -> str:
        """Return one joint's limit in words with units; a dash where it has none."""
        row = [f"{value:.6g}" for value in self.numbers[joint]]
        return " ".join([*row, self.unit(problem)]).strip() if self.bounds[joint] else "–"

    @classmethod
    def amount(cls, use: Use, problem: Problem) -> str:
        """Return the amount of a use in words."""
        return f"{use.value:.6f} of limit" if np.isfinite(use.value) else "no motion allowed"

    def flaw(self, use: Use, tolerated: Array, problem: Problem) -> str | None:
        """Return a sentence if neither repair nor dilation removes this excess; else None.

        `tolerated` is the largest excess over a position limit that is not a flaw, rad,
        `(joints,)`.
        """
        return None


def where(use: Use, problem: Problem) -> str:
    """Return where a use is, in words: its joint, if it has one, and its time."""
    at = f"at {use.time:.6g} s"
    return at if use.joint is None else f"{problem.joint_labels[use.joint]} {at}"


def named(key: str) -> type[Limit]:
    """Return the kind of limit with this key.

    Raises:
        InvalidInput: Other tools have such a limit; the message names what comes nearest here.
        InvalidInput: A package registers it, and it cannot be imported.
        UnknownName: There is no such kind.
    """
    if key in KINDS:
        return KINDS[key]
    if key in strangers.registered():
        return strangers.load(key, KINDS)
    elsewhere = out_of_scope(key)
    if elsewhere:
        raise InvalidInput(f"limits.{key}", f"this left out: {elsewhere}")
    raise UnknownName("kind of limit", key, [*KINDS, *strangers.registered()])


def in_file(spec: str) -> type[Limit]:
    """Import a kind of limit that a Python file defines; see `strangers.in_file`."""
    return strangers.in_file(spec, KINDS)
