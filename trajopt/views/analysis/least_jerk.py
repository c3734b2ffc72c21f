"""How far each planner's ∫ jerk² is above the least of its own duration, on one problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trajopt.benchmark.front import free_least
from trajopt.benchmark.trial import Trial
from trajopt.views.analysis import statistics


def times_the_least(trials: Sequence[Trial]) -> dict[str, float]:
    """Return the median of each planner's ratios, by label, for trials of one problem.

    A planner is left out if it has no certified motion, if its acceleration jumps, or if limits act
    on the smoothest motion of one of its durations.
    """
    ends: dict[str, list[tuple[float, float]]] = {}
    for trial in trials:
        duration, value = trial.certified_duration, trial.jerk_integral
        if duration is not None and value is not None:
            ends.setdefault(trial.label, []).append((duration, value))
    smooth = {label: own for label, own in ends.items() if np.isfinite(own).all()}
    least = free_least(trials[0].problem) if smooth else None
    if least is None:
        return {}
    ratios = {label: [least.times(*end) for end in own] for label, own in smooth.items()}
    return {
        label: float(statistics.median([r for r in own if r is not None]))
        for label, own in ratios.items()
        if None not in own
    }
