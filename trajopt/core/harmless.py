"""Texts of strangers, made safe to print."""

from __future__ import annotations

import re

# Control characters, marks that turn the direction of writing, and lone surrogates; tab and newline
# are allowed in texts of several lines.
_STEERING = "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_UNSAFE = re.compile(f"[{_STEERING}]")
_UNSAFE_IN_LINE = re.compile(f"[\t\n{_STEERING}]")


def harmless(text: str, *, lines: bool = True) -> str:
    """Return the text with every character spelled out that could steer a terminal.

    Args:
        text: Any.
        lines: Whether tab and newline may stay.
    """
    if text.isprintable():  # the usual case, found quickly
        return text
    unsafe = _UNSAFE if lines else _UNSAFE_IN_LINE
    return unsafe.sub(_spelled, text)


def _spelled(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode()
