"""Printing: encodings, closed streams, names that look like commands, progress."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from work import without_progress

from trajopt.benchmark.run import progress
from trajopt.benchmark.run.progress import Line, Progress
from trajopt.cli import app, compare, console

EVIL = "[red]evil[/red] \x1b]0;title\x07 $x_$ \\frac :smile: \u202e[/bold]"
PROBLEM = f"""name = {json.dumps(EVIL)}
angle_unit = "rad"
waypoints = [[0], [1], [2], [3]]
[limits]
velocity = [1]
acceleration = [1]
"""


def trajopt(*arguments, encoding="utf-8", shell=None, cwd=None):
    """A command in a real process: exit code, what it wrote as bytes."""
    command = [sys.executable, "-m", "trajopt.cli", *map(str, arguments)]
    if shell:
        command = ["sh", "-c", f'exec "$@" {shell}', "sh", *command]
    environment = os.environ | {"PYTHONIOENCODING": encoding, "COLUMNS": "80"}
    done = subprocess.run(command, capture_output=True, env=environment, cwd=cwd, check=False)
    return done.returncode, done.stdout, done.stderr


# --- streams that are not UTF-8, or not there ---


@pytest.fixture
def written(monkeypatch):
    """Runs a command here, its standard streams of this encoding: exit code, what it wrote."""
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments, encoding):
        out = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
        err = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
        with monkeypatch.context() as patched:
            patched.setattr(sys, "stdout", out)
            patched.setattr(sys, "stderr", err)
            with pytest.raises(SystemExit) as ended:
                app.main([str(argument) for argument in arguments])
        for stream in (out, err):
            stream.flush()
        return ended.value.code, out.buffer.getvalue(), err.buffer.getvalue()

    return run


def check_list(code, out, err, encoding, dash):
    text = out.decode(encoding)
    assert (code, err) == (0, b"")
    assert f" 1{dash}12 " in text
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize(("encoding", "dash"), [("cp437", "-"), ("utf-8", "–")])
def test_what_an_encoding_cannot_hold_is_written_in_ascii(written, encoding, dash):
    check_list(*written("suite", "list", encoding=encoding), encoding, dash)


def test_a_process_whose_streams_are_ascii_writes_ascii():
    check_list(*trajopt("suite", "list", encoding="ascii"), "ascii", "-")


def test_a_comparison_ends_well_where_its_table_cannot_be_written_as_it_is(
    written, tmp_path, monkeypatch
):
    monkeypatch.setattr(compare.draw, "draw", lambda *arguments, **options: [])
    arguments = ("--planner", "unoptimised:segment_time=0.1", "--jobs", 1, "--output", tmp_path)
    code, out, err = written("compare", "one-joint", *arguments, encoding="ascii")
    assert (code, err) == (0, b"")
    assert "and x how much the others" in " ".join(out.decode("ascii").split())


def test_errors_are_one_line_in_ascii_too(written):
    code, out, err = written("plan", "größe", "--planner", "exact", encoding="ascii")
    assert (code, out) == (2, b"")
    assert err.decode("ascii").startswith("trajopt: no problem is called 'groesse'")


COMMANDS = [
    (["suite", "show", "six-axis"], 0),
    (["plan", "one-joint", "--planner", "unoptimised"], 0),
    (["plan", "seven-waypoints", "--planner", "unoptimised", "--json"], 1),
    (["plan", "nosuch", "--planner", "unoptimised"], 2),
]
# The first command meets the streams as the shell left them, the others as Python finds them then.
IN_TURNS = """
import json, os, sys
from trajopt.cli import main

commands, closed, file = json.loads(sys.argv[1])
codes = []
for arguments in commands:
    for descriptor in closed:
        name = ("stdin", "stdout", "stderr")[descriptor]
        if getattr(sys, name) is not None:
            getattr(sys, name).close()
        try:
            os.close(descriptor)
        except OSError:
            pass
        setattr(sys, name, None)
    try:
        main(arguments)
    except SystemExit as ended:
        codes.append(ended.code)
with open(file, "w") as stream:
    json.dump(codes, stream)
sys.exit(codes[-1])
"""


@pytest.mark.parametrize(
    ("closed", "descriptors", "commands"),
    [(">&-", [1], COMMANDS), (">&- 2>&- <&-", [0, 1, 2], COMMANDS[::-1])],
)
def test_closed_streams_keep_the_exit_code(closed, descriptors, commands, tmp_path):
    """A process for each way of closing; each begins and ends with other commands."""
    file = tmp_path / "codes.json"
    told = json.dumps([[arguments for arguments, _ in commands], descriptors, str(file)])
    done = subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", IN_TURNS, told],
        capture_output=True,
        check=False,
    )
    codes = [code for _, code in commands]
    assert (done.returncode, done.stdout) == (codes[-1], b"")
    assert json.loads(file.read_text(encoding="utf-8")) == codes
    assert b"Traceback" not in done.stderr


def test_a_file_does_not_take_a_closed_streams_place(tmp_path):
    """Else what is printed would end in it."""
    file = tmp_path / "t.csv"
    arguments = ["plan", "one-joint", "--planner", "unoptimised", "--out", file, "--rate", 1]
    code, _, _ = trajopt(*arguments, shell=">&- 2>&- <&-")
    assert code == 0
    assert len(file.read_text().splitlines()) == 8


def test_a_reader_that_has_seen_enough_does_not_cost_the_file(tmp_path):
    file = tmp_path / "t.csv"
    arguments = ["plan", "one-joint", "--planner", "unoptimised", "--out", str(file), "--rate", "1"]
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "trajopt.cli", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()  # `head -0`
        assert process.wait() == 0
        assert not without_progress(process.stderr.read().decode())
    assert len(file.read_text().splitlines()) == 8


def test_in_a_deleted_folder_what_needs_none_still_runs(tmp_path):
    package = str(Path(app.__file__).parents[2])  # in a folder that is gone, `-m` needs to be told

    def compare(output):
        gone = tmp_path / "gone"
        gone.mkdir()
        command = [sys.executable, "-m", "trajopt.cli", "compare", "one-joint", "--jobs", "1"]
        command += ["--planner", "exact", "--output", str(output)]
        return subprocess.run(
            ["sh", "-c", 'rmdir "$0" && exec "$@"', str(gone), *command],
            cwd=gone,
            env=os.environ | {"PYTHONPATH": package},
            capture_output=True,
            text=True,
            check=False,
        )

    done = compare(tmp_path / "results")
    assert (done.returncode, done.stderr) == (0, "")
    done = compare("results")
    assert done.returncode == 2
    assert done.stderr.startswith("trajopt: the working folder was deleted")
    assert done.stderr.count("\n") == 1


# --- names are text ---


@pytest.fixture
def evil(tmp_path):
    file = tmp_path / "evil.toml"
    file.write_text(PROBLEM, encoding="utf-8")
    return file


WRITTEN = r"[red]evil[/red] \x1b]0;title\x07 $x_$ \frac :smile: \u202e[/bold]"


def test_text_is_shown_as_it_is_and_control_characters_by_their_names():
    assert console.visible(EVIL) == WRITTEN
    assert console.visible("größe – π\n\t1") == "größe – π\n\t1"
    assert console.visible("\udc80") == r"\udc80"


def shown(renderable, width=200):
    stream = io.StringIO()
    Console(file=stream, width=width, emoji=False, highlight=False).print(renderable)
    return stream.getvalue()


def test_markup_and_tables_show_names_as_they_are():
    assert shown(f"[bold]{console.markup(EVIL)}[/bold]") == f"{WRITTEN}\n"
    table = console.table("name", title=EVIL)
    table.add_row(console.option_lines("[a]:x=[blue],y=\x1b[31m"))
    lines = [line.rstrip() for line in shown(table).splitlines()]
    assert "".join(lines[: lines.index("name")]).replace(" ", "") == WRITTEN.replace(" ", "")
    assert lines[lines.index("name") + 1 :] == ["[a]", "  x=[blue]", r"  y=\x1b[31m"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["plan", "--planner", "unoptimised"],
        ["plan", "--planner", "pso:timing=\x1b[31m"],
        ["prove", "--time-limit", "10"],
    ],
)
def test_commands_show_names_as_they_are(evil, capsys, monkeypatch, arguments):
    monkeypatch.setenv("COLUMNS", "300")
    with pytest.raises(SystemExit):
        app.main([arguments[0], str(evil), *arguments[1:]])
    out, err = capsys.readouterr()
    assert WRITTEN in out or r"\x1b[31m" in err
    assert "\x1b" not in out + err


# --- progress in a log ---


def test_a_log_gets_lines_with_the_time_left(monkeypatch, capsys):
    monkeypatch.setattr(progress, "LOG_INTERVAL_S", 10.0)
    clock = iter([0.0, 0.0, 4.0, 20.0, 21.0, 100.0])
    line = Line(rewritten=False, clock=lambda: next(clock))
    for finished in (40, 50, 60, 61, 100):  # 40 were there already
        line(Progress(100, finished, kept=40))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "trajopt: 60 of 100 trials after 20 s, about 40 s left",  # 20 in 20 s, 40 to go
        "trajopt: 100 of 100 trials after 1 min 40 s",
    ]


def test_progress_without_a_terminal_is_silent_at_first(capsys):
    with console.progress(3) as advance:
        for _ in range(3):
            advance(1)
    assert capsys.readouterr().err == ""


def test_progress_in_a_terminal_is_a_line_that_is_rewritten(monkeypatch, capsys):
    stream = Console(file=io.StringIO(), force_terminal=True)
    monkeypatch.setattr(console, "ERR", stream)
    with console.progress(3) as advance:
        for _ in range(3):
            advance(1)
    assert capsys.readouterr().err.endswith("\r3 of 3 trials after 0 s\n")


def test_a_note_of_100_kb_is_one_line_of_a_screen(capsys):
    console.note(f"begin {'a' * 100_000} end")
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert len(said) < 1500
    assert said.startswith("trajopt: begin a")
    assert said.endswith("a end\n")


def test_overflows_of_a_command_are_no_warnings_of_numpy(tmp_path):
    (tmp_path / "p.toml").write_text(
        "waypoints = [[0.0], [1e300]]\nangle_unit = 'rad'\n"
        "limits = {velocity = [1e300], acceleration = [1.0]}\n"
    )
    code, out, err = trajopt("plan", tmp_path / "p.toml", "--planner", "ruckig-stop", "--json")
    assert code in (0, 1)
    assert out.startswith(b"{")
    assert b"Warning" not in err


def test_a_traceback_ends_in_the_last_line_of_ones_own_code():
    text = """Traceback (most recent call last):
  File "/home/me/mine.py", line 19, in solve
    return np.linalg.inv(matrix)
  File "/env/lib/python3.11/site-packages/numpy/linalg/_linalg.py", line 609, in inv
    raise LinAlgError("Singular matrix")
numpy.linalg.LinAlgError: Singular matrix
"""
    last = "numpy.linalg.LinAlgError: Singular matrix"
    assert console.last_line(text) == f"{last} (mine.py, line 19)"
    assert console.last_line(text.replace("/home/me/", "/site-packages/")) == last
    assert console.last_line("it takes 4 waypoints\n") == "it takes 4 waypoints"
    assert console.last_line("") == ""
