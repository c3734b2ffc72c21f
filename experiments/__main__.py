"""List the questions of all experiments: `python -m experiments`."""

from __future__ import annotations

import ast
from pathlib import Path

FOLDER = Path(__file__).parent


def questions() -> dict[str, str]:
    """The first line of every command's docstring, by the module's name."""
    found = {}
    for folder in (FOLDER, FOLDER / "soaks"):
        for file in sorted(folder.glob("[a-z]*.py")):
            text = file.read_text(encoding="utf-8")
            said = ast.get_docstring(ast.parse(text))
            if said and "python -m experiments" in said and '__name__ == "__main__"' in text:
                path = file.relative_to(FOLDER.parent).with_suffix("")
                found[".".join(path.parts)] = said.splitlines()[0]
    return found


if __name__ == "__main__":
    for name, question in questions().items():
        print(f"python -m {name:<36} {question}")
