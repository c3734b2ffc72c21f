"""The LaTeX table, read back by a reader of `tabular` written for it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from test_tables import mixed, run

from trajopt.views.export import latex
from trajopt.views.results import Results

PRINTED = {
    "\\textbackslash{}": "\\",
    "\\textasciitilde{}": "~",
    "\\textasciicircum{}": "^",
    "\\textless{}": "<",
    "\\textgreater{}": ">",
    "\\textbar{}": "|",
    "\\textasciigrave{}": "`",
    "{}": "",
}
COMMAND = re.compile(r"\\[a-z]+\{\}|\\.|\{\}")


def as_printed(source: str) -> str:
    """Return the text that LaTeX prints: replace its commands and escaped characters."""
    return COMMAND.sub(lambda found: PRINTED.get(found[0], found[0][1:]), source)


@pytest.mark.parametrize(
    "name",
    ["pso:weight=0.7,note=a_b", r"50 % \& $x^2$ #1 {~}", "--fast---er", "a|b<c>d`e", "größer ①"],
)
def test_a_name_is_printed_character_by_character(name):
    source = latex.escaped(name)
    assert as_printed(source) == name
    assert not re.search(r"(?<!\\)[&%$#_~^<>|`]|--", source)


def test_what_cannot_be_printed_is_a_space():
    assert latex.escaped("a\nb\x1b") == "a b "


def test_the_table_has_a_line_per_row_of_the_summary(tmp_path):
    results = Results(mixed())
    latex.write(results, tmp_path)
    text = (tmp_path / "summary.tex").read_text(encoding="utf-8")
    lines = text.splitlines()
    assert lines[0] == r"\begin{tabular}{lrrrrrr}"
    assert lines[-1] == r"\end{tabular}"
    rules = [line for line in lines if line.endswith("rule")]
    summary = results.summary()
    problems = summary["digest"].nunique()
    assert rules == [r"\toprule", *[r"\midrule"] * problems, r"\bottomrule"]
    table = [re.split(r"(?<!\\) & ", line.removesuffix(r" \\")) for line in lines if " & " in line]
    assert {len(cells) for cells in table} == {7}
    heading, *rows = table
    assert as_printed(heading[5]) == "gap (%)"
    assert len(rows) == len(summary)
    for cells, row in zip(rows, summary.itertuples(), strict=True):
        label, solved, kept, *_ = cells
        assert as_printed(label) == re.sub(r"[\x00-\x1f]", " ", row.label)
        assert solved == f"{row.solved} of {row.runs}"
        expected = "--" if np.isnan(row.median) else f"{100 * row.kept:.0f} \\%"
        assert kept == expected


def test_durations_gaps_and_what_is_missing():
    # three segments of 2 s each, and none where no answer came
    (lost,) = run("lost", segment_time=-1.0)
    found = latex.summary(Results([*run(seeds=(0, 1)), lost]))
    assert r" & 2 of 2 & 100 \% & 6.0000 & 6.0000--6.0000 & -- & " in found
    assert r" & 0 of 1 & -- & failed & -- & -- & " in found
