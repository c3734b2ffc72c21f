"""How do published running times compare with the optimum? The page docs/literature.md.

    python -m experiments.literature                  # 30 problems, a few minutes
    python -m experiments.literature --output docs    # the repository's own page
    python -m experiments.literature fang2020-task1   # some problems

Every published problem is surveyed, and its times judged (mathematics.md, section 8). Written to
`--output`: `literature.md`, and in `literature/` the figure `all.png` and two tables, all verdicts
(`verdicts.csv` and `.md`) and what is known of each problem, by which code (`known.csv` and `.md`).
`tests/test_stored_numbers.py` compares the page with both.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
from matplotlib.figure import Figure

from experiments.common.output import progress, save_table
from experiments.published import figures
from experiments.published.judged import JudgedProblem, judged, known, table
from experiments.published.page import page
from trajopt.benchmark.suites import literature
from trajopt.views.figures import plots

FOLDER = "literature"
_PNG_DPI = 110


def main(
    *problem: str,
    time_limit: float = 20.0,
    output: Path = Path("results/literature"),
    quick: bool = False,
) -> None:
    """Judge every published time and write the page.

    Args:
        problem: published problems; all that can be stated if none is named.
        time_limit: for each proof of a lower bound, s.
        output: folder of the page.
        quick: the first problem alone.
    """
    names = problem or tuple(literature.files())
    if quick:
        names = names[:1]
    problems = []
    with progress(len(names), "problems") as advance:
        for name in names:
            problems.append(judged(name, time_limit))
            advance(1)
    write(problems, output)
    print(table(problems).to_string(index=False, float_format="{:.4f}".format))


def write(problems: list[JudgedProblem], output: Path) -> None:
    """The page, its figure and the table of verdicts."""
    folder = output / FOLDER
    save_table(table(problems), folder / "verdicts")
    save_table(known(problems), folder / "known")
    _save(figures.of_all(problems), folder / "all.png")
    beyond = [literature.published(name) for name in literature.files_beyond()]
    text = page(problems, beyond, FOLDER)
    (output / "literature.md").write_text(text, encoding="utf-8")


@plots.styled
def _save(figure: Figure, file: Path) -> None:
    """Save a figure without a word of the program that made it."""
    figure.savefig(file, dpi=_PNG_DPI, metadata={"Software": None})


if __name__ == "__main__":
    cyclopts.run(main)
