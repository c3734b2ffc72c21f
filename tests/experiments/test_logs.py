"""The logs of `experiments.logs` have the truth that they say, and no lawful one is convicted."""

from __future__ import annotations

import numpy as np
import pytest

from experiments import logs


def peaks(phases, order):
    """The largest derivatives of each order, from ends of phases: every one is monotone within."""
    derivatives = {order: [abs(value) for _, value in phases]}
    values = [value for _, value in phases]
    for lower in range(order - 1, 0, -1):
        state, found, slopes = 0.0, [0.0], []
        for (length, _), value in zip(phases, values, strict=True):
            state += length * value
            slopes.append(state)
            found.append(abs(state))
        derivatives[lower] = found
        # the mean of a linear derivative over a phase: its lower derivative's slope
        values = [(a + b) / 2 for a, b in zip([0.0, *slopes[:-1]], slopes, strict=True)]
    return [max(derivatives[kind]) for kind in range(1, order + 1)]


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_lawful_moves_keep_the_limits_and_others_exceed_one(order, seed):
    rng = np.random.default_rng(seed)
    limits = [logs.V, logs.A, logs.J][:order]
    lawful = logs.move(rng, order, logs.V, logs.A, logs.J)
    assert (np.array(peaks(lawful, order)) <= np.array(limits) * (1 + 1e-9)).all()
    for kind, limit in zip(["velocity", "acceleration", "jerk"][:order], limits, strict=True):
        moved = logs.exceeding(rng, order, kind, 0.2, 0.01)
        assert max(np.array(peaks(moved, order)) / limits) == pytest.approx(1.2)
        assert peaks(moved, order)[0] > 0
        if kind == "velocity":
            assert peaks(moved, order)[0] == pytest.approx(1.2 * limit)


@pytest.mark.parametrize("order", [2, 3])
def test_positions_are_the_integrals_of_the_phases(order):
    truth = logs.Truth(logs.move(np.random.default_rng(1), order, 2.0, 10.0, 100.0), order)
    t = np.linspace(0, truth.duration, 20001)
    starts = np.cumsum([0.0, *(length for length, _ in truth.phases)])
    index = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(truth.phases) - 1)
    values = np.array([value for _, value in truth.phases])[index]
    for _ in range(order):
        derivative = values
        values = np.append(0.0, np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(t)))
    assert truth(t, 1) == pytest.approx(derivative, abs=1e-2)
    assert truth(t) == pytest.approx(values, abs=1e-3)


def test_no_lawful_log_is_convicted():
    rows = logs.counted(12, seed=7, joints=1)
    assert 2 < rows["lawful"].sum() < 10
    assert rows["velocities"].any()
    assert rows["broken"].any()
    assert logs.false_verdicts(rows) == (0, 0)
    found = logs.table(rows).set_index("logs of")
    assert found.loc["lawful", "broken"] == 0
    assert found.loc[["lawful", "broken"], "number"].sum() == 12
