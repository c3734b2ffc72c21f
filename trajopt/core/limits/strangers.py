"""Kinds of limits of other people: an installed package's, or a Python file's.

A package registers its kind under the entry-point group `trajopt.limits`, by the kind's key:

    [project.entry-points."trajopt.limits"]
    tip_speed = "my_package.tip_speed:TipSpeed"

It is imported when a problem has its key, and not before. It cannot take the key of another kind.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trajopt.core.exceptions import InvalidInput, TrajoptError, UnknownName

if TYPE_CHECKING:
    from trajopt.core.limits.limit import Limit

Kinds = dict[str, "type[Limit]"]  # by key

GROUP = "trajopt.limits"
OURS = "trajopt.core.limits."
_KEY = re.compile(r"[a-z][a-z0-9_]*")


@cache
def registered() -> Mapping[str, EntryPoint]:
    """Return the kinds that packages register, by key; nothing is imported."""
    return {point.name: point for point in entry_points(group=GROUP)}


def is_ours(kind: type[Limit]) -> bool:
    """Return whether a kind is one of this package."""
    return kind.__module__.startswith(OURS)


def enter(kind: type[Limit], kinds: Kinds) -> None:
    """Add a kind to all kinds: ours come first, then others by key, whoever was imported first.

    Raises:
        InvalidInput: The kind has no key, or the key of another kind.
    """
    key, name = kind.key, f"{kind.__module__}.{kind.__qualname__}"
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise InvalidInput("key", f"small letters, digits and _ as the key of {name}", value=key)
    known = kinds.get(key)
    if known is not None and (known.__module__, known.__qualname__) != (
        kind.__module__,
        kind.__qualname__,
    ):
        other = f"{known.__module__}.{known.__qualname__}"
        raise InvalidInput("key", f"another key for {name}: {other} has this one", value=key)
    kinds[key] = kind
    if not is_ours(kind):
        for other in sorted(own for own in kinds if not is_ours(kinds[own])):
            kinds[other] = kinds.pop(other)


def load(key: str, kinds: Kinds) -> type[Limit]:
    """Import the kind that a package registers under this key.

    Raises:
        InvalidInput: The package cannot be imported, or has no kind with this key; names the
            package.
    """
    point = registered()[key]
    package = point.dist.name if point.dist else point.module
    try:
        kind = point.load()
    except (Exception, SystemExit) as error:
        right = f"a kind that package {package} can import from {point.value}"
        told = f"{type(error).__name__}: {error}"
        raise InvalidInput(f"limits.{key}", f"{right} ({told})") from error
    return _checked(kind, key, f"{point.value} of package {package}", kinds)


def in_file(spec: str, kinds: Kinds) -> type[Limit]:
    """Import a kind of limit that a Python file defines, `file.py:Name`, and return it.

    The file's folder joins the import path, as a script's does. So the processes that judge find
    the file, too.

    Raises:
        InvalidInput: There is no such file, Python finds another module under its name, or the
            name is no kind of limit.
        UnknownName: The file defines no such name.
        TrajoptError: The file cannot be imported.
    """
    text, _, name = spec.partition(":")
    file = Path(text).resolve()
    if file.suffix != ".py" or not file.is_file():
        raise InvalidInput("kind", "FILE.py:NAME, a Python file that exists", value=spec)
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    try:
        module = importlib.import_module(file.stem)
    except (Exception, SystemExit) as error:
        told = error if isinstance(error, TrajoptError) else f"{type(error).__name__}: {error}"
        raise TrajoptError(f"kind of limit {spec!r} cannot be loaded: {told}") from error
    found = getattr(module, "__file__", None) or "a module of Python"
    if Path(found).resolve() != file:
        right = f"a file of another name: import {file.stem} finds {found}"
        raise InvalidInput("kind", right, value=text)
    if not hasattr(module, name):
        own = [key for key, member in vars(module).items() if _is_of(member, kinds)]
        raise UnknownName(f"kind of limit of {text}", name, own)
    return _checked(getattr(module, name), None, spec, kinds)


def _is_of(member: Any, kinds: Kinds) -> bool:
    return any(member is own for own in kinds.values())


def _checked(kind: Any, key: str | None, where: str, kinds: Kinds) -> type[Limit]:
    if not _is_of(kind, kinds):
        raise InvalidInput(
            "kind", f"a subclass of Limit with a key, at {where}", value=type(kind).__name__
        )
    own: type[Limit] = kind
    if key not in (None, own.key):
        right = f"the entry point named by the key of its kind, which is {own.key!r}, at {where}"
        raise InvalidInput(f"limits.{key}", right)
    return own
