"""`trajopt best-known list | verify | propose | archive`: the best known answers."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import cyclopts
from cyclopts import Parameter

from trajopt import judgement
from trajopt.benchmark.best_known import archive as archive_of_records
from trajopt.benchmark.best_known import proposal, records
from trajopt.benchmark.best_known.proposal import Candidate, RecordUpdate
from trajopt.benchmark.best_known.records import CLOSED_WITHIN, Origin, Record
from trajopt.benchmark.store.folder import is_trial
from trajopt.benchmark.store.recheck import CheckedTrial, Verification
from trajopt.benchmark.suites import catalogue
from trajopt.cli import console, examples, kinds
from trajopt.cli.parameters import Force, InterpolationName, Json
from trajopt.cli.plan import check_target
from trajopt.cli.verify import report
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import rounded_down
from trajopt.core.problem import Problem
from trajopt.formats.motion import ENDINGS

app = cyclopts.App(
    name="best-known",
    help="The best known motion of every suite problem, with a proved lower bound.",
    help_epilogue=examples.in_words("best-known"),
    help_format="plaintext",
)

ProblemNames = Annotated[
    str, Parameter(help="Problem files, or names of built-in problems; by default all.")
]
# Least width of a terminal in which every name has one line, and width of a name in a narrower one.
_WIDE = 100
_NAME_WIDTH = 20
# With more problems than this, only those with a better answer are printed.
_MANY = 12
_NONE = ("nothing is recorded for its numbers",)

Registry = Annotated[
    Path | None,
    Parameter(help="Folder of records; by default the one that comes with this package."),
]


@app.command(name="list")
def list_(*problems: ProblemNames, registry: Registry = None, json: Json = False) -> int:
    """List best known durations, proved lower bounds, and where they come from."""
    where = _folder(registry)
    asked = _asked(problems)
    found = [(problem, records.find(problem, where)) for problem in asked]
    if json:
        rows = [_row(problem, record, where) for problem, record in found]
        console.print_json({"records": rows})
        return 0
    _print_list(found)
    if not problems:
        console.paragraph()
        _print_suites({problem.digest(): record for problem, record in found})
    return 0


@app.command
def verify(
    *problems: ProblemNames,
    registry: Registry = None,
    write_list: Annotated[bool, Parameter(negative="")] = False,
    json: Json = False,
) -> int:
    """Check every record anew, from its file alone: the motion exactly, the bound by its proof.

    No solver is asked. Exit code 1 if anything does not hold.

    Args:
        write_list: List the files that hold, with their SHA-256, in the folder's proved.sha256:
            comparisons take the bounds of listed files without proving them again.
    """
    if write_list and problems:
        raise InvalidInput("--write-list", "no PROBLEMS beside it: the list is of all records")
    where = _folder(registry)
    files = records.files(where)
    checked = []
    proved = []
    if problems:
        asked = {problem.name: records.file_of(problem, where) for problem in _asked(problems)}
        files = [file for file in asked.values() if file is not None]
        missing = [name for name, file in asked.items() if file is None]
        checked = [CheckedTrial("", name, "no record", differences=_NONE) for name in missing]
    with console.progress(len(files), "records") as advance:
        for file in files:
            checked.append(records.checked(file))
            proved += [file] if checked[-1].holds else []
            advance(1)
    found = Verification(tuple(checked))
    report(found, json)
    if write_list and files:
        listed = records.write_list(proved, where)
        if not json:
            console.line(f"written: {listed}")
    return 0 if found.holds else 1


@app.command
def propose(
    source: Path,
    problem: str | None = None,
    /,
    *,
    method: str | None = None,
    submitter: str = "",
    interpolation: InterpolationName = "auto",
    registry: Registry = None,
    json: Json = False,
) -> int:
    """Judge a motion, or stored trials; write the record where they are better.

    Only code of this package runs. Exit code 0: something is better and written; 1: nothing is.

    Args:
        source: Motion file, results folder, results.h5 or a trial's file.
        problem: Problem of a motion file: name or file.
        method: How a motion was planned; by default its file's name.
        submitter: Who planned it.
    """
    where = _folder(registry)
    target = registry or records.folder_to_write()
    if not source.exists():
        raise InvalidInput("SOURCE", "a file or folder that exists", value=str(source))
    if source.suffix in ENDINGS and not source.is_dir() and not is_trial(source):
        candidates = [_of_motion(source, problem, method, submitter, interpolation)]
    else:
        _refuse_options_of_motions(problem, method, interpolation)
        with kinds.reading(source, "results"):
            candidates = list(proposal.of_trials(source, submitter))
    outcomes = list(proposal.outcomes(candidates, where))
    written = {}
    for outcome in outcomes:
        if outcome.after is not None:
            written[outcome.problem.digest()] = records.write(outcome.after, target)
    if json:
        rows = [_outcome_row(own, written.get(own.problem.digest())) for own in outcomes]
        console.print_json({"outcomes": rows})
    else:
        _print_outcomes(outcomes, written)
    return 0 if written else 1


@app.command(name="archive")
def archive_(archive: Path, /, *, registry: Registry = None, force: Force = False) -> int:
    """Write one archive of problems, motions and proofs, which is checked without this package.

    The same records give the same bytes.

    Args:
        archive: Its name; ends in .zip.
        force: Overwrite it.
    """
    check_target(archive, force=force, key="ARCHIVE")
    count = archive_of_records.write(archive, _folder(registry))
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()
    console.line(f"written: {archive}")
    console.line(f"records: {count}; {archive.stat().st_size / 1e6:.1f} MB; SHA-256:")
    console.line(digest)
    return 0


def _folder(registry: Path | None) -> Path:
    """The folder of records; the package's by default."""
    if registry is None:
        return records.folder()
    if registry.exists() and not registry.is_dir():
        raise InvalidInput("--registry", "a folder", value=str(registry))
    return registry


def _asked(names: Sequence[str]) -> list[Problem]:
    """The problems of these names; all of the suites without one."""
    if not names:
        return [problem for _, problem in catalogue.every_problem().values()]
    return [_problem(name) for name in dict.fromkeys(names)]


def _problem(name: str) -> Problem:
    with kinds.reading(name, "stated problem"):
        return catalogue.load(name)


# --- list ---


def _row(problem: Problem, record: Record | None, where: Path) -> dict[str, Any]:
    """Return a row for JSON, s; None for values that are not recorded."""
    row: dict[str, Any] = {"problem": problem.name, "digest": problem.digest()}
    if record is None:
        return row | {"status": None}
    return row | {
        "status": _status(record),
        "duration": record.duration,
        "lower_bound": record.lower_bound,
        "proved_within": record.proved_within,
        "motion": vars(record.motion),
        "bound": vars(record.bound),
        "file": records.file_of(problem, where),
    }


def _status(record: Record) -> str:
    return "closed" if record.closed else "open"


def _print_list(found: Sequence[tuple[Problem, Record | None]]) -> None:
    numbers = ("best s", "bound s", "within %")
    headings = ("problem", *numbers, "status", "by", "date")
    table = console.table(*headings, numbers=(*numbers, "date"))
    table.columns[0].no_wrap = True
    for problem, record in found:
        name = console.markup(_in_lines(problem.name))
        if record is None:
            table.add_row(name, "–", "–", "–", "none", "", "")
            continue
        table.add_row(
            name,
            f"{record.duration:.5g}",
            rounded_down(record.lower_bound, ".5g"),
            f"{100 * record.proved_within:.3f}",
            _status(record),
            console.option_lines(record.motion.method),
            record.motion.date,
        )
    console.OUT.print(table)


def _in_lines(name: str) -> str:
    """A long name in two lines, where the terminal is too narrow for it beside numbers."""
    if console.OUT.width >= _WIDE or len(name) <= _NAME_WIDTH:
        return name
    place = name.rfind("-", 0, _NAME_WIDTH) + 1
    return f"{name[:place]}\n{name[place:]}"


def _print_suites(known: Mapping[str, Record | None]) -> None:
    """Print how many problems are closed in each suite; a problem counts in all its suites."""
    numbers = ("problems", "closed", "open", "none", "median within %", "largest within %")
    table = console.table("suite", numbers=numbers)
    for name, suite in catalogue.suites().items():
        if not suite.recorded:
            continue
        digests = [problem.digest() for problem in catalogue.problems(name)]
        found = [known[digest] for digest in digests]
        kept = [record for record in found if record is not None]
        within = [100 * record.proved_within for record in kept]
        closed = sum(record.closed for record in kept)
        table.add_row(
            name,
            str(len(found)),
            str(closed),
            str(len(kept) - closed),
            str(len(found) - len(kept)),
            f"{median(within):.3f}" if within else "–",
            f"{max(within):.3f}" if within else "–",
        )
    console.OUT.print(table)
    console.paragraph(
        f"closed: the best known is proved to be the optimum within {100 * CLOSED_WITHIN:g} %"
    )


# --- propose ---


def _of_motion(
    source: Path,
    problem: str | None,
    method: str | None,
    submitter: str,
    interpolation: InterpolationName,
) -> Candidate:
    """Return the candidate in a motion's file.

    Raises:
        InvalidInput: The file cannot be read, its problem is in no suite, or the motion does not
            solve the problem.
    """
    if problem is None:
        raise InvalidInput("PROBLEM", "the problem that the motion is about")
    asked = _problem(problem)
    own = proposal.suite_problem(asked)
    if own is None:
        right = "a problem of a suite (`trajopt suite list`): only those have records"
        raise InvalidInput("PROBLEM", right, value=problem)
    by = Origin(method or source.name, "", proposal.today(), submitter)
    with kinds.reading(source, "motion"):
        judged = judgement.judge(own, source, interpolation=interpolation)
    if judged.certified_duration is None:
        flaws = "; ".join(judged.certificate.flaws)
        right = f"one that solves {own.name}, but {flaws}"
        raise InvalidInput("motion", right, file=str(source))
    return Candidate(own, by, judged.trajectory)


def _refuse_options_of_motions(problem: str | None, method: str | None, interpolation: str) -> None:
    """Refuse the options of motion files for stored trials."""
    given = {"PROBLEM": problem, "--method": method}
    if interpolation != "auto":
        given["--interpolation"] = interpolation
    for name, value in given.items():
        if value is not None:
            right = f"left out, or a motion's file ({', '.join(ENDINGS)}) before it"
            raise InvalidInput(name, right, value=value)


def _outcome_row(outcome: RecordUpdate, file: Path | None) -> dict[str, Any]:
    """Return a row for JSON, s; None for values that do not exist."""
    before = outcome.before
    after = outcome.after
    return {
        "problem": outcome.problem.name,
        "duration": outcome.duration,
        "recorded_duration": before.duration if before else None,
        "recorded_lower_bound": before.lower_bound if before else None,
        "new_duration": after.duration if after else None,
        "new_lower_bound": after.lower_bound if after else None,
        "file": file,
    }


def _print_outcomes(outcomes: Sequence[RecordUpdate], written: Mapping[str, Path]) -> None:
    for outcome in outcomes:
        if outcome.after is None and len(outcomes) > _MANY:
            continue
        for sentence in _sentences(outcome):
            console.paragraph(f"{outcome.problem.name}: {sentence}")
    if len(outcomes) > _MANY:
        console.paragraph(f"{len(written)} of {len(outcomes)} problems have something better.")
    if not outcomes:
        console.paragraph("Nothing here is about a problem of the suites.")
    if not written:
        console.paragraph("Nothing is better than what is recorded: nothing is written.")
        return
    for file in written.values():
        console.line(f"written: {file}")
    console.paragraph(
        "To submit: put these files into data/best_known of a clone of the repository, replacing "
        "those of the same name, check them with `trajopt best-known verify --write-list`, and "
        "open a pull request. CI checks them again; no code of yours is needed."
    )


def _sentences(outcome: RecordUpdate) -> Iterator[str]:
    before = outcome.before
    after = outcome.after
    duration = outcome.duration
    if before is None and after is not None:
        yield f"{after.duration:.9g} s is the first motion recorded."
    elif before is not None and duration is not None:
        share = 100 * (duration / before.duration - 1)
        beside = f"the recorded {before.duration:.9g} s ({before.motion})"
        if outcome.shorter:
            yield f"{duration:.9g} s is {-share:.4g} % less than {beside}."
        else:
            yield f"{duration:.9g} s is no improvement, {share:+.4g} % of {beside}."
    elif after is None and before is None:
        yield "no motion keeps every limit, and none is recorded."
    if after is not None and outcome.tighter:
        bound = f"{rounded_down(after.lower_bound, '.9g')} s ({after.bound.method})"
        within = 100 * after.proved_within
        yield f"every motion takes at least {bound}: the optimum is proved within {within:.3g} %."
