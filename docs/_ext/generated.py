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
import textwrap
from collections import defaultdict
from pathlib import Path

import matplotlib as mpl
import numpy as np
from sphinx.application import Sphinx

from trajopt.benchmark.best_known import records
from trajopt.benchmark.front import smoothest
from trajopt.benchmark.suites import catalogue, literature
from trajopt.benchmark.trial import Trial, trials_of
from trajopt.cli.app import app
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners.registry import entries, load
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views import race
from trajopt.views.figures import style
from trajopt.views.figures.draw import LOOKED_FOR, shown_motions

mpl.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent


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


BAR = {
    "proved bound": style.GREY,
    "best known": style.BLUE,
    "stopping at every waypoint": style.ORANGE,  # as Ruckig with stops
}


def with_colours(*_: object) -> None:
    """Give the curves of an example, which are not planners', colours of 3:1 on white."""
    plt.rcParams["axes.prop_cycle"] = plt.cycler(color=style.CURVES)


def bars(axes: plt.Axes, durations: dict[str, float], colours: dict[str, str]) -> None:
    """Draw durations, s, as labelled bars, the first on top."""
    names = list(durations)
    drawn = axes.barh(names, list(durations.values()), color=[colours[name] for name in names])
    axes.bar_label(drawn, [f" {value:.4g} s" for value in durations.values()])
    axes.margins(x=0.15)
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)


def picture(problem: Problem, trajectory: Trajectory, durations: dict[str, float]) -> plt.Figure:
    """Draw the durations that are known, and the best known motion with its waypoints."""
    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(7, 4.4), layout="constrained", height_ratios=[1, 2]
    )
    bars(upper, durations, BAR)
    upper.set_xlabel("duration (s)")
    times = np.linspace(0, trajectory.duration, 401)
    lines = lower.plot(times, trajectory(times))
    passed = trajectory(trajectory.waypoint_times)
    for joint, line in enumerate(lines):
        look = {"mec": line.get_color(), "mfc": "white", "ms": 4}
        lower.plot(trajectory.waypoint_times, passed[:, joint], "o", **look)
    if problem.joints <= 8:
        lower.legend(lines, problem.joint_labels, loc="center left", bbox_to_anchor=(1, 0.5))
    lower.set_xlabel("time (s)")
    lower.set_ylabel(f"position ({problem.shared_unit()})")
    lower.spines[["top", "right"]].set_visible(False)
    return figure


def save(figure: plt.Figure, file: Path) -> None:
    """Write a figure."""
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=100)
    plt.close(figure)


SEEDS = 30  # runs of a search, of which the median races
BESIDE = ("ruckig-stop",)  # planners that race the best known motion


def race_part(problem: Problem) -> str:
    """Write the race of an arm's problem; return how its page includes it, or nothing."""
    if catalogue.chain(problem) is None:
        return ""
    file = DOCS / "problems" / f"{slug(problem.name)}-race.html"
    if not file.is_file():
        first = problem.name == catalogue.PAPER_PROBLEM
        planners = LOOKED_FOR if first else BESIDE
        trials: list[Trial] = []
        for name in planners:
            planner = load(name)
            seeds = range(SEEDS if planner.stochastic else 1)
            trials += trials_of(planner, problem, seeds, name)
        motions = shown_motions(trials, every=True)
        if first:  # it is the front page's
            smooth = smoothest(problem, motions[0].trajectory)
            motions[0] = motions[0]._replace(trajectory=smooth)
        write(file, race.fragment(problem, motions))
    return f"""```{{raw}} html
:file: {file.name}
```"""


def limits_table(problem: Problem) -> str:
    """Return a row per joint with its limits, each with its unit."""
    kinds = problem.limits.kinds.values()
    rows = []
    for joint, name in enumerate(problem.joint_labels):
        rows.append([name, *(own.of_joint(joint, problem) for own in kinds)])
    return table(["joint", *(own.name() for own in kinds)], rows)


def waypoints_table(problem: Problem) -> str:
    """Return a row per waypoint, a column per joint with its unit."""
    units = [problem.unit(joint) for joint in range(problem.joints)]
    labels = zip(problem.joint_labels, units, strict=True)
    head = ["waypoint", *(f"{label} ({unit})" for label, unit in labels)]
    rows = [[f"{i + 1}", *map(number, row)] for i, row in enumerate(problem.waypoints)]
    return table(head, rows)


def waypoints_csv(problem: Problem) -> str:
    """Return the waypoints as a CSV with units in its header."""
    units = [problem.unit(joint) for joint in range(problem.joints)]
    labels = zip(problem.joint_labels, units, strict=True)
    lines = [",".join(f"{label} [{unit}]" for label, unit in labels)]
    lines += [",".join(repr(float(value)) for value in row) for row in problem.waypoints]
    return "\n".join(lines) + "\n"


def problem_page(file: Path) -> list[str]:
    """Write one problem's page; return its row of the index."""
    known = records.read(file)
    problem = known.problem
    name = problem.name
    within = f"{100 * known.proved_within:.3g}"
    status = "closed" if known.closed else "open"
    image = DOCS / "problems" / f"{slug(name)}-known.png"
    stopping = float(stop_times(problem).sum())
    durations = {
        "proved bound": known.lower_bound,
        "best known": known.duration,
        "stopping at every waypoint": stopping,
    }
    if not image.is_file():
        save(picture(problem, known.trajectory, durations), image)
    write(DOCS / "problems" / f"{slug(name)}.toml", problem.to_toml())
    write(DOCS / "problems" / f"{slug(name)}.csv", waypoints_csv(problem))
    size = [f"{problem.joints}", f"{len(problem.waypoints)}"]
    rows = [
        ["by", str(known.motion)],
        ["proved by", known.bound.method],
        ["source", problem.source or "this toolkit"],
        ["digest", f"`{problem.digest()[:16]}`"],
    ]
    more = (
        f", {100 * (stopping / known.duration - 1):.3g} % more" if math.isfinite(stopping) else ""
    )
    stops = f" Stopping at every waypoint takes {stopping:.6g} s{more}." * math.isfinite(stopping)
    text = f"""# {name}

The best known motion through these {len(problem.waypoints)} waypoints of {problem.joints} joints
takes **{known.duration:.9g} s**. No motion takes less than {known.lower_bound:.9g} s:
proved within {within} % ({status}).{stops}

{race_part(problem)}

![Durations known of {name}, and its best known motion: joint positions over time]({image.name})

## Waypoints

{waypoints_table(problem)}

## Limits

{limits_table(problem)}

{{download}}`Problem file (TOML) <{slug(name)}.toml>`,
{{download}}`waypoints (CSV) <{slug(name)}.csv>`

## Who found it

{table(["", ""], rows)}

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
    """Write a page per best known answer that lies directly in its folder, and their table."""
    every = records.files()
    files = [file for file in every if file.parent == records.folder()]
    rows = [problem_page(file) for file in files]
    head = ["problem", "joints", "waypoints", "best s", "bound s", "within %", "status"]
    closed = sum(row[-1] == "closed" for row in rows)
    names = "\n".join(slug(file.name.rsplit(".", 2)[0]) for file in files)
    text = f"""# Problems

{len(rows)} problems, {closed} of them closed:
the best known motion is proved to be within 0.1 % of the minimum time. [The open ones](open.md)
have a page. Click a heading to sort.
The {len(every) - len(files)} problems of the suites `moving`, `sections`, `demands`, `mixes` and
`arms` have records without pages: `trajopt best-known list`.

<div class="sortable"></div>

{table(head, rows)}

```{{toctree}}
:hidden:

open
{names}
```
"""
    write(DOCS / "problems" / "index.md", text)


# --- open problems ---

_TINY = 1e-3  # of the longest segment


def hindrances(problem: Problem) -> list[str]:
    """Say what is known to keep a bound low, from the problem's numbers alone."""
    steps = np.abs(problem.displacements)
    found = []
    if "tolerance" in problem.demands:
        room = np.asarray(problem.demands["tolerance"])
        room = np.broadcast_to(room, problem.waypoints.shape)
        overlapping = (steps <= room[:-1] + room[1:]).all(axis=1)
        if overlapping.any():
            found.append(f"boxes overlap: {overlapping.sum()} of {len(steps)}")
    largest = steps.max(axis=0)
    sizes = (steps[:, largest > 0] / largest[largest > 0]).max(axis=1)
    tiny = sizes < _TINY * sizes.max()
    if tiny.any():
        found.append(f"tiny steps: {tiny.sum()} of {len(steps)}")
    if "tool_speed" in problem.limits.others:
        found.append("the tool's way is no straight line")
    if "closed" in problem.demands:
        found.append("free ends")
    if problem.limits.segments is not None and problem.has("jerk"):
        found.append("jerk by segment")
    return found


def open_page() -> None:
    """Write the page of the problems whose optimum is not proved, with what would close each."""
    rows = []
    for file in records.files():
        record = records.read(file)
        if record.closed:
            continue
        problem = record.problem
        ends = (
            "moving ends" if "_velocity" in name or "_acc" in name else name
            for name in problem.demands
        )
        asked = [name for name in problem.limits.kinds if name not in ("velocity", "acceleration")]
        asked += [name.replace("_", " ") for name in dict.fromkeys(ends)]
        rows.append(
            [
                f"`{problem.name}`",
                ", ".join([f"{problem.joints} × {len(problem.waypoints)}", *asked]),
                f"{100 * record.proved_within:.3f}",
                f"{record.lower_bound * (1 + records.CLOSED_WITHIN):.6g}",
                f"{record.duration / (1 + records.CLOSED_WITHIN):.6g}",
                ", ".join(
                    re.split("[ :]", str(origin))[0] for origin in (record.motion, record.bound)
                ),
                "; ".join(hindrances(problem)) or "none is known",
            ]
        )
    rows.sort(key=lambda row: -float(row[2]))
    head = ["problem", "joints × waypoints, more asked", "gap, %", "a motion below, s"]
    head += ["or a bound above, s", "motion, bound by", "in the way"]
    first = rows[0][0].strip("`")
    suite, _, _ = first.partition("-")
    text = f"""# Open problems

{len(rows)} of {len(records.files())} problems are open: the shortest motion that anyone has found
is {100 * records.CLOSED_WITHIN:g} % or more above what is proved. Nobody knows whether the motion
is too long or the bound too low. A motion or a bound beyond the numbers of its row closes a
problem. Click a heading to sort.

<div class="sortable"></div>

{table(head, rows)}

## Try one

<!-- not run: as long as one likes -->
```bash
trajopt suite export {suite} problems
trajopt plan problems/{first}.toml --out motion.json
trajopt prove problems/{first}.toml --time-limit 600
```

[One archive](../best-known.md#all-in-one-archive) has all of them too, with a script that checks a
bound and needs no package.

## What was tried

Motions: `exact` or `exact-jerk` and `ruckig-search` on all; on the mixes IPOPT from twelve guesses
too, which found nothing shorter. Bounds: `prove`, a branch and bound over
segment times ([how](../mathematics/bounds.md)), for 60 CPU s each, the walk for 240
([which closed five others](../questions/index.md#what-is-proved-trajopt-best-known)).

- *Boxes overlap*: the motion may pass two waypoints at one instant. The proof leaves such
  waypoints out, or splits a segment's time near 0, where most of its inequalities say nothing.
- *Tiny steps*: the gap comes from the square tangents of tiny segments. No single one accounts for
  it, and a tree would have to split all at once.
- *The tool's way is no straight line* under joint limits, and the bound counts the straight one.
- *Free ends* of a closed motion, *jerk by segment*: more variables to split; nothing closer is
  known.

## Submit

Any motion that `trajopt judge` reads, or stored trials of `prove`. What a record says is
[its format](../best-known.md#in-a-file); what is written is checked again by
[a script of its own](../best-known.md#check-it-without-this-package).

<!-- not run: whether it writes depends on what was found -->
```bash
trajopt best-known propose motion.json {first} --submitter "A. Nother"
```

It is judged as executed, and written if it is better.
[What happens then](../best-known.md#submit-a-better-one).
"""
    write(DOCS / "problems" / "open.md", text)


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
        doi = f"[{published.doi}](https://doi.org/{published.doi})" if published.doi else "–"
        facts = [
            ["source", published.source],
            ["DOI", doi],
            ["objective of the source", published.objective],
            ["read as", published.reading or "printed"],
            ["best known", f"{float(best['best known s']):.6g} s ({best['best by']})"],
            ["lower bound", f"{float(best['lower bound s']):.6g} s ({best['bound by']})"],
            ["stopping at every waypoint", f"{float(best['stopping s']):.6g} s"],
            ["digits", published.transcription],
        ]
        title = claim_title(published.source, name)
        image = DOCS / "claims" / f"{slug(name)}-times.png"
        if not image.is_file():
            save(claim_picture(rows), image)
        text = f"""# {title}

{claim_sentence(rows)}

![Published times beside the best known, the bound, and stopping]({image.name})

{table(["method", "published s", "verdict", "above best %", "table"], claims)}

A published time above the best known one is not an error of the source.
Most sources minimise something else as well.
[The literature on trial](../literature.md) says how to read the verdicts.

{table(["", ""], facts)}

```bash
trajopt claims {name}
```

{bibtex(slug(name), f"Published running times of {name}, held against the optimum")}"""
        write(DOCS / "claims" / f"{slug(name)}.md", text)
        best_known = f"{float(best['best known s']):.6g}"
        index.append([f"[{title}]({slug(name)}.md)", f"`{name}`", f"{len(rows)}", best_known])
    names = "\n".join(slug(name) for name in verdicts)
    text = f"""# Published claims

{table(["source", "problem", "times", "best known s"], index)}

```{{toctree}}
:hidden:

{names}
```
"""
    write(DOCS / "claims" / "index.md", text)


def claim_title(source: str, name: str) -> str:
    """Return who published it, when, and which problem of theirs it is."""
    found = re.match(r"(.*?\b(?:19|20)\d\d)\b", source)
    _, _, arm = name.partition("-")
    return f"{found[1] if found else source}: {arm or name}"


def claim_sentence(rows: list[dict[str, str]]) -> str:
    """Say how the shortest published time compares."""
    shortest = min(rows, key=lambda row: float(row["published s"]))
    best = float(shortest["best known s"])
    published = float(shortest["published s"])
    verdict = shortest["verdict"]
    said = {
        "above": f"{100 * (published / best - 1):.3g} % above the best known motion, {best:.6g} s",
        "equal": f"as long as the best known motion, {best:.6g} s",
        "impossible": "shorter than a proved lower bound: no motion under these limits does it",
        "unproved": f"shorter than the best known motion, {best:.6g} s, and not refuted",
    }.get(verdict, verdict)
    return f"The shortest published time, {published:g} s ({shortest['method']}), is **{said}**."


def claim_picture(rows: list[dict[str, str]]) -> plt.Figure:
    """Draw published times beside what is known."""
    best = rows[0]
    durations = {
        "proved bound": float(best["lower bound s"]),
        "best known": float(best["best known s"]),
        "stopping at every waypoint": float(best["stopping s"]),
    }
    published = {
        textwrap.shorten(row["method"], 45, placeholder=" …"): float(row["published s"])
        for row in rows
    }
    colours = BAR | dict.fromkeys(published, style.BLACK)
    figure, axes = plt.subplots(figsize=(7, 0.4 * (3 + len(published)) + 0.6), layout="constrained")
    bars(axes, durations | published, colours)
    axes.set_xlabel("duration (s)")
    return figure


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


# Whose method a planner runs; the others are this toolkit's.
WHOSE = {
    "toppra": "H. Pham and Q.-C. Pham (2018), in their library toppra",
    "ruckig-stop": "L. Berscheid and T. Kröger (2021), in their library Ruckig",
    "ruckig-search": "this toolkit, around L. Berscheid and T. Kröger's Ruckig (2021)",
    "issa": "Ma et al. (2024), *Machines* 12(7):490",
    "ssa": "J. Xue and B. Shen (2020), as Ma et al. (2024) use it",
    "pso": "J. Kennedy and R. Eberhart (1995), as Ma et al. (2024) use it",
    "cmaes": "N. Hansen, in the library cma",
    "de": "R. Storn and K. Price (1997), in SciPy",
    "copp": "the authors of COPP",
    "drake-kto": "the authors of Drake",
    "gcs": "the authors of Drake",
    "minsnap": "D. Mellinger and V. Kumar (2011), in minsnap_trajectories",
    "mealpy": "the authors of mealpy, and of each optimiser in it",
    "pymoo": "the authors of pymoo, and of each optimiser in it",
    "nevergrad": "the authors of nevergrad, and of each optimiser in it",
    "iterative-spline": "K. Anderson (2017), in Tesseract",
    "totg": "T. Kunz and M. Stilman (2012), in Tesseract",
    "totg-ruckig": "the authors of MoveIt, around TOTG and Ruckig, in Tesseract",
}


# Options of every search, which no docstring explains.
SHARED = {
    "population": "candidates of an iteration",
    "iterations": "iterations at most",
    "evaluations": "candidates tried at most; without a number the iterations count",
    "starts": "initial guesses at most; the best local optimum is the answer",
    "agreeing": "initial guesses that must lead to the same optimum before the others are left out",
    "tries": "settings that are tried, of which the shortest motion counts; 1 is the authors' own",
}


def meanings(name: str) -> str:
    """Return the docstrings of a planner, of its optimiser, and of what they derive from."""
    planner = entries()[name].load()
    parts = [planner, planner.optimiser] if isinstance(planner, SwarmPlanner) else [planner]
    general = {"Planner", "Optimiser"}
    classes = [own for part in parts for own in type(part).__mro__ if own.__name__ not in general]
    return "\n\n".join(inspect.getdoc(own) or "" for own in classes)


def meaning_of(option: str, said: str) -> str:
    """Return what a planner's docstrings say of an option; empty where they say nothing."""
    items = re.findall(r"^- (.*?)(?=^- |^\n|\Z)", said, re.M | re.S)
    sentences = re.findall(r"[A-Z`][^.]*`" + option + r"`[^.]*\.", said)
    mentioned = [item for item in items if f"`{option}`" in item] + sentences
    found = next(iter(mentioned), SHARED.get(option, ""))
    return " ".join(found.split()).rstrip(";.").replace("|", "\\|")


def planner_pages() -> None:
    """Write a page per registered planner: what it is, its settings, its gaps, how to run it."""
    six_axis = stored_rows("six-axis")
    gaps = stored_rows("gaps")
    index = []
    for described in json.loads(printed("list", "--json"))["planners"]:
        name = described["name"]
        said = meaning(name)
        inherited = meanings(name)
        options = [
            [f"`{key}`", f"`{value!r}`", meaning_of(key, inherited)]
            for key, value in described["options"].items()
        ]
        whose = WHOSE.get(name, "this toolkit")
        knows = ", ".join(described["knows"]) or "none; the judge slows its motion down"
        text = f"""# Planner {name}

{described["description"]}

By {whose}. Limits that it keeps: {knows}.

## Settings

{table(["option", "default", "meaning"], options) if options else "It has none."}

## How it works

{said}

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
    commands = [name for name in app if not name.startswith("-")]
    for command in ["", *commands]:
        said = printed(*filter(None, [command]), "--help")
        parts.append(f"## trajopt {command}\n\n```text\n{said.rstrip()}\n```\n")
    write(DOCS / "reference" / "command-line.md", "\n".join(parts))


def experiments_page() -> None:
    """Copy the pages of experiments and soaks, with their links as seen from here."""
    text = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    text = text.replace("](../docs/", "](../").replace("](stored/", "](../../experiments/stored/")
    text = text.replace("](../tests/soaks/README.md)", "](soaks.md)")
    write(DOCS / "questions" / "index.md", text)
    text = (ROOT / "tests" / "soaks" / "README.md").read_text(encoding="utf-8")
    text = text.replace("](../../docs/", "](../").replace(
        "](../../experiments/README.md", "](index.md"
    )
    write(DOCS / "questions" / "soaks.md", text)


def _questions(found: re.Match[str]) -> str:
    """Return a link to the page of experiments or of soaks, as seen from the page's folder."""
    page = {"experiments": "index", "tests/soaks": "soaks"}[found[2]]
    return f"]({found[1].removeprefix('../')}questions/{page}.md"


def as_on_the_site(app: Sphinx, name: str, source: list[str]) -> None:
    """Adapt links of pages that are read in the repository too; a site has no folders."""
    text = re.sub(r"\[[^\]]+\]\((examples/[\w-]+)\)", r"`docs/\1`", source[0])
    text = re.sub(r"\]\(((?:\.\./)+)(experiments|tests/soaks)/README\.md", _questions, text)
    source[0] = re.sub(r"\]\(\.\./(README|CONTRIBUTING)\.md\)", "](index.md)", text)


def all_pages(app: Sphinx) -> None:
    """Write every page before Sphinx looks for sources."""
    experiments_page()
    problem_pages()
    open_page()
    claim_pages()
    planner_pages()
    command_page()


def setup(app: Sphinx) -> dict[str, bool]:
    """Run before the builder reads the sources."""
    app.connect("builder-inited", all_pages)
    app.connect("source-read", as_on_the_site)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
