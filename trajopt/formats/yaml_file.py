"""YAML files as ROS writes them: no key twice, angles tagged `!degrees` in radians."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import yaml

from trajopt import numerals
from trajopt.exceptions import InvalidInput

_DEGREE = pi / 180  # rad


def read(path: Path, what: str) -> Any:
    """What a YAML file says: mappings, lists, texts, numbers, truth values.

    Args:
        path: The file; JSON is YAML too.
        what: It should be, in words, as an error says it.

    Raises:
        InvalidInput: It cannot be read, is not YAML, has a key twice, or several documents.
    """
    found = documents(path, what)
    if len(found) > 1:
        raise InvalidInput(what, "one YAML document", value=len(found), file=str(path))
    return found[0] if found else None


def documents(path: Path, what: str) -> list[Any]:
    """The documents of a YAML file that are not empty: `ros2 topic echo` ends each with `---`.

    Args:
        path: The file; JSON is YAML too.
        what: It should be, in words, as an error says it.

    Raises:
        InvalidInput: It cannot be read, is not YAML, or has a key twice.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        found = list(yaml.load_all(text, Loader=_Loader))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise InvalidInput(what, "a readable YAML file", value=reason, file=str(path)) from None
    return [document for document in found if document is not None]


def number(value: Any) -> float | None:
    """A finite number, also one that YAML takes for a text (1e-3 has no dot); None for others."""
    if isinstance(value, bool):
        return None
    try:
        return numerals.decimal(str(value))
    except ValueError:
        return None


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # it has no types
    """PyYAML's safe loader, with ROS's tags, that refuses a key given twice."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen = set()
    for key, _ in node.value:
        if key.value in seen and key.value != "<<":
            problem = f"the key {key.value} is there twice"
            raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
        seen.add(str(key.value))
    loader.flatten_mapping(node)
    table: dict[Any, Any] = loader.construct_mapping(node, deep=True)
    return table


def _degrees(loader: _Loader, node: yaml.ScalarNode) -> Any:
    angle = number(node.value)
    return node.value if angle is None else angle * _DEGREE


def _radians(loader: _Loader, node: yaml.ScalarNode) -> Any:
    return node.value


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
_Loader.add_constructor("!degrees", _degrees)
_Loader.add_constructor("!radians", _radians)
