"""The folder `experiments`: each module asks one question, and its table is stored with its code.

`python -m experiments` lists the questions. A table that a page prints stands in
`experiments/stored`, with its command, its day and the commit of the code that was measured.
"""

from __future__ import annotations

import csv
from pathlib import Path

from experiments.__main__ import questions
from experiments.soaks.tricks import Trick, judged, run_up

STORED = Path(__file__).parents[2] / "experiments" / "stored"


def test_every_module_asks_one_question():
    asked = questions()
    assert asked["experiments.known_optima"].startswith("Are `exact-jerk` and `exact` right")
    assert asked["experiments.soaks.tricks"].startswith("Can the judge be cheated?")


def test_a_stored_table_says_its_command_and_its_code():
    lines = (STORED / "tricks.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "# command: python -m experiments.soaks.tricks"
    assert lines[1].startswith("# date: ")
    heading, *rows = csv.reader(lines[2:])
    assert heading[-1] == "commit"
    assert all(row[-1] for row in rows)


def test_a_soak_is_many_attacks_on_one_promise():
    """The promise: no motion is certified below the optimum, here with position limits."""
    problem, motion, optimum = run_up(excess=1e-8, also="position")
    trick = Trick("run-up", "run-up from 1e-8 rad beyond a limit", problem, motion, optimum)
    row = judged(trick)
    assert row["claimed %"] < 0
    assert row["certified %"] >= 0
