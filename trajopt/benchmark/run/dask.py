"""Trials on Dask's distributed workers, which must see the results folder.

Each worker has judges of its own, and a planner a process of its own, as on one machine:

    dask scheduler --scheduler-file cluster.json &
    dask worker --scheduler-file cluster.json --nworkers 8 --nthreads 1
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

from trajopt.core import files
from trajopt.core.exceptions import InvalidInput
from trajopt.planners.planner import backend

_PATIENCE = 20.0  # s, for the scheduler to answer


@contextmanager
def executor(address: str) -> Iterator[Executor]:
    """An executor on the scheduler at `address`, or in that scheduler file.

    A worker that dies has its trials run again elsewhere. Raises `MissingBackend` without Dask,
    `InvalidInput` if nobody answers.
    """
    distributed = backend("distributed")
    try:
        file = Path(address)
        where = files.json(file, "--dask")["address"] if file.is_file() else address
        client = distributed.Client(where, timeout=_PATIENCE)
    except (OSError, ValueError, KeyError, TypeError) as error:
        right = "the address or scheduler file of a running Dask scheduler"
        raise InvalidInput("--dask", right, value=address) from error
    with client:
        yield client.get_executor(pure=False)
