"""One figure to be drawn: what it shows, which files it goes to, and whether they show it already.

Also what draws in a process of its own: `python -m trajopt.benchmark.figures.drawing` reads pickled
drawings from its standard input, makes their files, and ends. It imports no script of the reader's,
so a script needs no `if __name__ == "__main__"` for it.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from hashlib import sha256
from importlib.metadata import version
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import numpy as np

from trajopt.problem import Problem
from trajopt.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEAD = 4096  # bytes of a file within which its metadata ends
WORTH_A_PROCESS = 4  # figures: fewer are drawn sooner than a process starts


@dataclass(frozen=True, eq=False)
class Drawing:
    """A function of `plots` by name, its arguments, and the files' path without a suffix."""

    figure: str
    arguments: Mapping[str, Any]
    stem: Path

    @property
    def files(self) -> list[Path]:
        name = self.stem.name
        return [
            self.stem.with_name(f"{name}.png"),
            self.stem.with_name(f"{name}.svg"),
        ]

    @property
    def has_table(self) -> bool:
        """Whether it shows a table of pandas."""
        return any(hasattr(value, "to_dict") for value in self.arguments.values())

    @cached_property
    def digest(self) -> str:
        """Of all that is shown, and of the code that shows it: 40 hexadecimal digits."""
        whole = sha256(code().encode())
        for part in _parts([self.figure, self.arguments]):
            whole.update(part)
        return whole.hexdigest()[:40]

    @property
    def current(self) -> bool:
        """Whether both files are there and carry this digest."""
        return all(self.digest.encode() in _head(file) for file in self.files)

    def draw(self) -> None:
        """Make the files."""
        from trajopt.benchmark.figures import plots  # Matplotlib: not where nothing is drawn

        self.stem.parent.mkdir(parents=True, exist_ok=True)
        plots.save(self._figure(), self.stem, self.digest)

    def write_pdf(self) -> None:
        """Make the same figure as a PDF, beside where its files are."""
        from trajopt.benchmark.figures import plots

        self.stem.parent.mkdir(parents=True, exist_ok=True)
        file = self.stem.with_name(f"{self.stem.name}.pdf")
        plots.save_pdf(self._figure(), file)

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


def draw_all(drawings: Sequence[Drawing], processes: int) -> None:
    """Draw those whose files do not show them yet, in this process and up to `processes − 1` more.

    Raises what a figure here raised; those of a process that failed are drawn here instead.
    """
    stale = [drawing for drawing in drawings if not drawing.current]
    # this process takes the first share: it has loaded pandas, a helper need not
    stale.sort(key=lambda drawing: not drawing.has_table)
    shares = max(1, min(processes, len(stale) // WORTH_A_PROCESS))
    own, *others = _shared(stale, shares)
    helpers = [_started(share) for share in others]
    try:
        for drawing in own:
            drawing.draw()
        for helper, share in zip(helpers, others, strict=True):
            if helper.wait() != 0:
                for drawing in share:
                    drawing.draw()
    finally:
        for helper in helpers:
            helper.kill()


def _shared(drawings: Sequence[Drawing], shares: int) -> list[Sequence[Drawing]]:
    """So many parts of the same size or one more, one after another."""
    ends = [len(drawings) * share // shares for share in range(shares + 1)]
    return [drawings[start:end] for start, end in pairwise(ends)]


def _started(drawings: Sequence[Drawing]) -> subprocess.Popen[bytes]:
    """A process that draws them; they are in a file, since a pipe holds few of them."""
    command = [sys.executable, "-m", __name__]
    with TemporaryFile() as file:
        pickle.dump(list(drawings), file)
        file.seek(0)
        return subprocess.Popen(command, stdin=file, stderr=subprocess.DEVNULL)


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
    elif hasattr(value, "to_dict"):  # a table of pandas, which is not imported for this
        yield from _parts(value.to_dict("list"))
    else:
        yield repr(value).encode()
        yield b"\0"


if __name__ == "__main__":
    for drawing in pickle.load(sys.stdin.buffer):
        drawing.draw()
