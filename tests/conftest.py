"""One thread for each test process: the tests run in as many processes as there are cores."""

import os

# Read once, when NumPy is imported: before any test module.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
