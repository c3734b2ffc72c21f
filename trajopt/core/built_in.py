"""The data files that travel with the package, by name."""

from __future__ import annotations

from functools import cache
from pathlib import Path


@cache
def data_folder() -> Path:
    """The folder of the data files: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    if is_installed():
        return package / "data"
    return package.parent / "data"


def listed() -> Path:
    """The file that describes what travels with the package, for `trajopt list`."""
    return data_folder() / "listed.json"


@cache
def is_installed() -> bool:
    """Return whether the package was installed from a wheel; False in a checkout."""
    return (Path(__file__).resolve().parents[1] / "data").is_dir()


@cache
def files(folder: str) -> dict[str, Path]:
    """Every TOML file of a data folder by its stem, in alphabetical order."""
    found = sorted((data_folder() / folder).glob("*.toml"))
    return {file.stem: file for file in found}
