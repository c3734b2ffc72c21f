"""The lines of MATLAB on the page read the motion that is certified. Octave runs them."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trials import PROBLEM, Stopping

from trajopt.benchmark.store.folder import read, save
from trajopt.benchmark.trial import trials_of

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "results-h5.md"
# MATLAB's function, which Octave lacks: dimensions in reverse, counted from 1, Inf to the end.
H5READ = """
function data = h5read(file, name, start, count)
  system(sprintf("%s read.py '%s' '%s' '%s' '%s'", PYTHON, file, name, ...
    mat2str(start), mat2str(count)));
  data = load('read.mat').data;
end
"""
READ = """
import sys
import h5py
from scipy.io import savemat
file, name, start, count = sys.argv[1:]
def numbers(text):
    return [float(number) for number in text.strip("[]").split()]
rows = []
for first, size in zip(numbers(start), numbers(count)):
    end = None if size == float("inf") else int(first - 1 + size)
    rows.append(slice(int(first) - 1, end))
data = h5py.File(file)[name]
if data.dtype.kind == "O":
    data = data.asstr()[:].astype(object)
values = data[tuple(rows[::-1])].T
savemat("read.mat", {"data": values[:, None] if values.ndim == 1 else values})
"""
PLOT = """
function plot(t, y)
  drawn = [t(:) y(:)];
  save('-ascii', '-double', 'drawn', 'drawn');
end
"""


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs Octave")
def test_five_lines_of_matlab_plot_the_certified_position(tmp_path):
    (lines,) = re.findall(r"```matlab\n(file = \'results/.*?)```", PAGE.read_text("utf-8"), re.S)
    (tmp_path / "results").mkdir()
    plain = replace(PROBLEM, name="two joints")  # the stand-in for h5read knows no other letters
    (made,) = trials_of(Stopping(0.5), plain, [3], "stopping")
    (trial,) = read(save(tmp_path / "results" / "results.h5", made))
    (tmp_path / "h5read.m").write_text(H5READ.replace("PYTHON", f"'{sys.executable}'"))
    (tmp_path / "read.py").write_text(READ)
    (tmp_path / "plot.m").write_text(PLOT)
    (tmp_path / "page.m").write_text(f"{lines}\n", encoding="utf-8")
    command = ["octave-cli", "--no-init-file", "--quiet", "page.m"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    times, positions = np.loadtxt(tmp_path / "drawn").T
    certified = trial.certified_trajectory
    assert times[-1] == pytest.approx(trial.certified_duration, rel=1e-12)
    assert len(times) == 500
    np.testing.assert_allclose(positions, certified(times)[:, 0], atol=1e-12)
