"""Run trials on Dask's distributed workers, which must see the results folder.

Each worker has judges of its own, and a planner a process of its own, as on one machine:

    dask scheduler --scheduler-file cluster.json &
    dask worker --scheduler-file cluster.json --nworkers 8 --nthreads 1
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from trajopt.core import files
from trajopt.core.exceptions import InvalidInput, WorkerError
from trajopt.planners.planner import backend

CONNECT_TIMEOUT_S = 20.0  # for the scheduler to answer
NO_WORKER_TIMEOUT_S = 60.0  # in which a cluster without workers gets another one
CLOSE_TIMEOUT_S = 5.0


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
    logging.disable()  # what is lost is said in a line
    try:
        yield client.get_executor(pure=False)
    finally:
        with suppress(Exception):
            client.close(CLOSE_TIMEOUT_S)
        logging.disable(logging.NOTSET)


def watch(executor: Executor) -> Callable[[], None]:
    """Return what raises `WorkerError` when an executor's Dask cluster is lost.

    It is lost if its scheduler does not answer, or has had no worker for `NO_WORKER_TIMEOUT_S`.
    """
    client: Any = getattr(executor, "_client", None)
    had_workers = time.monotonic()

    def look() -> None:
        nonlocal had_workers
        if client is None:
            return
        try:
            workers = client.scheduler_info()["workers"]
        except Exception as error:
            raise WorkerError(f"Dask's scheduler is lost: {type(error).__name__}") from error
        if workers:
            had_workers = time.monotonic()
        elif time.monotonic() - had_workers > NO_WORKER_TIMEOUT_S:
            raise WorkerError(f"Dask has had no worker for {NO_WORKER_TIMEOUT_S:g} s")

    return look
