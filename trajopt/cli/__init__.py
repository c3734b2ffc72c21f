"""The command line."""

from __future__ import annotations


def main(arguments: list[str] | None = None) -> None:
    """Run a command; `arguments` are those of the process by default."""
    # here: worker processes import the script that calls this, and need no command line
    from trajopt.cli.app import main as run

    run(arguments)
