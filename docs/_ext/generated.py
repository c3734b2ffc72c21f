"""Write the pages that come from data: problems, planners, published claims, the command line.

The pages are written into the source folder before Sphinx reads it, and are not kept in git.
"""

from __future__ import annotations

import csv
import inspect
import json
import math
import os
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import matplotlib as mpl
import numpy as np
from sphinx.application import Sphinx

from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import literature
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners.registry import entries
from trajopt.planners.swarm_planner import SwarmPlanner

mpl.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
COMMANDS = (
    "compare plan judge verify certify explain best-known claims suite report export list new"
)


def write(path: Path, text: str) -> None:
    """Write a page unless it is there already, so that Sphinx reads only what changed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def number(value: float) -> str:
    """Return a number with six significant digits, or a dash where there is no limit."""
    return f"{value:.6g}" if math.isfinite(value) else "–"


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def slug(name: str) -> str:
    """Return the name of a page's file."""
    return re.sub(r"[^\w.-]", "_", name)


def bibtex(key: str, title: str) -> str:
    """Return how to cite a page of this site."""
    entry = (
        f"@misc{{mintime-{key},\n"
        f"  title = {{{title}}},\n"
        "  author = {{The mintime authors}},\n"
        "  howpublished = {mintime, reference toolkit for minimum-time trajectory planners},\n"
        "  note = {State the version and the commit that you used}\n}\n"
    )
    return f"## Cite\n\n```bibtex\n{entry}```\n"


# --- problems ---


def picture(trajectory: Trajectory, file: Path) -> None:
    """Draw the best known motion: joint positions over time, with the waypoints' times."""
    figure, axes = plt.subplots(figsize=(7, 2.6), layout="constrained")
    ends = trajectory.breaks[0], trajectory.breaks[-1]
    times = [ends[0] + (ends[1] - ends[0]) * share / 400 for share in range(401)]
    lines = axes.plot(times, trajectory(times))
    passed = trajectory(trajectory.waypoint_times)
    for joint, line in enumerate(lines):
        axes.plot(trajectory.waypoint_times, passed[:, joint], ".", color=line.get_color())
    axes.set_xlabel("time [s]")
    axes.set_ylabel("position [rad or m]")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def limits_table(problem: Problem) -> str:
    """Return a row per joint with its limits in SI units."""
    limits = problem.limits.by_name()
    given = {kind: pairs for kind, pairs in limits.items() if np.isfinite(pairs).any()}
    rows = []
    for joint, name in enumerate(problem.joint_labels):
        pairs = [pairs[joint] for pairs in given.values()]
        rows.append([name, *(f"{number(low)} … {number(high)}" for low, high in pairs)])
    return table(["joint", *given], rows)


def problem_page(file: Path) -> list[str]:
    """Write one problem's page; return its row of the index."""
    known = records.read(file)
    problem = known.problem
    name = problem.name
    within = f"{100 * known.proved_within:.3g}"
    status = "closed" if known.closed else "open"
    image = DOCS / "problems" / f"{slug(name)}.png"
    if not image.is_file():
        image.parent.mkdir(exist_ok=True)
        picture(known.trajectory, image)
    size = [f"{problem.joints}", f"{len(problem.waypoints)}"]
    rows = [
        ["best known duration", f"{known.duration:.9g} s"],
        ["by", str(known.motion)],
        ["lower bound", f"{known.lower_bound:.9g} s, proved by {known.bound.method}"],
        ["proved within", f"{within} % ({status})"],
        ["joints, waypoints", ", ".join(size)],
        ["source", problem.source or "this toolkit"],
        ["digest", f"`{problem.digest()[:16]}`"],
    ]
    text = f"""# {name}

{table(["", ""], rows)}

![Best known motion of {name}: joint positions over time]({slug(name)}.png)

## Limits

In rad or m, and seconds.

{limits_table(problem)}

## Run it

```bash
trajopt compare {name}
trajopt best-known verify {name}
```

## Beat it

A shorter motion from any planner, in any format that `trajopt judge` reads, is a submission:

```bash
trajopt best-known propose motion.csv {name} --submitter "Your name"
```

[Best known answers](../best-known.md) says what happens then.

{bibtex(slug(name), f"Best known minimum-time motion of the problem {name}")}"""
    write(DOCS / "problems" / f"{slug(name)}.md", text)
    link = f"[{name}]({slug(name)}.md)"
    return [link, *size, number(known.duration), number(known.lower_bound), within, status]


def problem_pages() -> None:
    """Write a page per best known answer, and the table of all."""
    files = records.files()
    rows = [problem_page(file) for file in files]
    head = ["problem", "joints", "waypoints", "best s", "bound s", "within %", "status"]
    closed = sum(row[-1] == "closed" for row in rows)
    names = "\n".join(slug(file.name.rsplit(".", 2)[0]) for file in files)
    text = f"""# Problems

{len(rows)} problems, {closed} of them closed:
the best known motion is proved to be within 0.1 % of the minimum time. Click a heading to sort.

<div class="sortable"></div>

{table(head, rows)}

```{{toctree}}
:hidden:

{names}
```
"""
    write(DOCS / "problems" / "index.md", text)


# --- published claims ---


def claim_pages() -> None:
    """Write a page per published problem: its source, its reading, and each time's verdict."""
    verdicts = defaultdict(list)
    with open(DOCS / "literature" / "verdicts.csv", encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            verdicts[row["problem"]].append(row)
    index = []
    for name, rows in verdicts.items():
        published = literature.published(name)
        best = rows[0]
        claims = []
        for row in rows:
            above = float(row["above best %"])
            claims.append(
                [row["method"], row["published s"], row["verdict"], f"{above:+.2f}", row["table"]]
            )
        facts = [
            ["source", published.source],
            ["DOI", published.doi or "–"],
            ["objective of the source", published.objective],
            ["read as", published.reading or "printed"],
            ["best known", f"{float(best['best known s']):.6g} s ({best['best by']})"],
            ["lower bound", f"{float(best['lower bound s']):.6g} s ({best['bound by']})"],
            ["stopping at every waypoint", f"{float(best['stopping s']):.6g} s"],
            ["digits", published.transcription],
        ]
        text = f"""# Published times: {name}

{table(["", ""], facts)}

{table(["method", "published s", "verdict", "above best %", "table"], claims)}

A published time above the best known one is not an error of the source.
Most sources minimise something else as well.
[The literature on trial](../literature.md) says how to read the verdicts.

```bash
trajopt claims {name}
```

{bibtex(slug(name), f"Published running times of {name}, held against the optimum")}"""
        write(DOCS / "claims" / f"{slug(name)}.md", text)
        index.append(
            [f"[{name}]({slug(name)}.md)", f"{len(rows)}", f"{float(best['best known s']):.6g}"]
        )
    names = "\n".join(slug(name) for name in verdicts)
    text = f"""# Published claims

{table(["published problem", "times", "best known s"], index)}

```{{toctree}}
:hidden:

{names}
```
"""
    write(DOCS / "claims" / "index.md", text)


def printed(*arguments: str) -> str:
    """Return what a command prints on 80 columns."""
    environment = {**os.environ, "COLUMNS": "80", "NO_COLOR": "1"}
    asked = [sys.executable, "-m", "trajopt.cli", *arguments]
    done = subprocess.run(asked, capture_output=True, text=True, check=True, env=environment)
    return done.stdout


# --- planners ---


def stored_rows(name: str) -> dict[str, dict[str, str]]:
    """Return the rows of a table in `experiments/stored`, by what their first cell names."""
    file = ROOT / "experiments" / "stored" / f"{name}.csv"
    lines = [line for line in file.read_text(encoding="utf-8").splitlines() if line[:2] != "# "]
    return {row["planner"].strip("`"): row for row in csv.DictReader(lines)}


def meaning(name: str) -> str:
    """Return what the docstrings of a planner and of its optimiser say."""
    planner = entries()[name].load()
    parts: list[object] = [planner]
    if isinstance(planner, SwarmPlanner):
        parts = [SwarmPlanner, planner.optimiser]
    return "\n\n".join(inspect.getdoc(part) or "" for part in parts)


def planner_pages() -> None:
    """Write a page per registered planner: what it is, its settings, its gaps, how to run it."""
    six_axis = stored_rows("six-axis")
    gaps = stored_rows("gaps")
    index = []
    for described in json.loads(printed("list", "--json"))["planners"]:
        name = described["name"]
        options = [[f"`{key}`", f"`{value!r}`"] for key, value in described["options"].items()]
        knows = ", ".join(described["knows"]) or "none; the judge slows its motion down"
        text = f"""# Planner {name}

{described["description"]}

Limits that it keeps: {knows}.

## Settings

{table(["option", "default"], options) if options else "It has none."}

{meaning(name)}

## Run it

```bash
trajopt compare six-axis --planner {name}
trajopt compare --suite edges --planner {name}
```

"""
        if not described["available"]:
            text += f"It is an extra: {described['missing']}. How far it ends from the optimum: "
            text += "[rivals](../questions/index.md#how-far-are-other-peoples-planners-rivals).\n\n"
        if name in gaps:
            cells = list(gaps[name].items())
            own = [key for key, _ in cells if key != "six-axis" or name not in six_axis]
            suites = [[key, value] for key, value in cells[1:-1] if value and key in own]
            text += f"""## Its gap on every suite

Median gap to the best known motions and the largest, in %; searches have 3 seeds. Where answers
are missing it says how many there are. Of code {gaps[name]["commit"]}.

{table(["suite", "gap, %"], suites)}

"""
        if name in six_axis:
            cells = [[key, value] for key, value in six_axis[name].items() if value]
            text += f"## On the six-axis problem\n\n{table(['', ''], cells)}\n\n"
        text += bibtex(slug(name), f"Planner {name} in mintime")
        write(DOCS / "planners" / f"{slug(name)}.md", text)
        index.append([f"[{name}]({slug(name)}.md)", described["description"], knows])
    names = "\n".join(re.findall(r"\(([^)]*)\.md\)", " ".join(row[0] for row in index)))
    text = f"""# Planners

{table(["planner", "what it is", "limits that it keeps"], index)}

```{{toctree}}
:hidden:

{names}
```
"""
    write(DOCS / "planners" / "index.md", text)


# --- the command line ---


def command_page() -> None:
    """Write what every command's `--help` prints."""
    parts = ["# Command line\n"]
    for command in ["", *COMMANDS.split()]:
        said = printed(*filter(None, [command]), "--help")
        parts.append(f"## trajopt {command}\n\n```text\n{said.rstrip()}\n```\n")
    write(DOCS / "reference" / "command-line.md", "\n".join(parts))


def experiments_page() -> None:
    """Copy the experiments' page, with its links as seen from here."""
    text = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    text = text.replace("](../docs/", "](../").replace("](stored/", "](../../experiments/stored/")
    write(DOCS / "questions" / "index.md", text)


def _questions(found: re.Match[str]) -> str:
    """Return a link to the experiments' page, as seen from the page's folder."""
    return f"]({found[1].removeprefix('../')}questions/index.md"


def as_on_the_site(app: Sphinx, name: str, source: list[str]) -> None:
    """Adapt links of pages that are read in the repository too; a site has no folders."""
    text = re.sub(r"\[[^\]]+\]\((examples/[\w-]+)\)", r"`docs/\1`", source[0])
    text = re.sub(r"\]\(((?:\.\./)+)experiments/README\.md", _questions, text)
    source[0] = re.sub(r"\]\(\.\./(README|CONTRIBUTING)\.md\)", "](index.md)", text)


def all_pages(app: Sphinx) -> None:
    """Write every page before Sphinx looks for sources."""
    experiments_page()
    problem_pages()
    claim_pages()
    planner_pages()
    command_page()


def setup(app: Sphinx) -> dict[str, bool]:
    """Run before the builder reads the sources."""
    app.connect("builder-inited", all_pages)
    app.connect("source-read", as_on_the_site)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
