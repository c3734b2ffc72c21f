"""The commands of the command line, their exit codes, and errors in one line.

A command is a file beside this one. It is imported when it runs, so that `--help` answers at once.
Exit codes: 0 done, 1 nothing could be solved or something does not hold, 2 bad input (one
line on standard error), 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

import cyclopts

import trajopt
from trajopt.cli import STOPPED, console, examples
from trajopt.core.exceptions import FileNote, TrajoptError, UnitWarning, UnknownName, nearest
from trajopt.core.out_of_scope import SCOPE, out_of_scope
from trajopt.core.renamed import told

_OVERWRITTEN = (
    "another distribution, trajopt, has overwritten a part of mintime: uninstall it "
    "(pip uninstall trajopt), then install mintime again (pip install --force-reinstall)"
)
app = cyclopts.App(
    name="trajopt",
    help="How far from optimal is a robot trajectory planner? Exact minimum-time references, "
    "every answer verified.\n\n" + SCOPE + "\n\n"
    "With any command, --kind FILE.py:NAME makes a kind of limit of your own known.",
    version_flags=["--version"],
    help_format="plaintext",
    default_parameter=cyclopts.Parameter(negative=()),  # no --no-force, no --empty-planner
    suppress_keyboard_interrupt=False,  # main says what to type to go on
)
_COMMANDS = {
    "list": (
        "listing:list_",
        "List planners with their options and defaults, problems, robots, and kinds of limits.",
    ),
    "suite": (
        "suite:app",
        "List benchmark suites, show their problems, write them as problem files.",
    ),
    "new": ("new:new", "Write a commented problem file to start from."),
    "plan": (
        "plan:plan",
        "Run one planner on one problem and verify its answer.\n\n"
        "The problem is a built-in name, a problem file, or a file of waypoints (.csv, .txt, .npy, "
        ".json) with --robot, --urdf or --limits.",
    ),
    "compare": (
        "compare:compare",
        "Run planners on problems; print the table, store every trial, draw the figures.\n\n"
        "More than 12 problems get one line per planner, and a report in place of the figures.",
    ),
    "explain": (
        "explain:explain",
        "Say what a planner's gap is made of, and which limits hold it back.",
    ),
    "judge": (
        "judge:judge",
        "Judge a motion that anyone planned: a CSV, a ROS message, or polynomials.",
    ),
    "chunk": (
        "chunk:chunk",
        "Plan the motion through the targets of a learned policy, chunk by chunk.",
    ),
    "retime": (
        "retime:retime",
        "Say how fast a given path can be passed under any limits, and write that motion.",
    ),
    "race": (
        "race:race",
        "Show motions of planners side by side on one clock, as a page.",
    ),
    "prove": ("prove:prove", "Prove a lower bound on the minimum time."),
    "front": (
        "front:front",
        "Say how smooth a motion of each duration can be, and how smooth the planners are.",
    ),
    "claims": ("claims:claims", "Judge the times that were published for a problem."),
    "best-known": (
        "best_known:app",
        "List, check and improve the best known motion of every suite problem.",
    ),
    "verify": (
        "verify:verify",
        "Verify every stored trajectory anew, from the file alone; or a motion within --limits.",
    ),
    "export": ("export:export", "Write the trials of a folder for other tools."),
    "report": (
        "report:report",
        "Write one self-contained, interactive page about all trials of one or several folders.",
    ),
    "diff": ("diff:diff", "Show which median durations moved between two results."),
}
for _name, (_target, _help) in _COMMANDS.items():
    if _target.endswith(":app"):  # it has subcommands, and says its examples itself
        app.command(f"trajopt.cli.{_target}", name=_name, help=_help)
    else:
        _end = examples.in_words(_name)
        app.command(f"trajopt.cli.{_target}", name=_name, help=_help, help_epilogue=_end)
app.register_install_completion_command(
    help="Make the shell complete commands and options (bash, zsh, fish)."
)


@app.command(name="help")
def help_(*command: str) -> int:
    """Tell how a command is used: trajopt help compare."""
    return _run([*command, "--help"])


def main(arguments: list[str] | None = None) -> None:
    """Entry point: every mistake of the user is one line and exit code 2."""
    console.prepare()
    try:
        if "Problem" not in dir(trajopt):
            raise TrajoptError(_OVERWRITTEN)
        code = _run(_without_kinds(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, `head` perhaps, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except (TrajoptError, cyclopts.CycloptsError, OSError) as error:
        console.show_held(_words(error))
        sys.exit(2)
    except KeyboardInterrupt as stop:
        print(file=sys.stderr)
        console.note("; ".join(["stopped", *getattr(stop, "__notes__", ())]))
        sys.exit(STOPPED)
    sys.exit(code)


def _without_kinds(arguments: Sequence[str]) -> list[str]:
    """Import the kinds of limits of `--kind`, and return the other arguments.

    Raises:
        TrajoptError: A kind cannot be imported.
    """
    left: list[str] = []
    given = iter(arguments)
    for argument in given:
        option, equals, value = argument.partition("=")
        if argument == "--":
            return [*left, argument, *given]
        if option != "--kind":
            left.append(argument)
            continue
        from trajopt.core.limits import limit  # late: `--help` answers at once

        limit.in_file(value if equals else next(given, ""))
    return left


def _run(arguments: list[str] | None) -> int:
    """The command's exit code; warnings of this package are a line each on standard error."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", UnitWarning)
        warnings.filterwarnings("always", category=UserWarning, module="trajopt")
        warnings.showwarning = _show_warning
        code: int = app(
            arguments, exit_on_error=False, print_error=False, result_action="return_value"
        )
    console.show_held()
    return code


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    own_package = category.__module__.partition(".")[0] == "trajopt"
    if issubclass(category, FileNote):
        console.HELD.append(str(message))
    elif own_package:
        console.note(f"warning: {message}")
    elif not issubclass(category, RuntimeWarning):  # NumPy's: what overflows the verifier refuses
        text = warnings.formatwarning(message, category, filename, lineno, line)
        print(text, end="", file=file or sys.stderr)


def _words(error: Exception) -> str:
    if isinstance(error, cyclopts.MissingArgumentError) and error.argument:
        return _missing(error)
    if isinstance(error, cyclopts.UnknownOptionError):
        option, _, _ = (error.token.keyword or error.token.value).partition("=")
        renamed = told(option, "option")
        if renamed:
            return renamed
        elsewhere = out_of_scope(option)
        if elsewhere:
            return f"{option} is no option: {elsewhere}"
        known = [name for argument in error.argument_collection for name in argument.names]
        return _suggesting(error, option, known)
    if isinstance(error, cyclopts.UnusedCliTokensError) and error.unused_tokens:
        given = " ".join(error.unused_tokens)
        command = " ".join(error.command_chain or ())
        return f"{given}: {command} takes no further argument"
    if isinstance(error, cyclopts.UnknownCommandError) and error.app and error.unused_tokens:
        given = error.unused_tokens[0]
        return told(given, "command") or _suggesting(error, given, [*error.app])
    if isinstance(error, UnknownName):
        return _taken_for_another(error) or str(error)
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    if error.filename:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, FileNotFoundError):
        return f"the working folder was deleted ({error.strerror})"
    return error.strerror


def _taken_for_another(error: UnknownName) -> str:
    """Say that a planner was given as a problem, or a problem as a planner; empty otherwise."""
    from trajopt.benchmark.suites import catalogue
    from trajopt.planners.registry import entries

    name = error.name
    if error.kind == "problem" and name in entries():
        return f"{name} is a planner, not a problem; commands that take one want --planner {name}"
    if error.kind == "planner" and name in catalogue.problem_files():
        return f"{name} is a problem, not a planner; it is given without --planner"
    return ""


def _missing(error: cyclopts.MissingArgumentError) -> str:
    """Say what a command needs in the words of its help, with an example."""
    command = " ".join(error.command_chain or ())
    argument = error.argument
    assert argument is not None
    positional = argument.index is not None
    name = argument.name.lstrip("-").upper() if positional else argument.name
    meaning = (argument.parameter.help or "").rstrip(".")
    words = f"{command} needs {name}" + f" ({meaning})" * bool(meaning)
    known = examples.EXAMPLES.get(command.partition(" ")[0], ())
    return f"{words}; for example: {known[0]}" if known else words


def _suggesting(error: Exception, given: str, known: list[str]) -> str:
    """The error's words, with the known name where only upper and lower case differ."""
    close = nearest(given, known)
    if not close or "Did you mean" in str(error):
        return str(error)
    return f'"{given}" is unknown. Did you mean "{close}"?'
