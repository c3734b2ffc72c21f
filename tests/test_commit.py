"""Which commit an installation was built from: trials state it, whatever the way of installing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from trajopt.benchmark.commit import commit

ROOT = Path(__file__).parents[1]
SOURCES = (
    *("pyproject.toml", "README.md", "LICENSE", "trajopt", "baselines", "data/literature"),
    "docs/examples/best-known",
)
WRITES = "import trajopt.benchmark.provenance as p; print(p.__file__, p.provenance()['commit'])"
CACHES = shutil.ignore_patterns("__pycache__")

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")


def done(*command, cwd):
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    run = subprocess.run(command, cwd=cwd, capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout.strip()


def git(folder, *arguments):
    own = ("-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "commit.gpgsign=false")
    return done("git", *own, *arguments, cwd=folder)


def built(folder, kind):
    """Build a wheel or an sdist of a folder; return it."""
    done(sys.executable, "-m", "hatchling", "build", "-t", kind, cwd=folder)
    (made,) = (folder / "dist").glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return made


def said(wheel, place):
    """Install a wheel into a folder; return the commit that trials of it state."""
    pip = ("pip", "install", "--quiet", "--no-index", "--no-deps", "--target", str(place))
    done(sys.executable, "-m", *pip, str(wheel), cwd=wheel.parent)
    here = f"import sys; sys.path.insert(0, {str(place)!r}); "
    file, found = done(sys.executable, "-P", "-c", here + WRITES, cwd=wheel.parent).split()
    assert Path(file).is_relative_to(place)
    return found


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A repository with this package's sources, and its only commit."""
    folder = tmp_path_factory.mktemp("clone")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=CACHES)
        else:
            shutil.copy(ROOT / name, folder)
    (folder / ".gitignore").write_text("dist/\n")
    git(folder, "init", "--quiet")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "-m", "all")
    return folder, git(folder, "rev-parse", "HEAD")


def test_a_wheel_from_a_clone_says_its_commit(clone, tmp_path):
    folder, head = clone
    assert said(built(folder, "wheel"), tmp_path) == head


@pytest.mark.long
def test_a_wheel_from_an_sdist_says_what_the_sdist_was_built_from(clone, tmp_path):
    folder, head = clone
    with tarfile.open(built(folder, "sdist")) as archive:
        archive.extractall(tmp_path, filter="data")
    (unpacked,) = tmp_path.iterdir()
    assert not (unpacked / ".git").exists()
    # who packages it for another system may keep it in a repository of their own
    git(unpacked, "init", "--quiet")
    git(unpacked, "add", ".")
    git(unpacked, "commit", "--quiet", "-m", "imported")
    assert said(built(unpacked, "wheel"), tmp_path / "installed") == head


def test_a_checkout_says_its_commit_and_whether_it_was_changed(clone, tmp_path):
    folder, head = clone
    shutil.copytree(folder, tmp_path / "own")
    assert commit(tmp_path / "own") == head
    (tmp_path / "own" / "README.md").write_text("changed")
    assert commit(tmp_path / "own") == f"{head}-dirty"


def test_a_folder_of_sources_without_git_says_nothing(clone, tmp_path):
    folder, _ = clone
    shutil.copytree(folder / "trajopt", tmp_path / "trajopt")
    assert commit(tmp_path) == ""
