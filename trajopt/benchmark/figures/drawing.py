"""One figure to be drawn: what it shows, its file, and whether that shows it already."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from trajopt.problem import Problem
from trajopt.trajectory import Trajectory

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
        from trajopt.benchmark.figures import plots  # Matplotlib: not where nothing is drawn

        file.parent.mkdir(parents=True, exist_ok=True)
        plots.write(self._figure(), file, digest)

    def _figure(self) -> Figure:
        from trajopt.benchmark.figures import motions, plots

        functions: dict[str, Callable[..., Figure]] = {
            "durations": plots.durations,
            "motion": motions.motion,
            "convergence": plots.convergence,
            "gap_distribution": plots.gap_distribution,
        }
        function = functions[self.figure]
        return function(**self.arguments)


class Begun(NamedTuple):
    """A drawing that is being drawn: its digest, and what ends when it is."""

    digest: str
    job: Future[None]


def begin(drawings: Sequence[Drawing], pool: Pool, begun: dict[Path, Begun]) -> None:
    """Let the pool's processes draw what is stale and not `begun` yet, without waiting for it.

    Where later trials change a figure, `draw_all` draws it again.
    """
    for drawing in drawings:
        if drawing.file not in begun and not drawing.current:
            job = pool.submit(drawing.draw)
            begun[drawing.file] = Begun(drawing.digest, job)


def draw_all(
    drawings: Sequence[Drawing],
    pool: Pool | None = None,
    begun: Mapping[Path, Begun] | None = None,
) -> list[Path]:
    """Draw those whose file does not show them yet.

    In the pool's processes, if they run already or there is enough to draw for starting them. What
    one of them fails at is tried again in this process.

    Args:
        drawings: all of them.
        pool: whose processes may help.
        begun: what they draw already, by its file.

    Returns:
        The files of all.

    Raises:
        NotDrawn: once the others are drawn.
    """
    jobs = _still_right(begun or {}, drawings)
    stale = [d for d in drawings if d.file in jobs or not d.current]
    enough = len(stale) >= WORTH_A_PROCESS
    if pool is not None and (enough or pool.is_running):
        for drawing in stale:
            if drawing.file not in jobs:
                jobs[drawing.file] = pool.submit(drawing.draw)
        stale = [drawing for drawing in stale if jobs[drawing.file].exception() is not None]
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


def _still_right(
    begun: Mapping[Path, Begun],
    drawings: Sequence[Drawing],
) -> dict[Path, Future[None]]:
    """What was begun and is still to be shown; the rest ends first, and leaves no other file."""
    digests = {drawing.file: drawing.digest for drawing in drawings}
    right = {}
    for file, (digest, job) in begun.items():
        if digests.get(file) == digest:
            right[file] = job
            continue
        wait([job])
        if file not in digests:
            file.unlink(missing_ok=True)
    return right


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
