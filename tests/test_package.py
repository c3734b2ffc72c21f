"""The distribution: what the base needs, and that every extra that an error names exists."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
BASE_OF_VERIFY = {"numpy", "scipy"}
NAME = re.compile(r"[\w-]+")
EXTRA = re.compile(r'(?:backend\("[\w.]+", |MissingBackend\("[\w.]+", |^    extra = )"(\w+)"', re.M)
VERIFY = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Blocked())
from trajopt import Limits, Problem, Trajectory, verify

problem = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))
motion = Trajectory.from_samples([0.0, 2.0], [[0.0], [1.0]], [[0.0], [0.0]])
print(verify(problem, motion).certified_duration)
"""


def modules(requirements):
    """Return the modules that these requirements install, as they are imported."""
    renamed = {"pyyaml": "yaml", "tomli-w": "tomli_w", "ruckig": "ruckig"}
    names = {NAME.match(requirement)[0] for requirement in requirements}
    return {renamed.get(name, name) for name in names}


def test_verify_needs_numpy_and_scipy_only():
    everything = set(PROJECT["dependencies"]) | set(PROJECT["optional-dependencies"]["report"])
    blocked = modules(everything | {"pyyaml", "cma"}) - BASE_OF_VERIFY
    script = VERIFY.format(blocked=blocked)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    # Peak acceleration of a cubic from rest to rest: 6 h / T² = 1.5, so the dilation is √1.5.
    assert abs(float(done.stdout) - 2 * 1.5**0.5) < 1e-12


def test_a_package_overwritten_by_the_other_trajopt_is_one_line(tmp_path):
    package = tmp_path / "trajopt"
    package.mkdir()
    other = f"__path__.append({str(ROOT / 'trajopt')!r})"  # its own file, our folders
    (package / "__init__.py").write_text(other, encoding="utf-8")
    script = "from trajopt.cli import main; main(['list'])"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert re.fullmatch(r"trajopt: .*\(pip uninstall trajopt\).*\n", done.stderr)


def test_every_extra_that_an_error_names_exists():
    named = set()
    for folder in ("trajopt", "baselines"):
        for path in (ROOT / folder).rglob("*.py"):
            named |= set(EXTRA.findall(path.read_text(encoding="utf-8")))
    assert {"report", "ros", "cma", "cluster", "parquet"} <= named
    assert named <= set(PROJECT["optional-dependencies"])


def test_the_version_is_in_one_place():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {PROJECT['version']}\n" in citation


ALONE = """
import sys

class Only:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in LACKING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Only())
import trajopt
from trajopt.planners.registry import load

problem = trajopt.Problem([[0.0], [1.0], [2.0], [3.0]], trajopt.Limits([10.0], [4.0]))
for name in ("exact", "exact-jerk", "spline353-nlp", "pso", "de"):
    answer = load(name).solve(problem)
    assert trajopt.verify(problem, answer.trajectory).valid, name
assert abs(trajopt.judge(problem, trajopt.plan(problem).solution.trajectory).gap) < 1e-6
"""


def test_judging_and_planning_need_numpy_and_scipy_alone():
    """As the page on installing says."""
    lacking = {NAME.match(line)[0].replace("-", "_") for line in PROJECT["dependencies"]}
    code = ALONE.replace("LACKING", repr(lacking - BASE_OF_VERIFY))
    subprocess.run([sys.executable, "-c", code], check=True)
