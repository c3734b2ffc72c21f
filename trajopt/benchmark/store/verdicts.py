"""Compute the verdicts of stored trials again: a file's own statements are not trusted.

Trials that are read get the verdict of this installation's judge on the stored motion. The lower
bounds behind gaps are those that the stored proofs prove. Computed verdicts are cached in the
user's cache folder, by the digests of the trial's text and of the judge.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark.provenance import provenance
from trajopt.benchmark.store import proofs, trial_text
from trajopt.benchmark.trial import Trial, verdict
from trajopt.core import files
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import KINDS
from trajopt.core.solution import Status
from trajopt.explain.references import PROVERS
from trajopt.judging.verification import Certificate

DURATION_RTOL = 1e-9  # between a stated duration and the computed one
CERTIFICATE_RTOL = 1e-6  # between a certificate's uses of limits
CERTIFICATE_ATOL = 1e-8  # between its misses: rad, rad/s, rad/s^2

_MAX_KEPT = 100_000  # verdicts in the cache, the newest ones
_MAX_AGE_S = 30 * 86400.0  # of another judge's cache


def judged(pairs: Iterable[tuple[Trial, bytes]]) -> Iterator[Trial]:
    """Yield trials, each given with its text, with their computed verdicts and differences."""
    known = _kept()
    new: dict[str, Any] = {}
    for trial, text in pairs:
        digest = trial_text.stated_digest(text)
        try:
            yield _remembered(trial, known[digest])
        except Exception:  # not there, or not what this module wrote
            found = _computed(trial)
            table = _table(found)
            new[digest] = None if table == _table(trial) else table
            yield found
    if new:
        _keep(known | new)


def trust(texts: Iterable[bytes]) -> None:
    """Keep the verdicts of texts that this installation's judge has just written."""
    _keep(_kept() | dict.fromkeys(map(trial_text.stated_digest, texts)))


def again(trial: Trial) -> Trial:
    """Return a trial with the verdict computed from its problem and solution."""
    status, message, certificate = verdict(trial.problem, trial.solution)
    return replace(trial, status=status, message=message, certificate=certificate)


def changed(then: Trial, now: Trial) -> list[str]:
    """Name the stated values that differ from the computed ones."""
    found = []
    if not _is_labelled(then):
        found.append(_difference("label", then.planner, then.label))
    # until 0.1.0 a motion that broke ignored limits was called `relaxed`: a word, no number
    graded = () if then.status is Status.RELAXED else ("status",)
    for name in (*graded, "feasible", "certified_duration", "dilation"):
        new = getattr(now, name)
        old = getattr(then, name)
        if not _close(new, old, rtol=DURATION_RTOL, atol=0.0):
            found.append(_difference(name, new, old))
    claim = getattr(then.certificate, "duration", then.claimed_duration)
    if not _close(then.claimed_duration, claim, rtol=DURATION_RTOL, atol=0.0):
        found.append(_difference("duration", then.claimed_duration, claim))
    values = [_worst_values(own.certificate) for own in (now, then)]
    for name in {**values[0], **values[1]}:
        new, old = (own.get(name) for own in values)
        is_use = name == "least_times" or (name in KINDS and KINDS[name].is_ratio)
        rtol, atol = (CERTIFICATE_RTOL, 0.0) if is_use else (0.0, CERTIFICATE_ATOL)
        if not _close(new, old, rtol=rtol, atol=atol):
            found.append(_difference(f"certificate's {name}", new, old))
    return found


def _computed(then: Trial) -> Trial:
    now = again(then)
    differences = changed(then, now)
    if not _is_labelled(then):
        now = replace(now, label=then.planner)
    if then.planner in PROVERS and then.lower_bound is not None:
        word, unproved = proofs.rechecked(then)
        if word != proofs.PROVED_AGAIN:
            differences += unproved or [f"lower bound: {word}"]
            now = replace(now, solution=replace(now.solution, lower_bound=_proved(then)))
    return replace(now, differences=tuple(differences))


def _is_labelled(trial: Trial) -> bool:
    """Return whether the label is the planner's name, with options or without."""
    return f"{trial.label}:".startswith(f"{trial.planner}:")


def _proved(trial: Trial) -> float | None:
    with suppress(TrajoptError):
        return proofs.proved(trial)
    return None


def _worst_values(certificate: Certificate | None) -> dict[str, float]:
    """The worst use of every limit, and the worst miss and jump, by name."""
    if certificate is None:
        return {}
    uses = {**certificate.uses, **certificate.ratios}
    values = {key: use.value for key, use in uses.items()}
    errors = {"waypoint": certificate.waypoint, "continuity": certificate.continuity}
    return values | {name: worst.value for name, worst in errors.items()}


def _close(now: Any, then: Any, *, rtol: float, atol: float) -> bool:
    if not isinstance(now, float | int) or not isinstance(then, float | int):
        return bool(now == then)
    return bool(np.isclose(now, then, rtol=rtol, atol=atol))


def _difference(name: str, now: Any, then: Any) -> str:
    return f"{name}: recorded {_said(then)}, computed {_said(now)}"


def _said(value: Any) -> str:
    if value is None:
        return "none"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


# --- what was computed before ---


def _table(trial: Trial) -> dict[str, Any]:
    """Return a verdict in JSON's terms."""
    return {
        "status": str(trial.status),
        "message": trial.message,
        "label": trial.label,
        "lower_bound": trial.lower_bound,
        "certificate": trial_text.certificate_table(trial.certificate),
        "differences": list(trial.differences),
    }


def _remembered(then: Trial, table: Mapping[str, Any] | None) -> Trial:
    """Return a trial with the verdict in the table; with the stated one if that was confirmed."""
    if table is None:
        return then
    own = {name: table[name] for name in ("message", "label")}
    certificate = trial_text.certificate_of(table["certificate"], then.problem)
    solution = replace(then.solution, lower_bound=table["lower_bound"])
    status = Status(table["status"])
    own["differences"] = tuple(table["differences"])
    return replace(then, status=status, certificate=certificate, solution=solution, **own)


def _file() -> Path:
    """Return the cache of this installation's judge."""
    own = [provenance()[name] for name in ("mintime", "judge_digest", "python", "numpy", "scipy")]
    digest = hashlib.sha256(" ".join(own).encode()).hexdigest()
    folder = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(folder) / "mintime" / f"verdicts-{digest[:20]}.json"


def _kept() -> dict[str, Any]:
    """Return the verdicts in the cache, by the digests of texts; None confirms the text's own."""
    with suppress(Exception):  # without a home, or a cache that can be read, all are computed
        table = json.loads(files.content(_file()))
        return dict(table)
    return {}


def _keep(known: Mapping[str, Any]) -> None:
    """Write the cache; remove those of judges that have not been used for long."""
    with suppress(Exception):  # a cache that cannot be written saves no time
        file = _file()
        newest = list(known.items())[-_MAX_KEPT:]
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary = file.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(json.dumps(dict(newest)))
        os.replace(temporary, file)
        for other in file.parent.glob("verdicts-*.json"):
            if time.time() - other.stat().st_mtime > _MAX_AGE_S:
                other.unlink()
