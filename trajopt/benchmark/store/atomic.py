"""Files that exist whole or not at all, whatever a signal, a full disk or another run does."""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from trajopt.exceptions import StoreError

_ORPHAN_AGE = 60.0  # s untouched, after which it is litter if its process is gone
_LITTER_AGE = 86400.0  # s untouched, after which it is litter anyway


def write(path: Path, content: Callable[[Path], Any]) -> None:
    """Temporary name in the same folder, `content` fills it, sync, rename, sync the folder.

    Raises `StoreError` with the system's reason; what was there before stays as it was.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        owner = f"{platform.node()}~{os.getpid()}"
        temporary = path.with_name(f".{path.stem}~{owner}~{uuid4().hex}.tmp")
        try:
            content(temporary)
            _sync(temporary)
            os.replace(temporary, path)
            _sync(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
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
    """Remove what killed runs left half-written, never what a live one is writing."""
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
