"""The command line: list, suite, plan, compare, explain, certify, verify, report, export.

Heavy imports wait inside the commands, so that `--help` answers at once. Exit codes: 0 done, 1
nothing could be solved or something does not hold, 2 bad input (one line on stderr).
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal

import cyclopts
from cyclopts import Parameter

from trajopt.cli import suite as suite_cli

app = cyclopts.App(
    name="trajopt",
    help="How far from optimal is a robot trajectory planner? Exact minimum-time references, "
    "every answer verified.",
    version_flags=["--version"],
    help_format="plaintext",
    suppress_keyboard_interrupt=False,  # main says what to type to go on
)

Problems = Annotated[str, Parameter(help="Problem file, or the name of a built-in problem.")]
PlannerSpec = Annotated[
    str, Parameter(help="NAME or NAME:key=value,key=value; see `trajopt list`.")
]
Json = Annotated[bool, Parameter(negative=(), help="Print one JSON object and nothing else.")]
_MANY = 12  # problems, beyond which compare writes one page instead of a table and figures each

app.command(suite_cli.app)


@app.command(name="list")
def list_(*, json: Json = False) -> int:
    """List planners, with their options and defaults, and built-in problems."""
    from trajopt.cli import render, tables

    planners, problems = tables.planners(), tables.problems()
    if json:
        _print_json({"planners": planners, "problems": problems})
    else:
        render.listing(planners, problems)
    return 0


@app.command
def plan(
    problem: Problems,
    *,
    planner: PlannerSpec,
    seed: Annotated[int, Parameter(help="Seed of the random stream of stochastic planners.")] = 0,
    out: Annotated[
        Path | None,
        Parameter(help="Write the certified trajectory (.csv, .json) or the trial (.h5)."),
    ] = None,
    rate: Annotated[float, Parameter(help="Samples per second in a .csv file.")] = 1000.0,
    json: Json = False,
) -> int:
    """Run one planner on one problem and verify its answer."""
    from trajopt.benchmark.export import motion as export
    from trajopt.benchmark.suites import catalogue as suite
    from trajopt.benchmark.trial import judge
    from trajopt.cli import render
    from trajopt.exceptions import InvalidInput
    from trajopt.registry import load, parse

    if seed < 0:
        raise InvalidInput("--seed", "0 or more", value=seed)
    if not 0 < rate < float("inf"):
        raise InvalidInput("--rate", "a positive number", value=rate)
    write, file = out and export.writer(out), suite.find(problem)
    trial = judge(load(planner), suite.load(problem), [seed], parse(planner)[0])[0]
    if json:
        _print_json({"problem": trial.problem.name, "problem_file": str(file)} | trial.as_dict())
    else:
        render.plan(trial, file)
    if out and write:
        if trial.certified_trajectory is None and out.suffix != ".h5":
            print(f"trajopt: {out} is not written: no certified trajectory", file=sys.stderr)
            return 1
        write(out, trial, rate)
    return 0 if trial.certified_duration or trial.lower_bound else 1


@app.command
def compare(
    *problems: Problems,
    planner: Annotated[
        list[str] | None,
        Parameter(help="NAME[:key=value,…], repeated for each planner; all by default."),
    ] = None,
    suite: Annotated[
        list[str] | None, Parameter(help="All problems of a suite; see `trajopt suite list`.")
    ] = None,
    seeds: Annotated[int, Parameter(help="Seeds 0 … N−1 of each stochastic planner.")] = 30,
    jobs: Annotated[int | None, Parameter(help="Worker processes; by default one per CPU.")] = None,
    output: Annotated[
        Path, Parameter(help="Results folder; what is there already is kept.")
    ] = Path("results"),
    fresh: Annotated[bool, Parameter(negative=(), help="Run everything again.")] = False,
    timeout: Annotated[float, Parameter(help="Seconds after which a trial is stopped.")] = 600.0,
    memory: Annotated[
        float | None,
        Parameter(help="GiB that a trial's process may use (Linux); no limit by default."),
    ] = None,
    dask: Annotated[
        str | None,
        Parameter(help="Address or file of a Dask scheduler to run the trials on."),
    ] = None,
    certify: Annotated[
        bool, Parameter(negative=(), help="Prove lower bounds too: same as --planner certify.")
    ] = False,
) -> int:
    """Run planners on problems; print the table, store every trial, draw the figures.

    More than 12 problems get one line per planner, and a report in place of the figures.
    """
    from trajopt.benchmark import compare as run
    from trajopt.benchmark.figures import draw as figures
    from trajopt.benchmark.run import dask as cluster
    from trajopt.benchmark.suites import catalogue as suites
    from trajopt.cli import render, render_results
    from trajopt.exceptions import InvalidInput
    from trajopt.registry import load, parse

    jobs = run.cpus() if jobs is None else jobs
    for name, value in (("--seeds", seeds), ("--jobs", jobs), ("--timeout", timeout)):
        if not 1 <= value < float("inf"):
            raise InvalidInput(name, "at least 1", value=value)
    if memory is not None and not 0.25 <= memory < float("inf"):
        raise InvalidInput("--memory", "at least 0.25 GiB", value=memory)
    if not problems and not suite:
        raise InvalidInput(
            "PROBLEM",
            "at least one problem file or built-in name (see `trajopt list`), or a --suite",
        )
    loaded = [suites.load(name) for name in dict.fromkeys(problems)]
    loaded += [problem for name in dict.fromkeys(suite or ()) for problem in suites.problems(name)]
    specs = [*(planner or _loadable()), *(["certify"] if certify else [])]
    planners = [(parse(spec)[0], load(spec)) for spec in specs]
    total = sum(len(task.seeds) for task in run.plan(loaded, planners, seeds))
    elsewhere = cluster.executor(dask) if dask else nullcontext()
    with render.progress(total) as advance, elsewhere as executor:
        results = run.compare(
            loaded, planners, output.resolve(), seeds=seeds, jobs=jobs, fresh=fresh,
            timeout=timeout, memory=memory, progress=advance, executor=executor,
        )  # fmt: skip
    if len(loaded) > _MANY:
        from trajopt.benchmark import report

        with render.waiting("writing the report"):
            page = report.write(results, output / "report.html", command=f"trajopt report {output}")
        render_results.sweep(results, output, page)
    else:
        with render.waiting("drawing the figures"):
            drawn = figures.draw(results, output / "figures")
        render_results.comparison(results, output, drawn)
    found = results.trials()
    return 0 if ((found["status"] == "solved") | found["lower_bound"].notna()).any() else 1


@app.command
def explain(
    problem: Problems,
    *,
    planner: PlannerSpec,
    seed: Annotated[int, Parameter(help="Seed of the random stream of stochastic planners.")] = 0,
    output: Annotated[Path, Parameter(help="Folder for the figures.")] = Path("results/explain"),
    json: Json = False,
) -> int:
    """Say what a planner's gap is made of, and which limits hold it back."""
    from trajopt.benchmark.figures import draw as figures
    from trajopt.benchmark.suites import catalogue as suite
    from trajopt.benchmark.trial import judge
    from trajopt.cli import render
    from trajopt.exceptions import InvalidInput
    from trajopt.explain import decomposition as gap
    from trajopt.registry import load, parse

    if seed < 0:
        raise InvalidInput("--seed", "0 or more", value=seed)
    chosen, file = load(planner), suite.find(problem)
    trial = judge(chosen, suite.load(problem), [seed], parse(planner)[0])[0]
    names = {"problem": trial.problem.name, "planner": trial.label, "seed": trial.seed}
    if trial.certified_trajectory is None:
        reason = {"status": trial.status, "message": trial.message}
        _print_json(names | reason) if json else render.plan(trial, file)
        return 1
    with render.waiting("asking the references"):
        found = gap.explain(trial.problem, chosen, trial.certified_trajectory)
        drawn = figures.explain(trial, found, output)
    if json:
        _print_json(names | found.as_dict() | {"figures": [str(f) for f in drawn]})
    else:
        render.explanation(trial, found, drawn)
    return 0


@app.command
def certify(
    problem: Problems,
    *,
    family: Annotated[
        Literal["free", "spline353"],
        Parameter(help="Any trajectory, or the 3-5-3 spline with shared times."),
    ] = "free",
    gap: Annotated[float, Parameter(help="Relative gap at which to stop.")] = 1e-4,
    time_limit: Annotated[
        float, Parameter(help="Seconds; the bounds reached are the answer.")
    ] = 60.0,
    joint: Annotated[int | None, Parameter(help="One joint alone, counted from 1.")] = None,
    json: Json = False,
) -> int:
    """Prove a lower bound on the minimum time."""
    from trajopt.benchmark.suites import catalogue as suite
    from trajopt.cli import render
    from trajopt.exceptions import TrajoptError
    from trajopt.registry import configured, entries
    from trajopt.solution import Status

    file = suite.find(problem)
    loaded = suite.load(problem)
    options = {"family": family, "gap": gap, "time_limit": time_limit, "joint": joint}
    planner = configured(entries()["certify"].load(), options, "certify")
    began = time.perf_counter()
    proof = planner.solve(loaded)
    if proof.status is Status.UNSUPPORTED:
        raise TrajoptError(proof.message)
    table = {
        "problem": loaded.name,
        "problem_file": str(file),
        "family": family,
        "joint": joint,
        "lower_bound": proof.stats["lower_bound"],
        "upper_bound": proof.stats["upper_bound"],
        "relative_gap": proof.stats["relative_gap"],
        "status": proof.stats["proof"],
        "solve_time": time.perf_counter() - began,
    }
    if json:
        _print_json(table)
    else:
        render.bound(table, proof.message)
    return 0


@app.command
def verify(
    path: Annotated[Path, Parameter(help="Results folder, or a results.h5.")],
    *,
    json: Json = False,
) -> int:
    """Verify every stored trajectory anew, from the file alone."""
    from trajopt.benchmark.store.verification import verification
    from trajopt.cli import render

    found = verification(path)
    if json:
        rows = [trial.as_dict() for trial in found.trials]
        _print_json({"holds": found.holds, "summary": found.summary(), "trials": rows})
    else:
        render.verification(found)
    return 0 if found.holds else 1


@app.command
def export(
    folder: Annotated[Path, Parameter(help="Results folder of a comparison.")],
    *,
    to: Annotated[
        Literal["csv", "parquet", "ioh"],
        Parameter(help="Trials as CSV or Parquet, or convergence histories for IOHanalyzer."),
    ],
    out: Annotated[Path | None, Parameter(help="File, or new folder for ioh.")] = None,
) -> int:
    """Write the trials of a folder for other tools."""
    from trajopt.benchmark.analysis.results import Results
    from trajopt.benchmark.export import tables as exports

    results = Results(folder)
    path = out or folder / ("ioh" if to == "ioh" else f"trials.{to}")
    exports.write(results, to, path)
    print(f"exported: {path} ({len(results.items)} trials)")
    if to == "ioh" and (left_out := exports.without_history(results)):
        print(f"without a history to plot, left out: {', '.join(left_out)}")
    return 0


@app.command
def report(
    folder: Annotated[Path, Parameter(help="Results folder of a comparison.")],
    *,
    trajectories: Annotated[int, Parameter(help="Problems shown with their trajectories.")] = 60,
) -> int:
    """Write one self-contained, interactive page about all trials of a folder: report.html."""
    from trajopt.benchmark import report
    from trajopt.benchmark.analysis.results import Results
    from trajopt.cli import render

    with render.waiting("writing the report"):
        results = Results(folder)
        command = f"trajopt report {folder}"
        page = report.write(
            results, folder / "report.html", command=command, trajectories=trajectories
        )
    print(f"report: {page} ({page.stat().st_size / 1e6:.1f} MB, {len(results.items)} trials)")
    return 0


def _loadable() -> list[str]:
    """Every planner that can be imported and does not wait to be asked for by name.

    Of those that cannot (a stranger's, broken) only a warning.
    """
    from trajopt.exceptions import TrajoptError
    from trajopt.registry import entries

    names = []
    for name, entry in entries().items():
        try:
            if not entry.load().on_request:
                names.append(name)
        except TrajoptError as error:
            print(f"trajopt: left out: {error}", file=sys.stderr)
    return names


def _print_json(table: Any) -> None:
    from trajopt.cli import tables

    print(tables.as_json(table))


def _words(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def main(arguments: list[str] | None = None) -> None:
    """Entry point: every mistake of the user is one line and exit code 2."""
    from trajopt.exceptions import TrajoptError

    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, `head` perhaps, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except (TrajoptError, cyclopts.CycloptsError, OSError) as error:
        print("trajopt: " + " ".join(_words(error).split()), file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(
            "\ntrajopt: stopped; finished trials are kept, run the same command to go on",
            file=sys.stderr,
        )
        sys.exit(130)
    sys.exit(code)


if __name__ == "__main__":
    main()
