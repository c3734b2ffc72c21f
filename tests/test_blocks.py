"""Every console and code block of README and docs runs, and prints what its page shows.

A page is a session: its blocks run in order in one folder, which holds the files that pages name.
A comment before a block says what is special: `<!-- exit 1 -->` is how its last command ends (the
others end with 0), `<!-- needs MODULE -->` is for where that is installed, and
`<!-- not run: reason -->` says who runs it.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import matplotlib as mpl
import pytest
from work import without_progress

from trajopt import compare
from trajopt.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BY_CI = ("compare", "tests")  # the README's, by .ci/run
FOLDERS = ("", "how-to", "symptoms", "explanation", "mathematics", "examples/planner-package")
PAGES = [ROOT / "README.md", *(page for part in FOLDERS for page in (DOCS / part).glob("*.md"))]
RUN_MANY = {"commands", "planner", "near-joint-ends", "robots", "replanning-in-motion", "report"}
BLOCK = re.compile(r"^(?:<!-- ((?:(?!-->).)*) -->\n)?```(\w+)(?: (\S+))?\n(.*?)^```$", re.M | re.S)
COMMAND = re.compile(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", re.M)
NUMBER = re.compile(r"[+-]?\d[\d.]*(?:e[+-]\d+)?")
# A duration or a gap. Times of computing are shorter; a proved share depends on the machine.
RESULT = re.compile(r"\b\d+\.\d{4,}\b(?!e|\s+%)")
MONTH = re.compile(r"\b(?:Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|Sep|Oct|Nov|Dec)\b")
LIMITS = "velocity|falling velocity|acceleration|jerk|position|waypoint|continuity"
PEAK = re.compile(rf"^({LIMITS}) +[-+\d].*$", re.M)
ROBOTS = (DOCS / "robots.md").read_text(encoding="utf-8")


def blocks(page):
    """Return (remark, language, file name, text) of each block that is a command or code."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    run = {"bash", "console", "python"}
    return [
        block
        for block in found
        if block[1] in run or block[2] or (block[1] == "text" and block[3].startswith("$ "))
    ]


def commands(language, text):
    """Return pairs of a command and what the page shows below it, if anything."""
    if language != "bash":
        return COMMAND.findall(text)
    return [(line.partition("  #")[0], "") for line in text.splitlines()]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder of results."""
    folder = tmp_path_factory.mktemp("blocks") / "results"
    compare(["one-joint"], ["ruckig-stop"], folder, jobs=1)
    arm = DOCS / "examples" / "motions" / "arm.toml"
    with pytest.raises(SystemExit):
        main(f"plan {arm} --planner ruckig-stop --out {folder}/theirs.csv".split())
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch, finished):
    """The files that the pages name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("trajopt.cli.plan._PROOF_TIME_S", 5.0)  # enough on a busy machine
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("SHELL", "/bin/bash")  # what --install-completion writes for, and where
    monkeypatch.setenv("MPLCONFIGDIR", mpl.get_cachedir())
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    shutil.copytree(DOCS / "examples" / "motions", tmp_path, dirs_exist_ok=True)
    shutil.copy("arm.toml", "my-robot.toml")
    shutil.copy("joint_limits.yaml", "my_limits.yaml")
    for name in ("ur5e.urdf", "robot.urdf", "r.urdf"):
        shutil.copy(DOCS / "examples" / "ur5e" / "ur5e.urdf", name)
    shutil.copy(DOCS / "gallery" / "plot_5_wrap_toppra.py", "wrap_toppra.py")
    for script in ("check_proof.py", "check_front.py"):
        shutil.copy(DOCS / "examples" / "best-known" / script, tmp_path)
    shutil.copy(DOCS / "examples" / "planner-package" / "chord_cubic.py", "my_planner.py")
    with Path("my_planner.py").open("a") as file:
        file.write("\nMyPlanner = ChordCubic\n")
    monkeypatch.syspath_prepend(tmp_path)
    os.symlink(ROOT / "data", "data")
    for name in ("results", "my-results"):
        shutil.copytree(finished, name)
    for name in ("results.h5", "theirs.csv"):
        shutil.copy(finished / name, tmp_path)
    yield tmp_path
    for path in tmp_path.glob("*.py"):  # the page's modules, and nobody else's afterwards
        sys.modules.pop(path.stem, None)


def run(command, capsys):
    """Return the exit code and what the command prints; `trajopt` runs in this process."""
    capsys.readouterr()
    if command.startswith("trajopt ") and not set("|<>") & set(command):
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(command)[1:])
        return ended.value.code or 0, "".join(capsys.readouterr())
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + without_progress(done.stderr)


def normal(text):
    """Return a text in one line, its numbers and months replaced, without the peaks' joints."""
    text = PEAK.sub("", text)
    return MONTH.sub("Month", NUMBER.sub("#", " ".join(text.split())))


def same(printed, shown):
    """Compare without numbers; `...` on a page is any text."""
    parts = [re.escape(part.strip()) for part in normal(shown).split("...")]
    return re.fullmatch(".*".join(parts), normal(printed))


def results(text):
    """Return durations and gaps, but for the peaks'."""
    return [float(number) for number in RESULT.findall(PEAK.sub("", text))]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(
            page,
            id=page.relative_to(ROOT).as_posix(),
            marks=[pytest.mark.long] if page.stem in RUN_MANY else [],
        )
        for page in PAGES
    ],
)
def test_the_blocks_of_a_page_run(page, folder, capsys):
    text = page.read_text(encoding="utf-8")
    files = BLOCK.findall(ROBOTS) if "ur5e" in text or ".urdf" in text else []
    for _, _, name, content in [*files, *blocks(page)]:
        if name:
            Path(name).write_text(content, encoding="utf-8")
    names = {"__name__": "__main__"}
    for remark, language, name, content in blocks(page):
        if name or remark in BY_CI or remark.startswith("not run"):
            continue
        if remark.startswith("needs ") and find_spec(remark.removeprefix("needs ")) is None:
            continue
        if language == "python":
            exec(compile(content, page.name, "exec"), names)
            continue
        session = commands(language, content)
        last = int(remark.removeprefix("exit ")) if remark.startswith("exit ") else 0
        for command, shown in session:
            expected = last if command == session[-1][0] else 0
            if command.startswith("trajopt compare") and "--seeds" not in command:
                command += " --seeds 1"
            code, printed = run(command, capsys)
            assert code == expected, f"{command}\n{printed}"
            if shown:
                assert same(printed, shown), f"{command}\n{printed}\nPAGE\n{shown}"
                for own, said in zip(results(printed), results(shown), strict=False):
                    assert own == pytest.approx(said, rel=2e-3, abs=1e-3), command


SYMPTOMS = [page for page in (DOCS / "symptoms").glob("*.md") if page.stem != "index"]


@pytest.mark.parametrize("page", SYMPTOMS, ids=lambda page: page.stem)
def test_a_symptom_s_page_ends_with_a_verified_cure(page):
    """Its blocks run above: the last command judges a motion as executed, and exits with 0."""
    sessions = [block for block in blocks(page) if block[1] in ("bash", "console")]
    remark, language, _, content = sessions[-1]
    assert commands(language, content)[-1][0].startswith("trajopt verify ")
    assert not remark
