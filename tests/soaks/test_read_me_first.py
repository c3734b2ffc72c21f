"""The folder `tests/soaks`: attacks by the thousand, each on one promise, run on demand.

`python tests/soak.py` lists them. These tests run each of them in small.
"""

from __future__ import annotations

from soaks.tricks import Trick, judged, run_up


def test_a_soak_is_many_attacks_on_one_promise():
    """The promise: no motion is certified below the optimum, here with position limits."""
    problem, motion, optimum = run_up(excess=1e-8, also="position")
    trick = Trick("run-up", "run-up from 1e-8 rad beyond a limit", problem, motion, optimum)
    row = judged(trick)
    assert row["claimed %"] < 0
    assert row["certified %"] >= 0
