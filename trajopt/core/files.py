"""Text files from anywhere, read as a whole within bounds, or refused in one line.

Every reader takes its text from this module. Only regular files are read: a pipe or a device may
have no end. A file of any format has at most `MAX_BYTES` bytes,
`MAX_VALUES` values or lines, words of `MAX_WORD` characters (a number of 60,000 digits takes
minutes to read), and tables nested `MAX_DEPTH` deep. A whole number in JSON has at most
`MAX_DIGITS` digits, any other number is finite, and a name has at most `MAX_NAME` characters.
"""

from __future__ import annotations

import codecs
import errno
import json as standard_json
import math
import re
import stat
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

from trajopt.core import keys
from trajopt.core.exceptions import InvalidInput, nearest, shortened

MAX_BYTES = 32_000_000  # 88 s of six joints every millisecond
MAX_TOML_BYTES = 2_000_000  # its parser takes a second for each million
MAX_VALUES = 2_000_000
MAX_WORD = 400  # characters; a float written in full has 327
MAX_DEPTH = 40
MAX_DIGITS = 19  # every integer of 64 bits has no more
MAX_NAME = 200  # characters of the name of a problem, a joint or a planner
TOO_DEEP = f"it is nested deeper than {MAX_DEPTH}"

_MARKS = ",;\t\n[{<"  # one of these precedes every value but the first
_LONG_WORD = re.compile(rf"(?<![\w.+-])[\w.+-]{{{MAX_WORD + 1}}}")
_PART = r"""\.[ \t]*(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_DEEP_KEY = re.compile(rf"(?:{_PART}){{{MAX_DEPTH}}}")  # quadratic in memory, for `tomllib`


def text(
    path: Path, what: str, kind: str, *, max_bytes: int = MAX_BYTES, marks: str = _MARKS
) -> str:
    """The text of a file in UTF-8, or in UTF-16 with a mark, within the bounds of this module.

    Args:
        path: The file.
        what: The expected content, for errors.
        kind: The kind of file, for errors: "JSON".
        max_bytes: The largest size.
        marks: Characters that are counted against `MAX_VALUES`.

    Raises:
        InvalidInput: The file cannot be read, is in another encoding, or exceeds a bound; names it.
    """
    try:
        found = _decoded(content(path, max_bytes))
        check_bounds(found, marks)
    except (OSError, ValueError) as error:
        raise unreadable(path, what, kind, error) from None
    return found


def _decoded(found: bytes) -> str:
    """Return the text of bytes in UTF-8 or UTF-16; raises `ValueError` for other encodings."""
    try:
        return found.decode("utf-16" if is_utf_16(found) else "utf-8-sig")
    except UnicodeDecodeError as error:
        reason = f"byte {error.start + 1} is not text in UTF-8; save it as UTF-8, in Excel as"
        raise ValueError(f"{reason} 'CSV UTF-8'") from None


def is_utf_16(found: bytes) -> bool:
    """Return whether bytes begin with the mark of UTF-16."""
    return found.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))


def opened(path: Path) -> BinaryIO:
    """Open a regular file, or a link to one, to read its bytes; raises `OSError`."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError(errno.EINVAL, "it is a pipe, a socket or a device, not a file", str(path))
    return path.open("rb")


def content(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """Read a file's bytes; raises `OSError`, and `ValueError` if it is too large."""
    with opened(path) as file:
        found = file.read(max_bytes + 1)
    if len(found) > max_bytes:
        raise ValueError(f"it has more than {max_bytes / 1e6:g} MB")
    return found


def check_bounds(found: str, marks: str = _MARKS) -> None:
    """Raise `ValueError` for a text of too many values, or with too long a word."""
    if sum(map(found.count, marks)) > MAX_VALUES:
        raise ValueError(f"it has more than {MAX_VALUES} values")
    word = _LONG_WORD.search(found)
    if word:
        line = found.count("\n", 0, word.start()) + 1
        raise ValueError(f"line {line} has a word of more than {MAX_WORD} characters")


def unreadable(path: Path, what: str, kind: str, error: Exception) -> InvalidInput:
    """The error to raise where reading a file fails."""
    if isinstance(error, FileNotFoundError):
        return absent(path)
    reason = getattr(error, "strerror", None) or str(error)
    if isinstance(error, RecursionError):
        reason = TOO_DEEP
    key = f"{what} cannot be read ({reason})"
    return InvalidInput(key, f"a readable {kind} file", file=str(path))


def absent(path: Path, otherwise: str = "") -> InvalidInput:
    """The error to raise where a file is not there.

    Args:
        path: The file.
        otherwise: What may be given in its place, in words.
    """
    try:
        close = nearest(path.name, [own.name for own in path.parent.iterdir()])
    except OSError:
        close = ""
    right = "a file that is there" + (f", perhaps {path.with_name(close)}" if close else "")
    return InvalidInput("it does not exist", right + otherwise, file=str(path))


def json(path: Path, what: str) -> Any:
    """Read a JSON file; raises `InvalidInput` naming the file, also if a key is there twice."""
    found = text(path, what, "JSON")
    try:
        return parsed_json(found)
    except ValueError as error:
        raise unreadable(path, what, "JSON", error) from None


def parsed_json(said: str) -> Any:
    """Parse a JSON text.

    Raises:
        ValueError: It is not JSON, has a key twice, NaN or infinity, or exceeds a bound.
    """
    check_bounds(said)
    return strict_json(said)


def strict_json(said: str) -> Any:
    """Parse a JSON text of any size; raises as `parsed_json` does."""
    try:
        found = _DECODER.decode(said)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    for level in _levels(found):
        if math.inf in level or -math.inf in level:
            _SLOW_DECODER.decode(said)  # says which number is too large
    return found


def toml(path: Path, what: str, number: Callable[[str], Any] = float) -> dict[str, Any]:
    """Read a TOML file; `number` converts numbers with a decimal point or an exponent.

    Raises:
        InvalidInput: It cannot be read, or is not TOML; names the file.
    """
    said = text(path, what, "TOML", max_bytes=MAX_TOML_BYTES)
    try:
        if _DEEP_KEY.search(said):
            raise ValueError(TOO_DEEP)
        table = tomllib.loads(said, parse_float=number)
        for _ in _levels(table):
            pass
    except (ValueError, RecursionError) as error:
        raise unreadable(path, what, "TOML", error) from None
    return table


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {shortened(twice, 60)} is there twice")
    return table


def _no_number(constant: str) -> Any:
    raise ValueError(f"{constant} is no number of JSON")


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > MAX_DIGITS:
        raise ValueError(f"{shortened(digits, 60)} has more than {MAX_DIGITS} digits")
    return int(digits)


def _finite(digits: str) -> float:
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"{shortened(digits, 60)} is too large for a number")
    return number


_decoder = partial(
    standard_json.JSONDecoder,
    object_pairs_hook=_once,
    parse_constant=_no_number,
    parse_int=_whole,
)
_DECODER = _decoder()  # without a function of Python's for each number
_SLOW_DECODER = _decoder(parse_float=_finite)


def _levels(value: Any) -> Iterator[list[Any]]:
    """Yield the values of nested tables and lists, from the outermost on, a level at a time.

    Raises:
        ValueError: They are nested too deep.
    """
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        yield level
        if not {list, dict} & set(map(type, level)):
            return
        tables = [item for item in level if type(item) in (list, dict)]
        lists = (item.values() if type(item) is dict else item for item in tables)
        level = list(chain.from_iterable(lists))
    raise ValueError(TOO_DEEP)


def items(table: Any) -> Iterable[Any]:
    if isinstance(table, dict):
        return table.values()
    return table if isinstance(table, list) else ()


def check_keys(
    prefix: str, table: Mapping[str, Any], known: Iterable[str], required: Iterable[str] = ()
) -> None:
    """Refuse unknown keys, and missing ones, of a table that only this package writes.

    Args:
        prefix: Text before a key in errors.
        table: A table of the file.
        known: The keys that the file may have.
        required: The keys that the file must have.

    Raises:
        InvalidInput: Names the key and the nearest known one.
    """
    own = dict.fromkeys(known, keys.Key(keys.anything, ""))
    keys.unread(prefix, table, own, required, strictness="exact")


def text_at(table: Mapping[str, Any], key: str, default: str = "") -> str:
    """The text under a key; raises `InvalidInput` for another type."""
    value = table.get(key, default)
    if not isinstance(value, str):
        raise InvalidInput(key, "a string", value=value)
    return value


def names_at(table: Mapping[str, Any], key: str, default: Sequence[str] = ()) -> Sequence[str]:
    """The list of names under a key; raises `InvalidInput` for anything else."""
    value: Sequence[str] = table.get(key, default)
    is_list = isinstance(value, list | tuple)
    if not is_list or not all(isinstance(name, str) for name in value):
        raise InvalidInput(key, "a list of names, one per joint", value=value)
    return value
