"""Files that exist whole or not at all, whatever a signal, a full disk or another run does."""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from trajopt.exceptions import StoreError

T = TypeVar("T")

_QUIET, _OLD = 60.0, 86400.0  # s untouched: litter if its process is gone; litter anyway


def write(path: Path, content: Callable[[Path], Any]) -> None:
    """Temporary name in the same folder, `content` fills it, sync, rename, sync the folder.

    Raises `StoreError` with the system's reason; what was there before stays as it was.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(
            f".{path.stem}~{platform.node()}~{os.getpid()}~{uuid4().hex}.tmp"
        )
        try:
            content(temporary)
            _sync(temporary)
            os.replace(temporary, path)
            _sync(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
    except (OSError, RuntimeError) as error:
        if isinstance(error, StoreError) or not (reason := _reason(error)):
            raise
        raise StoreError(f"{path}: cannot be written: {reason}") from error


def _reason(error: Exception) -> str:
    """The system's words, which HDF5 wraps in its own; empty for errors of another kind."""
    if found := re.search(r"errno = (\d+)", str(error)):
        return os.strerror(int(found[1]))
    return (error.strerror or str(error)) if isinstance(error, OSError) else ""


class Disk(FileIO):
    """A file that keeps the error of a write to itself until it is closed.

    HDF5 2.0 may take the process down (a segmentation fault) when the disk is full.
    """

    error: OSError | None = None

    def write(self, data: Any) -> int:
        return self._tried(self._write_all, memoryview(data)) or len(data)

    def truncate(self, size: int | None = None) -> int:
        return self._tried(super().truncate, size) or 0

    def _write_all(self, data: memoryview) -> None:
        while data:
            data = data[super().write(data) :]

    def _tried(self, action: Callable[[Any], Any], value: Any) -> Any:
        try:
            return None if self.error else action(value)
        except OSError as error:
            self.error = error

    def while_well(self, items: Iterator[T]) -> Iterator[T]:
        """The items, as long as everything could be written."""
        for item in items:
            if self.error:
                raise self.error
            yield item

    def __exit__(self, *exception: object) -> None:
        self.close()
        if self.error:
            raise self.error


def _sync(path: str | Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sweep(*folders: Path) -> None:
    """Remove what killed runs left half-written, never what a live one is writing."""
    for file in (file for folder in folders for file in folder.glob(".*.tmp")):
        with suppress(OSError):
            age = time.time() - file.stat().st_mtime
            if age > _OLD or (age > _QUIET and _orphaned(file.name)):
                file.unlink()


def _orphaned(name: str) -> bool:
    """Whether the process that wrote it ran on this machine and is gone."""
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
