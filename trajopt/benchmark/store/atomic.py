"""Write files that exist whole or not at all, despite signals, a full disk or other runs."""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from trajopt.core.exceptions import StoreError

_ORPHAN_AGE = 60.0  # s since the last change, after which it is removed if its process has ended
_LITTER_AGE = 86400.0  # s since the last change, after which it is removed in any case


Content = bytes | Callable[[Path], Any]  # bytes, or a function that fills a file


def write(path: Path, content: Content) -> None:
    """Write a file: a temporary file in the folder, sync, rename, sync of the folder.

    Raises `StoreError` with the system's reason; what was there before stays as it was.
    """
    write_all({path: content})


def write_all(contents: Mapping[Path, Content]) -> None:
    """Write several files; each exists whole or not at all.

    They are synced together; one after the other would wait for the disk twice per file. If the
    system refuses a file, those before it are kept.
    """
    temporaries: dict[Path, Path] = {}
    for path in contents:
        with _refusal(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        temporaries[path] = _temporary(path)
    filled: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            with _refusal(path):
                _fill(temporaries[path], content)
            filled[path] = temporaries[path]
    finally:
        try:
            _keep(filled)
        finally:
            for temporary in temporaries.values():
                with suppress(OSError):  # it is not there, or the disk may only be read
                    temporary.unlink()


def _fill(path: Path, content: Content) -> None:
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        content(path)


def _temporary(path: Path) -> Path:
    """Return a temporary name with the machine and process that write it, for `sweep`."""
    owner = f"{platform.node()}~{os.getpid()}"
    return path.with_name(f".{path.stem}~{owner}~{uuid4().hex}.tmp")


def _keep(temporaries: Mapping[Path, Path]) -> None:
    """Sync and rename filled files; after this they survive a power cut."""
    for path, temporary in temporaries.items():
        with _refusal(path):
            _sync(temporary)
    for path, temporary in temporaries.items():
        with _refusal(path):
            os.replace(temporary, path)
    for folder in dict.fromkeys(path.parent for path in temporaries):
        with _refusal(folder):
            _sync(folder)


@contextmanager
def _refusal(path: Path) -> Iterator[None]:
    """Convert the system's errors to a `StoreError` that names the file."""
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise StoreError(f"{path}: cannot be written: {reason}") from error


def _sync(path: str | Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sweep(*folders: Path) -> None:
    """Remove temporary files of killed runs, but none of a live run."""
    for folder in folders:
        for file in folder.glob(".*.tmp"):
            with suppress(OSError):
                if _is_litter(file):
                    file.unlink()


def _is_litter(file: Path) -> bool:
    age = time.time() - file.stat().st_mtime
    if age > _LITTER_AGE:
        return True
    return age > _ORPHAN_AGE and _orphaned(file.name)


def _orphaned(name: str) -> bool:
    """Return whether the writing process ran on this machine and has ended."""
    owner = re.fullmatch(r".*~(.*)~(\d+)~.*", name)
    if not owner or owner[1] != platform.node() or os.name != "posix":
        return False
    try:
        os.kill(int(owner[2]), 0)
    except ProcessLookupError:
        return True
    except PermissionError:  # it is someone else's
        pass
    return False
