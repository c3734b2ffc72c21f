"""Can a planner or file from someone else make a command state something false, or hang?

    python tests/soak.py trusted              # 28 attacks, about two minutes
    python tests/soak.py trusted --quick      # three of them

Each attack is a planner file, a package, or a file of results, and a command that reads it in a
process of its own, as a user would type it. *Held* says whether the command ended as it must: in
time, with a true output and the right exit code, and with one line on standard error for bad input.
The table goes to `trusted.csv` and `.md` in `--output`. Exit code 1 if one did not hold. The
commands are those of the package that Python finds first: with another checkout on PYTHONPATH they
are that one's.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

import trajopt
from experiments.common.output import save_table
from trajopt.cli import console

OPTIMUM = 2.0  # s: 1 rad at 1 rad/s and 1 rad/s², all of it accelerating or braking
LIMIT_S = 60.0  # for a command
_HONEST = 3.0  # s, of the planners' motion

_PROBLEM = """\
name = "one joint, 1 rad"
waypoints = [[0.0], [1.0]]
units.waypoints = "rad"
units.limits = "rad"
[limits]
velocity = [1.0]
acceleration = [1.0]
"""
_PLANNER = """\
import os, signal, sys, time
from dataclasses import dataclass, replace
{at_import}
from trajopt import Planner
from trajopt.planners.registry import load

@dataclass(frozen=True)
class P(Planner):
    \"\"\"The optimum, half as fast again.\"\"\"

    def unsupported(self, problem):
        {unsupported}
        return None

    def solve(self, problem, *, seed=0):
        {before}
        found = load("exact").solve(problem)
        found = replace(found, trajectory=found.trajectory.dilated(1.5))
        {after}
        return found
"""
_PATCH = """\
from trajopt.benchmark.trial import Trial
Trial.certified_duration = property(lambda trial: 0.001)
"""
# A package in front of this one, whose verifier finds everything twice as fast as it is.
_OTHER_PACKAGE = """\
import shutil
from pathlib import Path
import trajopt
ours = Path(trajopt.__file__).parent
fake = Path(__file__).parent / "fake"
if not fake.exists():
    shutil.copytree(ours, fake / "trajopt", symlinks=True)
    verifier = fake / "trajopt" / "judging" / "verification.py"
    text = verifier.read_text()
    verifier.write_text(text.replace("=trajectory.duration,", "=0.5 * trajectory.duration,"))
sys.path.insert(0, str(fake))
"""
_PRLIMIT = """\
import resource
        for process in (os.getppid(),):
            resource.prlimit(process, resource.RLIMIT_NOFILE, (4, 4))"""


@dataclass(frozen=True)
class Ended:
    """Outcome of a command: its exit code (None if it took too long), output, and seconds."""

    code: int | None
    out: str
    err: str
    seconds: float

    @property
    def lines(self) -> list[str]:
        return self.err.strip().splitlines()


@dataclass(frozen=True)
class Attack:
    """A command in a prepared folder, and the check of its outcome.

    Attributes:
        name: In the table.
        prepare: Fills the folder.
        command: What the user types.
        held: Says so.
    """

    name: str
    prepare: Callable[[Path], None]
    command: Sequence[str]
    held: Callable[[Ended], bool]


def run(command: Sequence[str], folder: Path, limit: float = LIMIT_S) -> Ended:
    """Run a command of this package in a folder, as the console script does."""
    program = "import sys; from trajopt.cli import main; main(sys.argv[1:])"
    path = os.pathsep.join([str(Path(trajopt.__file__).parents[1]), str(folder / "site")])
    environment = os.environ | {"PYTHONPATH": path, "XDG_CACHE_HOME": str(folder / "cache")}
    began = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", program, *command],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    code: int | None
    try:
        out, err = process.communicate(timeout=limit)
        code = process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        out, err = process.communicate()
        code = None
    return Ended(code, out, err, time.monotonic() - began)


# --- what is prepared ---


def planner(
    at_import: str = "", before: str = "pass", after: str = "pass", unsupported: str = "pass"
) -> Callable[[Path], None]:
    """Write the problem, and a planner with hostile code."""

    def prepare(folder: Path) -> None:
        text = _PLANNER.format(
            at_import=at_import, before=before, after=after, unsupported=unsupported
        )
        (folder / "p.toml").write_text(_PROBLEM)
        (folder / "p.py").write_text(text)

    return prepare


def beside(name: str, text: str) -> Callable[[Path], None]:
    """Write a planner, and a file beside it."""

    def prepare(folder: Path) -> None:
        planner()(folder)
        (folder / name).write_text(text)

    return prepare


def results(change: Callable[[dict[str, object]], None] | None) -> Callable[[Path], None]:
    """Store a comparison, then forge `exact`'s trial, if there is a change, and seal all again."""

    def prepare(folder: Path) -> None:
        planner()(folder)
        done = run(COMPARE, folder)
        assert done.code == 0, done.err
        if change is not None:
            forge(folder / "results", change)

    return prepare


def forge(folder: Path, change: Callable[[dict[str, object]], None]) -> None:
    """Change what `exact`'s trial states, seal it, and make `results.h5` of it."""
    from trajopt.benchmark.store import results_file, trial_text
    from trajopt.benchmark.store.folder import rebuilt

    texts = []
    for file in sorted((folder / "trials").glob("*.json")):
        text = file.read_bytes()
        table = json.loads(text)
        if table["planner"] == "exact":
            change(table)
            del table["schema"], table["sha256"]
            text = trial_text.sealed(table)
            file.write_bytes(text)
        texts.append(text)
    content = rebuilt(texts)
    (folder / "results.h5").write_bytes(content + results_file.seal(content))


def faster(table: dict[str, object]) -> None:
    """State half of the duration."""
    certificate = table["certificate"]
    assert isinstance(certificate, dict)
    certificate["duration"] = 0.5 * OPTIMUM
    certificate["dilation"] = 1.0


def slower(table: dict[str, object]) -> None:
    """State 7 s for the motion of `exact`, so that it looks slow."""
    certificate = table["certificate"]
    assert isinstance(certificate, dict)
    certificate["duration"] = 3.5 * OPTIMUM


def package(folder: Path) -> None:
    """Install a distribution that registers `exact` too."""
    planner()(folder)
    place = folder / "site"
    info = place / "aaa_rival-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: aaa-rival\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[trajopt.planners]\nexact = p:P\n")
    shutil.copy(folder / "p.py", place / "p.py")


def link(target: str, name: str) -> Callable[[Path], None]:
    """Make a link beside the problem."""

    def prepare(folder: Path) -> None:
        planner()(folder)
        (folder / name).symlink_to(target)

    return prepare


def fifo(name: str) -> Callable[[Path], None]:
    """Make a pipe that nobody writes to."""

    def prepare(folder: Path) -> None:
        planner()(folder)
        os.mkfifo(folder / name)

    return prepare


def junk(folder: Path) -> None:
    """Fill a results folder with empty files."""
    results(None)(folder)
    for number in range(20_000):
        (folder / "results" / "trials" / f"{number:020x}.json").write_bytes(b"junk")


# --- what must be ---


def bad_input(ended: Ended) -> bool:
    """Return whether the command ended in time with one line and exit code 2."""
    return ended.code == 2 and len(ended.lines) == 1 and "Traceback" not in ended.err


def true_table(ended: Ended) -> bool:
    """Return whether `exact` takes the optimum and the planner 1.5 times that; exit code 0."""
    return ended.code == 0 and of(ended, "exact") == OPTIMUM and of(ended, "P") == _HONEST


def exact_is_true(ended: Ended) -> bool:
    """Return whether `exact` takes the optimum; exit code 0."""
    return ended.code == 0 and of(ended, "exact") == OPTIMUM


def of(ended: Ended, name: str) -> float | None:
    """Return the first duration in a planner's row of the printed table."""
    for line in ended.out.splitlines():
        found = re.match(rf"\W*{re.escape(name)}\W+.*?(\d+\.\d\d+)", line)
        if found:
            return round(float(found[1]), 4)
    return None


def computing(ended: Ended) -> tuple[float, float]:
    """Return the times to solve and to set up that `plan` printed, s."""
    found = re.search(r"computing +([\d.]+) s, after ([\d.]+) s", ended.out)
    return (float(found[1]), float(found[2])) if found else (0.0, LIMIT_S)


def exported(ended: Ended) -> bool:
    """Return whether a line says how many trials did not hold; exit code 0."""
    return ended.code == 0 and "1 of 2 trials" in ended.err


COMPARE = ("compare", "p.toml", "--planner", "./p.py:P", "--timeout", "3", "--jobs", "2")
PLAN = ("plan", "p.toml", "--planner", "./p.py:P")

ATTACKS = (
    Attack("none", planner(), COMPARE, true_table),
    Attack("import: another trajopt on sys.path", planner(_OTHER_PACKAGE), COMPARE, true_table),
    Attack("import: a patch of what is printed", planner(_PATCH), COMPARE, true_table),
    Attack(
        "import: a patch, in plan",
        planner(_PATCH),
        PLAN,
        lambda own: own.code == 0 and "0.001" not in own.out and "3.000000" in own.out,
    ),
    Attack(
        "import: a patch, in explain",
        planner(_PATCH),
        ("explain", "p.toml", "--planner", "./p.py:P"),
        lambda own: own.code == 0 and "3.0000 s" in own.out,
    ),
    Attack("import: an exception", planner("1 / 0"), COMPARE, bad_input),
    Attack("import: sys.exit()", planner("sys.exit()"), COMPARE, bad_input),
    Attack("import: sys.exit(), in plan", planner("sys.exit()"), PLAN, bad_input),
    Attack("import: os._exit(0)", planner("os._exit(0)"), COMPARE, bad_input),
    Attack("import: a hang", planner("time.sleep(600)"), COMPARE, bad_input),
    Attack("import: the process is killed", planner("os.kill(os.getpid(), 9)"), COMPARE, bad_input),
    Attack("numbers.py beside the planner", beside("numbers.py", "1 / 0\n"), COMPARE, true_table),
    Attack(
        "unsupported: a patch",
        planner(unsupported=_PATCH.strip().replace("\n", "; ")),
        COMPARE,
        true_table,
    ),
    Attack(
        "solve: os._exit(0)",
        planner(before="os._exit(0)"),
        COMPARE,
        lambda own: exact_is_true(own) and "crashed" in own.out,
    ),
    Attack(
        "solve: os._exit(0), in plan",
        planner(before="os._exit(0)"),
        PLAN,
        lambda own: own.code == 1 and "crashed" in own.out,
    ),
    Attack(
        "solve: setup_time=1e6",
        planner(before="time.sleep(0.3)", after="found = replace(found, setup_time=1e6)"),
        PLAN,
        lambda own: own.code == 0 and computing(own)[0] >= 0.3 and computing(own)[1] < LIMIT_S,
    ),
    Attack(
        "solve: prlimit from below",
        planner(before=_PRLIMIT),
        COMPARE,
        lambda own: bad_input(own) and "Too many open files" in own.err,
    ),
    Attack(
        "solve: SIGALRM to its judge",
        planner(before="os.kill(os.getppid(), signal.SIGALRM)"),
        COMPARE,
        lambda own: exact_is_true(own) and "crashed" in own.out,
    ),
    Attack(
        "another distribution registers exact",
        package,
        ("compare", "p.toml", "--planner", "ruckig-stop"),
        lambda own: bad_input(own) and "mintime" in own.err and "aaa-rival" in own.err,
    ),
    Attack("a trial planted for exact, kept", results(slower), COMPARE, true_table),
    Attack(
        "results.h5 forged, in report",
        results(faster),
        ("report", "results/results.h5"),
        exported,
    ),
    Attack(
        "results.h5 forged, in export",
        results(faster),
        ("export", "results/results.h5", "--to", "csv", "--out", "t.csv"),
        exported,
    ),
    Attack(
        "results.h5 is /dev/zero",
        link("/dev/zero", "results.h5"),
        ("report", "results.h5"),
        bad_input,
    ),
    Attack("waypoints are a FIFO", fifo("w.csv"), ("plan", "w.csv", "--robot", "ur5e"), bad_input),
    Attack("results.h5 is a FIFO", fifo("results.h5"), ("report", "results.h5"), bad_input),
    Attack("a problem is a FIFO", fifo("q.toml"), ("plan", "q.toml"), bad_input),
    Attack(
        "a CSV of [", beside("m.csv", "["), ("judge", "m.csv", "p.toml"), bad_input
    ),
    Attack(
        "20,000 files of junk",
        junk,
        ("report", "results"),
        lambda own: own.code == 0 and len(own.lines) <= 2,
    ),
)  # fmt: skip


def row(attack: Attack) -> dict[str, object]:
    """Run one attack; return its row."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        attack.prepare(folder)
        ended = run(attack.command, folder)
    said = ended.lines or ended.out.strip().splitlines()
    return {
        "attack": attack.name,
        "command": attack.command[0],
        "held": attack.held(ended),
        "exit": "none in time" if ended.code is None else ended.code,
        "s": round(ended.seconds, 1),
        "lines of errors": len(ended.lines),
        "said last": said[-1][:100] if said else "",
    }


def main(output: Path = Path("results/trusted"), quick: bool = False) -> None:
    """Run every attack, or one in ten if `quick`; write the table and print it."""
    rows = []
    attacks = ATTACKS[::10] if quick else ATTACKS
    with console.progress(len(attacks), "attacks") as advance:
        for attack in attacks:
            rows.append(row(attack))
            advance(1)
    made = pd.DataFrame(rows)
    save_table(made, output / "trusted")
    print(made.to_string(index=False))
    wrong = int((~made["held"]).sum())
    print(f"did not hold: {wrong} of {len(made)}")
    if wrong:
        sys.exit(1)
