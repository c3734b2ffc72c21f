"""Compute the verdicts of stored trials again: a file's own statements are not trusted.

Trials that are read get the verdict of this installation's judge on the stored motion. The lower
bounds behind gaps are those that the stored proofs prove. Nothing is remembered: what a file or a
cache says of a verdict may be anybody's.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from trajopt.benchmark.store import proofs
from trajopt.benchmark.trial import Trial, verdicts
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import KINDS
from trajopt.core.solution import Status
from trajopt.explain.references import PROVERS
from trajopt.judging.certificate import Certificate

DURATION_RTOL = 1e-9  # between a stated duration and the computed one
CERTIFICATE_RTOL = 1e-6  # between a certificate's uses of limits
CERTIFICATE_ATOL = 1e-8  # between its misses: rad, rad/s, rad/s^2


def judged(then: Trial, computed: Trial | None = None) -> Trial:
    """Return a stored trial with the computed verdict and its motion, and what differs from it.

    What is stated stays where nothing differs: another machine may find another joint at the same
    use of a limit.

    Args:
        then: As its text states it.
        computed: The same with its computed verdict (`again`), if that is known.
    """
    now = computed or again(then)
    differences = changed(then, now)
    if not _is_labelled(then):
        now = replace(now, label=then.planner)
    if then.planner in PROVERS and then.lower_bound is not None:
        word, unproved = proofs.rechecked(then)
        if word != proofs.PROVED_AGAIN:
            differences += unproved or [f"lower bound: {word}"]
            now = replace(now, solution=replace(now.solution, lower_bound=_proved(then)))
    if differences:
        return replace(now, differences=tuple(differences))
    named = replace(then, status=now.status, message=now.message)
    return with_motion(named, now.certificate)


def judged_many(trials: Sequence[Trial]) -> list[Trial]:
    """Return what `judged` does of each trial; their motions are verified together."""
    return [judged(then, now) for then, now in zip(trials, again_many(trials), strict=True)]


def with_motion(trial: Trial, computed: Certificate | None) -> Trial:
    """Return a trial whose stated certificate has the motion of the computed one."""
    if trial.certificate is None or computed is None:
        return trial
    own = replace(
        trial.certificate, motion=computed.motion, judged=computed.judged, repair=computed.repair
    )
    return replace(trial, certificate=own)


def again(trial: Trial) -> Trial:
    """Return a trial with the verdict computed from its problem and solution."""
    return again_many([trial])[0]


def again_many(trials: Sequence[Trial]) -> list[Trial]:
    """Return what `again` does of each trial; their motions are verified together."""
    found = verdicts([(trial.problem, trial.solution) for trial in trials])
    return [
        replace(trial, status=status, message=message, certificate=certificate)
        for trial, (status, message, certificate) in zip(trials, found, strict=True)
    ]


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
