"""The figures of a comparison, drawn only where an earlier run has not drawn them of these trials.

What was drawn of which trials is noted beside the figures. Without that note every figure's content
would have to be computed to know that it is there already.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from trajopt.benchmark.trial import Trial
from trajopt.views.figures.drawing import Drawer, NotDrawn, code

NOTE = ".drawn.json"  # in the folder of figures


def begin(trials: Sequence[Trial], folder: Path, drawer: Drawer) -> None:
    """Begin to draw what these trials settle, while others still run.

    Args:
        trials: of the planners that have finished.
        folder: where the problems' folders are, or will be.
        drawer: has a process with nothing to do.
    """
    from trajopt.views.figures import draw as figures

    drawer.begin(figures.ahead(trials, folder))


def draw(
    trials: Sequence[Trial],
    folder: Path,
    drawer: Drawer | None = None,
) -> list[Path]:
    """Draw every problem's figures into `folder`, as `figures.draw.draw` does, unless it has.

    Args:
        trials: those of the comparison.
        folder: where the problems' folders are, or will be.
        drawer: has processes that may help, and may have begun.

    Returns:
        The files, also of figures that were there already and show the same. Not of those that
        cannot be drawn, of which there is a warning (`NotDrawn`).
    """
    digest = _digest(trials)
    files = _noted(folder, digest)
    if files:
        return files
    # what only drawing needs: not where there is nothing to draw
    from trajopt.views.figures.draw import draw as draw_now

    try:
        files = draw_now(trials, folder, drawer)
    except NotDrawn as failure:
        warnings.warn(failure, stacklevel=2)
        return [*failure.files]
    stamps = {file.relative_to(folder).as_posix(): _stamp(file) for file in files}
    note = json.dumps({"trials": digest, "files": stamps}, indent=1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NOTE).write_text(note, encoding="utf-8")
    return files


def _digest(trials: Sequence[Trial]) -> str:
    """Of the trials, by identity, start and verdict, and of the code that draws them."""
    rows = []
    for trial in trials:
        row = [
            trial.id,
            trial.problem.name,
            trial.label,
            trial.started,
            trial.solve_time,
            trial.certified_duration,
        ]
        rows.append(json.dumps(row))
    text = "\n".join([code(), *sorted(rows)])
    return sha256(text.encode()).hexdigest()


def _noted(folder: Path, digest: str) -> list[Path]:
    """The files that were drawn of these trials, if all are as they were; else none."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        note = json.loads((folder / NOTE).read_text(encoding="utf-8"))
        files = {folder / name: stamp for name, stamp in note["files"].items()}
        untouched = all(_stamp(file) == stamp for file, stamp in files.items())
        if note["trials"] == digest and untouched:
            return list(files)
    return []


def _stamp(file: Path) -> list[int]:
    """Size, and time of the last change: who edits a figure gets it anew."""
    found = file.stat()
    return [found.st_size, found.st_mtime_ns]
