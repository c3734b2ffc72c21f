"""What every test process and its children share."""

import gc
import os
import sys
import tempfile

import pytest

# One thread each: the tests run in as many processes as there are cores. Read once, when NumPy is
# imported: before any test module.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# Children find modules compiled, as Python does unless told otherwise: hundreds of them start here.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


# Verdicts of tests stay out of the user's cache.
os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="mintime-cache-")

# What imports make, they keep: looking for garbage among it is in vain.
gc.disable()


def pytest_collection_finish() -> None:
    """Set aside what the imports left: each full collection would walk through all of it again."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def _no_word_of_slow_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command prints must not depend on how fast the machine is."""
    monkeypatch.setattr("trajopt.cli.console._SILENT_S", 1e6)
    monkeypatch.setattr("trajopt.benchmark.run.progress.LOG_INTERVAL_S", 1e6)


@pytest.fixture
def strangers(monkeypatch):
    """Make the kinds of limits of `tests.kinds` known."""
    from tests.kinds import STRANGERS
    from trajopt.core.limits import KINDS

    for key, kind in STRANGERS.items():
        monkeypatch.setitem(KINDS, key, kind)
