"""Objectives with known minima, for everything that minimises in a box."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

LOW = np.zeros(3)
HIGH = np.full(3, 4.0)
CENTRE = np.array([0.3, 1.7, 3.2])


def sphere(x):
    """Least, 0, at `CENTRE`; its sum in a fixed order, whatever the number of rows."""
    d = x - CENTRE
    return d[..., 0] ** 2 + d[..., 1] ** 2 + d[..., 2] ** 2


class Recorded:
    """An objective that remembers what it was asked and what it answered."""

    def __init__(self, function=sphere):
        self.function, self.x, self.f = function, [], []

    def __call__(self, x):
        f = self.function(x)
        self.x.append(x.copy())
        self.f.append(f.copy())
        return f


def digest(result):
    """Of all that a minimisation returned, bit for bit."""
    arrays = [result.position, result.fitness, *result.histories]
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def said_elsewhere(*lines):
    """What another process prints that runs these lines; it may import this module."""
    here = str(Path(__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        env=os.environ | {"PYTHONPATH": here},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout
