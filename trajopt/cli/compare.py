"""`trajopt compare`: what it is asked, before anything that takes long is imported."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.benchmark.run import server
from trajopt.cli.parameters import MAX_SECONDS, InterpolationName, number, whole_number
from trajopt.core.exceptions import InvalidInput


def compare(
    *problems: Annotated[str, Parameter(help="Problem file, or the name of a built-in problem.")],
    planner: Annotated[
        list[str] | None,
        Parameter(help="NAME[:key=value,…], repeated for each planner; all by default."),
    ] = None,
    motion: Annotated[
        list[Path] | None,
        Parameter(
            help="File of a motion to judge beside the planners (`trajopt judge`), repeated."
        ),
    ] = None,
    interpolation: InterpolationName = "auto",
    suite: Annotated[
        list[str] | None, Parameter(help="All problems of a suite; see `trajopt suite list`.")
    ] = None,
    seeds: Annotated[
        int,
        whole_number("Seeds 0 … N−1 of each stochastic planner.", least=1, most=1_000_000),
    ] = 30,
    jobs: Annotated[
        int | None,
        whole_number("Worker processes; by default one per CPU.", least=1, most=4096),
    ] = None,
    output: Annotated[
        Path, Parameter(help="Results folder; what is there already is kept.")
    ] = Path("results"),
    fresh: Annotated[bool, Parameter(negative=(), help="Run everything again.")] = False,
    timeout: Annotated[
        float,
        number("Seconds after which a trial is stopped.", least=1, most=MAX_SECONDS),
    ] = 600.0,
    memory: Annotated[
        float | None,
        number(
            "GiB that a trial's process may use (Linux); no limit by default.",
            least=0.25,
            most=1e6,
        ),
    ] = None,
    dask: Annotated[
        str | None,
        Parameter(help="Address or file of a Dask scheduler to run the trials on."),
    ] = None,
    certify: Annotated[
        bool, Parameter(negative=(), help="Prove lower bounds too: same as --planner certify.")
    ] = False,
    against: Annotated[
        str | None,
        Parameter(help="NAME[:key=value,…] to test all others against; it is run too."),
    ] = None,
) -> int:
    """Run planners on problems; print the table, store every trial, draw the figures."""
    if not problems and not suite:
        right = "at least one problem file or built-in name (see `trajopt list`), or a --suite"
        raise InvalidInput("PROBLEM", right)
    output = _outside_deleted_folder(output)
    if dask is None and not (output / "results.h5").exists():
        server.start()
    # planners and tables: while the server imports what every trial needs
    from trajopt.cli import comparison

    return comparison.run(
        problems,
        planner,
        motions=motion or [],
        interpolation=interpolation,
        suites=suite or [],
        seeds=seeds,
        jobs=jobs,
        output=output,
        fresh=fresh,
        timeout=timeout,
        memory=memory,
        dask=dask,
        certify=certify,
        against=against,
    )


def _outside_deleted_folder(output: Path) -> Path:
    """The same folder, reached from elsewhere if the working folder was deleted.

    Processes cannot start in that.
    """
    try:
        os.getcwd()
    except FileNotFoundError:
        folder = output.absolute()
        os.chdir(folder.anchor)
        return folder
    return output
