"""Child processes that a command shares: its trials run there first, then its figures are drawn."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING

from trajopt.benchmark.run.threads import single_threaded

if TYPE_CHECKING:
    from pebble import ProcessPool


class Pool:
    """So many child processes, started when the first of them is needed; none outlives the block.

        with Pool(jobs=2) as pool:
            drawn = pool.submit(job)

    When the block ends with an error, or by Ctrl-C, what they are at is stopped.
    """

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self._open = ExitStack()
        self._processes: ProcessPool | None = None

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._open.__exit__(kind, error, traceback)

    @property
    def is_running(self) -> bool:
        """Whether its processes have started."""
        return self._processes is not None

    def processes(self, most: int) -> ProcessPool:
        """The processes; if this starts them, `most` at most."""
        # asyncio and pebble: not where nothing is to run
        from trajopt.benchmark.run import workers

        if self._processes is None:
            self._open.enter_context(single_threaded())
            pool = workers.pool_of(min(self.jobs, most))
            self._processes = self._open.enter_context(pool)
        return self._processes

    def submit(self, job: Callable[[], None]) -> Future[None]:
        """Do something that can be pickled, after what was submitted before."""
        from trajopt.benchmark.run import workers

        return workers.submit(self.processes(self.jobs), job)
