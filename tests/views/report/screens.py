"""Does the report fit the screens that people have, light and dark, with a crash trace listed?

    python tests/views/report/screens.py                    # two minutes; needs Chromium
    python tests/views/report/screens.py --output screens   # with sixteen pictures

All planners that come with it, and one with a fault, on two problems; the report of that is opened
at four widths in both colour schemes. Into `--output` go `screens.csv` and `.md` (how far the page
and its widest chart stand out, px: nothing should) and two pictures of each: the charts, and the
failures with the trace of the fault opened.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import browser as chromium
import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import save_table
from trajopt import comparison as run
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import console
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.planners.planner import Planner
from trajopt.planners.registry import entries
from trajopt.views import report

PROBLEMS = ("six-axis", "position-limits")
SCHEMES = ("light", "dark")
HEIGHTS = {390: 844, 1280: 800, 1440: 900, 1920: 1080}  # px, of each width
VIEWS = {
    "curves": "document.getElementById('curves').scrollIntoView()",
    "crash": """for (const trace of document.querySelectorAll('.why details')) trace.open = true;
        document.getElementById('failures').scrollIntoView()""",
}
DRAWN = """await new Promise((go) => setTimeout(go, 400))"""
STANDS_OUT = """const root = document.documentElement;
    const charts = [...document.querySelectorAll('.chart')].filter((c) => c.layout);
    const over = charts.map((c) => c.querySelector('.main-svg').getBoundingClientRect().right
        - c.getBoundingClientRect().right);
    return [root.scrollWidth - root.clientWidth, Math.max(...over)]"""


@dataclass(frozen=True)
class Faulty(Planner):
    """A planner with a fault, as one that is being written has."""

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Never: it multiplies what does not fit."""
        weights = np.ones(problem.joints + 1)
        path = problem.waypoints @ weights
        raise AssertionError(path)


def made(seeds: int, folder: Path) -> Path:
    """The report of the comparison."""
    planners: list[run.Contestant] = [("faulty", Faulty())]
    for name, entry in entries().items():
        if not entry.load().on_request:
            planners.append(name)
    problems = [suite.load(name) for name in PROBLEMS]
    results = run.compare(problems, planners, folder, seeds=seeds, progress=console.progress_line())
    return report.write(
        results, folder / "report.html", command="python tests/views/report/screens.py"
    )


def looked_at(browser: Any, page: Path, width: int, scheme: str, output: Path) -> dict[str, object]:
    """Take the pictures of one screen; how far something stands out there, px."""
    output.mkdir(parents=True, exist_ok=True)
    chromium.resize(browser, width, HEIGHTS[width])
    chromium.prefer(browser, scheme)
    browser.get("about:blank")  # another screen is another visit
    browser.get(page.as_uri())
    chromium.run(browser, chromium.READY)
    for view, script in VIEWS.items():
        chromium.run(browser, f"{script}; {DRAWN}")
        picture = browser.get_screenshot_as_png()
        file = output / f"{view}-{width}-{scheme}.png"
        file.write_bytes(picture)
    page_over, chart_over = chromium.run(browser, STANDS_OUT)
    return {
        "width, px": width,
        "scheme": scheme,
        "page stands out, px": page_over,
        "widest chart stands out, px": chart_over,
    }


def main(*, seeds: int = 30, output: Path = Path("results/screens")) -> None:
    """Run what is missing, open the report on every screen, write the table and the pictures."""
    if wanted := chromium.missing():
        raise SystemExit(wanted)
    page = made(seeds, Path("results/screens"))
    screens = [(width, scheme) for width in HEIGHTS for scheme in SCHEMES]
    with tempfile.TemporaryDirectory() as profile, chromium.opened(Path(profile)) as browser:
        rows = [looked_at(browser, page.resolve(), *screen, output) for screen in screens]
    table = pd.DataFrame(rows)
    save_table(table, output / "screens")
    print(table.to_string(index=False))


if __name__ == "__main__":
    cyclopts.run(main)
