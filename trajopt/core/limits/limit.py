"""A kind of limit: one demand on a whole motion. Judge, files and figures ask each, and know none.

The four kinds of every robot are in `joint_limit`. A new kind is one subclass in one file; its
`key` enters it in `KINDS`, over which everybody iterates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.out_of_scope import out_of_scope

if TYPE_CHECKING:
    from trajopt.core.problem import Problem
    from trajopt.core.trajectory import Trajectory

KINDS: dict[str, type[Limit]] = {}
"""Every kind of limit by its key, in the order of tables and files."""


class Use(NamedTuple):
    """The worst use of one limit.

    Attributes:
        value: a ratio, 1 at the limit; of a kind that is none (`Limit.is_ratio`), the excess in SI
            units, below 0 inside the limit.
        joint: counted from 0; None where the limit is not one joint's.
        time: s.
    """

    value: float
    joint: int | None
    time: float


class Interval(NamedTuple):
    """A time in which a limit is active: the joint (None if not one joint's), start and end, s."""

    joint: int | None
    start: float
    end: float


class Limit(ABC):
    """A demand on a whole motion. Its numbers are SI: rad (or m) and s.

    Attributes:
        key: its name in problem files, certificates, JSON, HDF5 and tables.
        degree: dilating by `k` divides the use by `k ** degree`; None where no dilation helps.
        is_ratio: whether the use is a ratio, of the motion as repaired. If not, it is an excess in
            SI units, of the motion as given: one beyond the tolerance is a flaw.
        short: its name in a figure's labels.
        smooth: the highest derivative that may not jump under it; the repair makes it continuous.
        forgiven: whether a planner that does not know the kind may plan without it, because the
            verifier mends or reports what its answer breaks. Other kinds are refused for it.
    """

    key: ClassVar[str]
    short: ClassVar[str]
    degree: ClassVar[int | None] = 1
    is_ratio: ClassVar[bool] = True
    smooth: ClassVar[int] = 0
    forgiven: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "key" in vars(cls):
            KINDS[cls.key] = cls
            cls.short = vars(cls).get("short", cls.name())

    # --- what it is made of ---

    @property
    @abstractmethod
    def numbers(self) -> Array:
        """All its numbers, for digests and stores, in rows; NaN where nothing is limited."""

    @classmethod
    @abstractmethod
    def of_numbers(cls, numbers: Array) -> Self:
        """The limit of stored numbers, NaN where one is not finite; raises `InvalidInput`."""

    @classmethod
    @abstractmethod
    def read(cls, value: Any, joints: int) -> Self:
        """The limit that a person wrote in a problem file or in Python.

        Raises:
            InvalidInput: Names the key, the joint, the value, and what would be right.
        """

    @abstractmethod
    def table(self) -> Any:
        """What `read` reads, in the terms of TOML."""

    @property
    @abstractmethod
    def bounds(self) -> Bools:
        """Which joints it bounds, `(joints,)`."""

    # --- segments that differ ---

    @property
    def segments(self) -> int | None:
        """How many segments it has numbers of; None where it is the same in all."""
        return None

    def of_segment(self, segment: int) -> Any:
        """What a problem file has for one segment (from 0); None where it is as everywhere."""
        return None

    def of_segments(self, numbers: Indices) -> Self:
        """The limit of these segments, by index."""
        return self

    def in_all_segments(self, *, tightest: bool) -> Self:
        """The limit as one that is the same in all: as tight as any, or as wide as any."""
        return self

    # --- the same limit, otherwise ---

    @abstractmethod
    def only(self, joints: Array) -> Self | None:
        """The limit for some joints, by index; None where it says nothing of them alone."""

    @abstractmethod
    def scaled(self, factors: Array) -> Self:
        """The limit with lengths of each joint times a factor, `(joints,)`."""

    @abstractmethod
    def in_units(self, time: float, lengths: Array | float) -> Self:
        """The limit where times count in `time`, s, and positions in `lengths`, rad.

        `lengths` is one for all joints, or `(joints, 1)`.
        """

    @abstractmethod
    def widened(self, joint: int | None, by: float, segment: int | None = None) -> Self:
        """The limit with one joint's part wider by a fraction; the whole of it for None.

        In one segment alone, by index, where segments differ.
        """

    # --- a motion under it ---

    @abstractmethod
    def worst(self, motion: Trajectory) -> Use:
        """The exact worst use, rounded towards more use."""

    def dilation(self, use: Use) -> float:
        """The least factor of dilation that brings a motion with this use within the limit."""
        return 0.0 if self.degree is None else use.value ** (1 / self.degree)

    @abstractmethod
    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        """Every part of a piece in which more than a share of the limit is in use, exactly."""

    @abstractmethod
    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        """The use of each bounded joint, or of None, at times `(m,)`, s, for figures."""

    def edges(self, motion: Trajectory, times: Array) -> Mapping[tuple[int, int], Array]:
        """Return what it allows of derivatives along a motion, where that changes, for figures.

        By order and joint: the lowest and highest value at times `(m,)`, s, `(2, m)`.
        """
        return {}

    def infeasible(self, problem: Problem) -> str | None:
        """Return why no motion through the waypoints keeps the limit; None where that is not known.

        A reason must be a proof: planners that know the limit then answer `infeasible`.
        """
        return None

    def velocities(self, joint: int, lowest: Array, highest: Array) -> tuple[Array, Array]:
        """The lowest and highest velocities that it allows a joint somewhere between positions.

        Infinite where it bounds none.
        """
        return np.full(len(lowest), -np.inf), np.full(len(lowest), np.inf)

    # --- words ---

    @classmethod
    def name(cls) -> str:
        """The kind in words."""
        return cls.key.replace("_", " ")

    def unit(self, problem: Problem) -> str:
        """The unit of its numbers; empty where they have several."""
        return ""

    def of_joint(self, joint: int, problem: Problem) -> str:
        """One joint's part of the limit, in words with units; a dash where it has none."""
        row = [f"{value:.6g}" for value in self.numbers[joint]]
        return " ".join([*row, self.unit(problem)]).strip() if self.bounds[joint] else "–"

    @classmethod
    def amount(cls, use: Use, problem: Problem) -> str:
        """How much is in use, in words."""
        return f"{use.value:.6f} of limit" if np.isfinite(use.value) else "no motion allowed"

    def flaw(self, use: Use, tolerated: Array, problem: Problem) -> str | None:
        """A sentence about a use that neither repair nor dilation mends; None for any other.

        `tolerated` is the excess over a position that counts as none, rad, `(joints,)`.
        """
        return None


def where(use: Use, problem: Problem) -> str:
    """Where a use is: its joint, if it is one joint's, and its time."""
    at = f"at {use.time:.6g} s"
    return at if use.joint is None else f"{problem.joint_labels[use.joint]} {at}"


def named(key: str) -> type[Limit]:
    """The kind of limit of a key.

    Raises:
        InvalidInput: It is another tool's; the message says what comes nearest here.
        UnknownName: There is none.
    """
    if key in KINDS:
        return KINDS[key]
    elsewhere = out_of_scope(key)
    if elsewhere:
        raise InvalidInput(f"limits.{key}", f"this left out: {elsewhere}")
    raise UnknownName("kind of limit", key, KINDS)
