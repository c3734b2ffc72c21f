"""List the questions of all experiments: `python -m experiments`."""

from __future__ import annotations

import ast
from pathlib import Path

FOLDER = Path(__file__).parent


def questions(folder: Path = FOLDER, command: str = "python -m experiments.") -> dict[str, str]:
    """Return the first line of every command's docstring, by its module's name.

    Args:
        folder: The modules'. A module is a command if its docstring says how it is run.
        command: What stands before the module's name when it is run.
    """
    found = {}
    for file in sorted(folder.glob("[a-z]*.py")):
        said = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))
        if said and f"{command}{file.stem}" in said:
            found[file.stem] = said.splitlines()[0]
    return found


if __name__ == "__main__":
    for name, question in questions().items():
        print(f"python -m experiments.{name:<16} {question}")
