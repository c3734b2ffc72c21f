"""Describe a planner in plain data: what a run must know of it, without its code.

The process that a planner runs in describes it (`described`). The run reads the description
(`Profile.read`) as it reads a stranger's file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from trajopt.benchmark.provenance import Code
from trajopt.benchmark.store.fields import is_line
from trajopt.benchmark.trial import Configuration, Entrant
from trajopt.core import exceptions
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import TrajoptError
from trajopt.core.files import strict_json
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.planners import registry
from trajopt.planners.planner import Planner, Relation

_FLAGS = ("stochastic", "may_be_stochastic", "batched", "takes_many", "on_request")


@dataclass(frozen=True)
class Profile:
    """A planner in plain data.

    Attributes:
        entrant: Its name, label, options and code.
        source: What makes it: its spec, or the object itself.
        stochastic, may_be_stochastic, batched, takes_many, on_request: As of a `Planner`.
        description: One line.
        knows: Kinds of limits that it plans for.
        demands: Demands on the way that it plans for.
        requires: Modules that it imports.
        missing: Why it cannot run here, with the command that mends it, or None.
        refusals: Why it cannot solve a problem, or None, by the problem's digest.
        relations: How its answers relate to the optimum, by the problem's digest.
    """

    entrant: Entrant
    source: str | Planner
    stochastic: bool
    may_be_stochastic: bool
    batched: bool
    takes_many: bool
    on_request: bool
    description: str
    knows: Sequence[str]
    demands: Sequence[str]
    requires: Sequence[str]
    missing: str | None
    refusals: Mapping[str, str | None]
    relations: Mapping[str, Relation | None]

    @classmethod
    def of(
        cls, configuration: Configuration, source: str | Planner, problems: Sequence[Problem]
    ) -> Profile:
        """Describe a planner of this process."""
        return cls._of(_table(configuration, problems), configuration.entrant, source)

    @classmethod
    def read(cls, message: bytes, spec: registry.Spec) -> Profile:
        """Return the description in a message of a planner's process.

        Raises:
            TrajoptError: The error that the message states, or it is no description.
        """
        try:
            table = strict_json(message.decode())
            if "error" in table:
                stated = _rebuilt(table["error"])
            else:
                entrant = Entrant(
                    spec.name,
                    _line(table["label"]),
                    dict(table["options"]),
                    Code(*map(_line, table["code"])),
                )
                if entrant.label.partition(":")[0] != spec.name:
                    raise ValueError(f"label {entrant.label}")
                return cls._of(table, entrant, spec.text)
        except Exception as wrong:
            raise TrajoptError(f"planner {spec.name!r} describes itself as none: {wrong}") from None
        raise stated

    @classmethod
    def _of(cls, table: Mapping[str, Any], entrant: Entrant, source: str | Planner) -> Profile:
        missing = table["missing"]
        return cls(
            entrant,
            source,
            stochastic=table["stochastic"] is True,
            may_be_stochastic=table["may_be_stochastic"] is True,
            batched=table["batched"] is True,
            takes_many=table["takes_many"] is True,
            on_request=table["on_request"] is True,
            description=_line(table["description"]),
            knows=[key for key in KINDS if key in table["knows"]],
            demands=[key for key in DEMANDS if key in table["knows"]],
            requires=[*map(str, table["requires"])],
            missing=missing if missing is None else str(missing),
            refusals={digest: own and str(own) for digest, own in table["refusals"].items()},
            relations={
                digest: Relation[own] if own else None for digest, own in table["relations"].items()
            },
        )

    @property
    def planner(self) -> Planner:
        """The planner, in this process."""
        return registry.load(self.source) if isinstance(self.source, str) else self.source

    def varies(self, problem: Problem) -> bool:
        """Tell if another seed may give another answer; a refusal is the same for all seeds."""
        return self.stochastic and self.refusals.get(problem.digest()) is None


def described(spec: str, problems: Sequence[Problem]) -> bytes:
    """Load a planner and describe it, or the error that it meets, as a message."""
    try:
        table = _table(Configuration.given(spec), problems)
    except BaseException as error:
        table = {"error": _said(error, spec)}
    return json.dumps(table).encode()


def _table(configuration: Configuration, problems: Sequence[Problem]) -> dict[str, Any]:
    planner = configuration.planner
    entrant = configuration.entrant
    code = entrant.code
    missing = registry.missing(planner)
    return {
        "label": entrant.label,
        "options": entrant.options,
        "code": [code.distribution, code.version, code.digest],
        **{flag: bool(getattr(planner, flag)) for flag in _FLAGS},
        "description": planner.description,
        "knows": [*planner.knows, *(key for key, own in KINDS.items() if planner.plans_for(own))],
        "requires": [*planner.requires],
        "missing": missing,
        "refusals": {problem.digest(): _refusal(planner, problem) for problem in problems},
        "relations": {problem.digest(): _relation(planner, problem) for problem in problems},
    }


def _refusal(planner: Planner, problem: Problem) -> str | None:
    try:
        reason = planner.unsupported(problem)
    except Exception:  # its trials record the error
        return None
    return reason if reason is None else str(reason)


def _relation(planner: Planner, problem: Problem) -> str | None:
    try:
        return planner.relation(problem).name
    except Exception:  # its trials record the error
        return None


def _line(text: Any) -> str:
    if not is_line(text):
        raise ValueError(f"{text!r:.80} is no line of text")
    return text


def _said(error: BaseException, spec: str) -> dict[str, Any]:
    """Return an error of this package by its class and data, another one in a line."""
    kind = type(error)
    if isinstance(error, TrajoptError) and vars(exceptions).get(kind.__name__) is kind:
        data = {name: _plain(value) for name, value in vars(error).items()}
        return {"class": kind.__name__, "text": str(error), "data": data}
    text = f"planner {spec!r} cannot be loaded: {type(error).__name__}: {error}"
    return {"class": "TrajoptError", "text": text, "data": {}}


def _plain(value: Any) -> Any:
    is_plain = value is None or isinstance(value, str | int | float | bool | list)
    return value if is_plain else exceptions.shown(value)


def _rebuilt(table: Mapping[str, Any]) -> TrajoptError:
    kind = vars(exceptions).get(str(table["class"]), TrajoptError)
    if isinstance(kind, type) and issubclass(kind, TrajoptError):
        return exceptions.rebuilt(kind, (str(table["text"]),), dict(table["data"]))
    return TrajoptError(str(table["text"]))
