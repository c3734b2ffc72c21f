"""Run trials on Dask's distributed workers, which must see the results folder.

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

CONNECT_TIMEOUT_S = 20.0  # for the scheduler to answer


@contextmanager
def executor(address: str) -> Iterator[Executor]:
    """Connect to the scheduler at `address`, or at the address in that scheduler file.

    Trials of a worker that dies run again elsewhere.

    Raises:
        MissingBackend: Dask is not installed.
        InvalidInput: No scheduler answers.
    """
    distributed = backend("distributed", "cluster")
    try:
        file = Path(address)
        where = files.json(file, "--dask")["address"] if file.is_file() else address
        client = distributed.Client(where, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError, KeyError, TypeError) as error:
        right = "the address or scheduler file of a running Dask scheduler"
        raise InvalidInput("--dask", right, value=address) from error
    with client:
        yield client.get_executor(pure=False)
