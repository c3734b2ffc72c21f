"""docs/examples: the planner package builds, installs and keeps the contract; the UR5e is ours."""

from __future__ import annotations

import os
import re
import shutil
import site
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

from trajopt.formats import arms, urdf

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """An environment of its own that sees this one's packages, and the package copied beside it."""
    folder = tmp_path_factory.mktemp("example")
    shutil.copytree(EXAMPLES / "planner-package", folder / "package")
    home = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(home)], check=True)
    own = [sysconfig.get_path("purelib"), sysconfig.get_path("platlib"), *site.getsitepackages()]
    below = home / Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)
    lines = [f"import site; site.addsitedir({path!r})\n" for path in dict.fromkeys(own)]
    (below / "outer.pth").write_text("".join(lines), encoding="utf-8")
    python = home / "bin" / "python"
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    # hatchling is of the extra `test`: nothing is fetched
    offline = ["--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, *offline, str(folder / "package")], check=True, cwd=folder)
    return python, folder


def run(environment, *arguments, cwd=None):
    python, folder = environment
    command = [str(python), *arguments]
    variables = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=cwd or folder / "package" / "tests",
        env=variables,
        check=False,
    )


def test_the_package_is_known_by_name_and_its_own_tests_pass(environment):
    done = run(environment, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_chord_cubic.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout


@pytest.mark.long
def test_the_commands_of_its_page_run(environment, tmp_path):
    page = (EXAMPLES / "planner-package" / "README.md").read_text(encoding="utf-8")
    for command in re.findall(r"^trajopt (.*?)  +#", page, re.M):
        done = run(environment, "-m", "trajopt.cli", *command.split(), cwd=tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "chord-cubic" in done.stdout


def test_the_examples_ur5e_is_the_built_in_one():
    drawn = urdf.read(EXAMPLES / "ur5e" / "ur5e.urdf")
    known = arms.named("ur5e")
    assert drawn.joint_names == known.joint_names
    for name in drawn.joint_names:
        for kind in ("velocity", "position"):
            assert np.allclose(drawn.joints[name][kind], known.joints[name][kind])
