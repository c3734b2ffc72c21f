"""One figure to be drawn: what it shows, its file, and whether that shows it already."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, cached_property
from hashlib import sha256
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from trajopt.benchmark.run.pool import Pool
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VectorKind = Literal["svg", "pdf"]

HEAD = 4096  # bytes of a file within which its metadata ends
WORTH_A_PROCESS = 4  # figures: fewer are drawn sooner than a process starts


class NotDrawn(UserWarning):
    """Figures that could not be drawn, and why; `files` are those of the others, which were."""

    def __init__(self, reasons: Mapping[Path, str], files: Sequence[Path]) -> None:
        words = [f"{stem}: not drawn: {reason}" for stem, reason in reasons.items()]
        super().__init__("; ".join(words))
        self.files = files


@dataclass(frozen=True, eq=False)
class Drawing:
    """A function of `plots` by name, its arguments, and the file's path without a suffix."""

    figure: str
    arguments: Mapping[str, Any]
    stem: Path

    @property
    def file(self) -> Path:
        """The PNG: what is drawn where nobody asks for another kind."""
        return self._with("png")

    @cached_property
    def digest(self) -> str:
        """Of all that is shown, and of the code that shows it: 40 hexadecimal digits."""
        whole = sha256(code().encode())
        for part in _parts([self.figure, self.arguments]):
            whole.update(part)
        return whole.hexdigest()[:40]

    @property
    def current(self) -> bool:
        """Whether the file is there and carries this digest."""
        return self.digest.encode() in _head(self.file)

    def draw(self) -> None:
        """Make the file."""
        self._write(self.file, self.digest)

    def write(self, kind: VectorKind) -> None:
        """Make the same figure as vectors, beside where its file is."""
        self._write(self._with(kind))

    def _with(self, suffix: str) -> Path:
        return self.stem.with_name(f"{self.stem.name}.{suffix}")

    def _write(self, file: Path, digest: str = "") -> None:
        from trajopt.views.figures import plots  # Matplotlib: not where nothing is drawn

        file.parent.mkdir(parents=True, exist_ok=True)
        plots.write(self._figure(), file, digest)

    def _figure(self) -> Figure:
        from trajopt.views.figures import motions, plots

        functions: dict[str, Callable[..., Figure]] = {
            "durations": plots.durations,
            "motion": motions.motion,
            "convergence": plots.convergence,
            "gap_distribution": plots.gap_distribution,
        }
        function = functions[self.figure]
        return function(**self.arguments)


class _Begun(NamedTuple):
    """A drawing that a process has been given: its digest, and what ends when it is drawn."""

    digest: str
    job: Future[None]


class Drawer:
    """Draws in the processes of a pool, if there is one; it may begin before all is known.

    Args:
        pool: whose processes draw, if they run already or there is enough to draw for starting
            them.
    """

    def __init__(self, pool: Pool | None = None) -> None:
        self._pool = pool
        self._begun: dict[Path, _Begun] = {}

    def begin(self, drawings: Iterable[Drawing]) -> None:
        """Begin each that is stale, without waiting for it or for the next, if there are processes.

        Where later trials change what a figure shows, `finish` draws it again.
        """
        if self._pool is None:
            return
        for drawing in drawings:
            if drawing.file not in self._begun and not drawing.current:
                self._submit(drawing, self._pool)

    def finish(self, drawings: Sequence[Drawing]) -> list[Path]:
        """Draw those whose file does not show them yet; what nobody wants any more is removed.

        What a process fails at is tried again in this one.

        Args:
            drawings: all of them.

        Returns:
            The files of all.

        Raises:
            NotDrawn: once the others are drawn.
        """
        self._forget_others(drawings)
        stale = [d for d in drawings if d.file in self._begun or not d.current]
        if self._pool is not None and self._is_worth_it(stale, self._pool):
            stale = self._failed(stale, self._pool)
        reasons = {}
        for drawing in stale:
            try:
                drawing.draw()
            except Exception as error:
                reasons[drawing.stem] = str(error) or type(error).__name__
        made = [drawing for drawing in drawings if drawing.stem not in reasons]
        files = [drawing.file for drawing in made]
        if reasons:
            raise NotDrawn(reasons, files)
        return files

    def _submit(self, drawing: Drawing, pool: Pool) -> None:
        job = pool.submit(drawing.draw)
        self._begun[drawing.file] = _Begun(drawing.digest, job)

    def _is_worth_it(self, stale: Sequence[Drawing], pool: Pool) -> bool:
        return pool.is_running or len(stale) >= WORTH_A_PROCESS

    def _failed(self, stale: Sequence[Drawing], pool: Pool) -> list[Drawing]:
        """Let the processes draw them all; those that they failed at."""
        for drawing in stale:
            if drawing.file not in self._begun:
                self._submit(drawing, pool)
        return [d for d in stale if self._begun[d.file].job.exception() is not None]

    def _forget_others(self, drawings: Sequence[Drawing]) -> None:
        """What was begun and is shown no more ends first, and leaves no other file."""
        digests = {drawing.file: drawing.digest for drawing in drawings}
        for file, (digest, job) in list(self._begun.items()):
            if digests.get(file) == digest:
                continue
            wait([job])
            del self._begun[file]
            if file not in digests:
                file.unlink(missing_ok=True)


def _head(file: Path) -> bytes:
    try:
        with file.open("rb") as stream:
            return stream.read(HEAD)
    except OSError:
        return b""


@cache
def code() -> str:
    """What draws: the sources of this package, and Matplotlib's version."""
    sources = sorted(files(__package__).iterdir(), key=lambda file: file.name)
    texts = [file.read_text(encoding="utf-8") for file in sources if file.name.endswith(".py")]
    return "".join([version("matplotlib"), *texts])


def _parts(value: Any) -> Iterator[bytes]:
    """A value as bytes, every number exactly; equal values give equal bytes."""
    yield type(value).__name__.encode()
    if isinstance(value, np.ndarray):
        yield repr((value.dtype.str, value.shape)).encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Trajectory):
        yield from _parts([value.breaks, value.coefficients, value.waypoint_times])
    elif isinstance(value, Problem):
        yield from _parts([value.name, value.digest()])
    elif isinstance(value, Mapping):
        yield from _parts([part for item in value.items() for part in item])
    elif isinstance(value, list | tuple):
        yield repr(len(value)).encode()
        for part in value:
            yield from _parts(part)
    elif is_dataclass(value):
        names = [field.name for field in fields(value)]
        yield from _parts({name: getattr(value, name) for name in names})
    else:
        yield repr(value).encode()
        yield b"\0"
