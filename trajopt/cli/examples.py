"""Two examples of every command, shown by its `--help`: lines of docs/commands.md, run by tests."""

from __future__ import annotations

# Command lines, by the command's name.
EXAMPLES = {
    "list": ("trajopt list", "trajopt list robots"),
    "suite": ("trajopt suite list", "trajopt suite export robots my-suite"),
    "new": ("trajopt new", "trajopt new mine.toml waypoints.csv --robot ur5e --unit deg"),
    "plan": (
        "trajopt plan six-axis --planner toppra",
        "trajopt plan waypoints.csv --robot ur5e --unit deg --out motion.yaml",
    ),
    "compare": (
        "trajopt compare six-axis --planner issa --planner toppra --seeds 3",
        "trajopt compare --suite random-collinear --planner ruckig-stop --output out",
    ),
    "explain": (
        "trajopt explain six-axis --planner toppra",
        "trajopt explain six-axis --planner ./my_planner.py:MyPlanner",
    ),
    "judge": (
        "trajopt judge theirs.csv my-robot.toml",
        "trajopt judge theirs.csv my-robot.toml --via-tolerance 0.001",
    ),
    "chunk": (
        "trajopt chunk targets.csv --robot ur5e",
        "trajopt chunk targets.csv --robot ur5e --at-given-times --tolerance 0.01",
    ),
    "retime": (
        "trajopt retime theirs.csv --limits my-robot.toml",
        "trajopt retime waypoints.csv --robot ur5e --unit deg --out retimed.yaml",
    ),
    "race": (
        "trajopt race six-axis",
        "trajopt race robots-franka-panda-w4-jerk ruckig-stop --out panda.html",
    ),
    "prove": (
        "trajopt prove six-axis",
        "trajopt prove six-axis --family spline353",
    ),
    "front": (
        "trajopt front six-axis --durations 2,3 --json",
        "trajopt front six-axis --durations 1.8,2,3 --planner spline353-nlp",
    ),
    "claims": ("trajopt claims", "trajopt claims yu2022-aubo-ga"),
    "best-known": ("trajopt best-known list", "trajopt best-known verify six-axis"),
    "verify": ("trajopt verify out", "trajopt verify theirs.csv --limits my-robot.toml"),
    "export": (
        "trajopt export out --to csv --out trials.csv",
        "trajopt export out --to latex --output tables",
    ),
    "report": ("trajopt report out", "trajopt report results my-results --out both.html"),
    "diff": ("trajopt diff results my-results", "trajopt diff results results/results.h5"),
}


def in_words(command: str) -> str:
    """Return the examples of a command as the end of its help."""
    lines = "\n".join(f"  {line}" for line in EXAMPLES[command])
    return f"Examples:\n{lines}"
