"""Send a planner's answers from its own process to the judge as plain data.

A message is a text in JSON, in which a solution is written as in a trial's text. A pickle would run
the sender's code when it is read; this text does not. `unpacked` checks it like a stranger's file.
It has no times, since the judge measures them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from trajopt.benchmark.store.document import packed_solution, solution_of
from trajopt.benchmark.trial import Answers, crash
from trajopt.core.files import MAX_VALUES, strict_json
from trajopt.core.solution import Solution
from trajopt.planners.planner import Relation

MAX_MESSAGE_BYTES = 2**26
TOO_LARGE = f"its answer is larger than {MAX_MESSAGE_BYTES >> 20} MiB"
TOO_MANY = f"its answer has more than {MAX_VALUES} values"
NONE = b"{}"  # in place of the answers to several problems: they are to be asked one by one
_MARKS = (b",", b"[", b"{")  # one of these precedes every value but the first


def packed(answers: Answers) -> bytes:
    """Return the answers as a message; an answer that is not plain data becomes a crash."""
    table = {
        "solutions": [_packed(solution) for solution in answers.solutions],
        "relation": answers.relation.name,
    }
    message = json.dumps(table).encode()
    if len(message) > MAX_MESSAGE_BYTES:
        return packed(answers.instead(crash(TOO_LARGE)))
    if _values(message) > MAX_VALUES:
        return packed(answers.instead(crash(TOO_MANY)))
    return message


def packed_many(every: Sequence[Answers]) -> bytes:
    """Return the answers to several problems as a message, or `NONE` where that is too large."""
    message = b"[" + b",".join(packed(own) for own in every) + b"]"
    too_large = len(message) > MAX_MESSAGE_BYTES or _values(message) > MAX_VALUES
    return NONE if too_large else message


def _values(message: bytes) -> int:
    """Return an upper bound on the number of values in a message, which need memory each."""
    return sum(message.count(mark) for mark in _MARKS)


def unpacked(message: bytes, count: int) -> Answers:
    """Return the answers of a message.

    Raises:
        Exception: The message was not made by `packed`, or has not `count` answers. Its author is
            not trusted, so any exception is possible.
    """
    return _answers(_read(message), count)


def unpacked_many(message: bytes, counts: Sequence[int]) -> list[Answers]:
    """Return the answers of a message of `packed_many`; raises as `unpacked` does."""
    return [_answers(own, count) for own, count in zip(_read(message), counts, strict=True)]


def _read(message: bytes) -> Any:
    if _values(message) > MAX_VALUES:
        raise ValueError(TOO_MANY)
    return strict_json(message.decode())


def _answers(table: Any, count: int) -> Answers:
    solutions = [solution_of(row) for row in table["solutions"]]
    if len(solutions) != count:
        raise ValueError(f"expected {count} answers, found {len(solutions)}")
    return Answers(solutions, Relation[table["relation"]])


def _packed(solution: Solution) -> Mapping[str, Any]:
    try:
        return packed_solution(solution)
    except Exception as error:
        return packed_solution(crash(f"{type(error).__name__}: {error}"))
