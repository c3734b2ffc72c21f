"""The commit of this code: asked of git in a checkout, written down where a package is built.

`pyproject.toml` names this file as a hook of hatchling: a wheel or an sdist that is built from a
checkout holds `commit.txt`, and one that is built from such an sdist keeps it. Both the package and
the build run this file, so it needs the standard library alone.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

FILE = "trajopt/benchmark/commit.txt"


def commit(root: Path) -> str:
    """Return the commit that the code in a folder was made from; empty where nobody knows.

    Args:
        root: The folder above the package `trajopt`. What was written down there counts; in a
            checkout git is asked, and `-dirty` follows the commit if files were changed.
    """
    written = root / FILE
    if written.is_file():
        return written.read_text(encoding="utf-8").strip()
    if not (root / ".git").exists():
        return ""
    describe = ["describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    command = ["git", "-C", str(root), *describe]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


def get_build_hook() -> type[Any]:
    """Return the hook of hatchling that puts `commit.txt` into wheels and sdists."""
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface

    class Commit(BuildHookInterface[Any]):
        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            found = commit(Path(self.root))
            if version == "editable" or not found or Path(self.root, FILE).exists():
                return
            self.folder = TemporaryDirectory()  # gone with this object, after the build
            file = Path(self.folder.name, "commit.txt")
            file.write_text(f"{found}\n", encoding="utf-8")
            build_data["force_include"][str(file)] = FILE

    return Commit
