"""The folder `experiments`: each module asks one question, and its table is stored with its code.

`python -m experiments` lists the questions. A table that a page prints stands in
`experiments/stored`, with its command, its day and the commit of the code that was measured.
"""

from __future__ import annotations

import csv
from pathlib import Path

from experiments.__main__ import questions

STORED = Path(__file__).parents[2] / "experiments" / "stored"


def test_every_module_asks_one_question():
    asked = questions()
    assert asked["known_optima"].startswith("Are `exact-jerk` and `exact` right")
    assert asked["logs"] == "Is the verdict on a log ever false?"


def test_a_stored_table_says_its_command_and_its_code():
    lines = (STORED / "logs.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "# command: python -m experiments.logs"
    assert lines[1].startswith("# date: ")
    heading, *rows = csv.reader(lines[2:])
    assert heading[-1] == "commit"
    assert all(row[-1] for row in rows)
