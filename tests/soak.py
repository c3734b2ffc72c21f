"""Attacks and timings that take minutes, on demand.

    python tests/soak.py                     # lists their questions
    python tests/soak.py tricks --quick      # runs one, in small; `--help` says its options

Each is a module of `soaks`, whose tests run it in small.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import cyclopts

from experiments.__main__ import questions

COMMAND = "python tests/soak.py "


def main(name: str = "", *arguments: str) -> None:
    """Run a soak with its arguments, or list all."""
    known = questions(Path(__file__).with_name("soaks"), COMMAND)
    if name in known:
        app = cyclopts.App(name=f"{COMMAND}{name}", result_action="return_value")
        app.default(import_module(f"soaks.{name}").main)
        app(list(arguments))
        return
    for own, question in known.items():
        print(f"{COMMAND}{own:<16} {question}")
    if name:
        sys.exit(f"no soak is called {name!r}")


if __name__ == "__main__":
    main(*sys.argv[1:])
