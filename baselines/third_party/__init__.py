"""Other people's planners, one file each, used as their documentation has it.

Each is an extra of this package (`pip install "trajopt[rivals]"` for all), runs on request, and is
judged as every other planner is.
"""

from __future__ import annotations

import time
from typing import Any

from trajopt.planner import backend


def imported(name: str, extra: str) -> tuple[Any, float]:
    """A module, and the seconds that importing it took, which are setup and not solving.

    Raises:
        MissingBackend: It is not installed; the message names the extra.
    """
    began = time.perf_counter()
    module = backend(name, extra)
    return module, time.perf_counter() - began
