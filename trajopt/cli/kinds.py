"""Name a file of the wrong kind for what it is: `robot.urdf is a URDF; expected …`.

A file's kind is guessed only after its reader has refused it: no file is refused by a guess.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trajopt.core import files
from trajopt.core.exceptions import TrajoptError
from trajopt.core.out_of_scope import out_of_scope
from trajopt.formats.arrays import NO_MOTION
from trajopt.formats.csv_file import ABOVE
from trajopt.formats.samples_csv import READABLE

_LOOKED_AT = 1 << 16  # bytes from the beginning of a file that are examined

# A pattern in the beginning of a file, and the kind of file that it shows; the first match counts.
_SIGNS = {
    r"\A\s*\Z": "an empty file",
    r'\A\{\s*"schema": "trajopt-': "a trial's file",
    r"\A\x89HDF": "an HDF5 file",
    r"(?i)\A\s*<(!doctype )?html\b": "an HTML page",
    r"\A(\x89PNG|\xff\xd8\xff|GIF8|%PDF)|<svg\b": "a picture",
    r"\A\x93NUMPY": "a NumPy array",
    r"\APK[\s\S]{0,200}\.npy": "a NumPy archive",
    r"\APK": "a spreadsheet",
    r"\0": "a binary file",
    r"(?m)^\s*(PTP|LIN|DEF) |MoveAbsJ|^\s*MODULE \w|\bmove[jl]\(": "a robot program",
    r"<robot\b": "a URDF",
    r"\A\s*<": "an XML file",
    r"""(?m)^[ "'{]*(joint_limits|default_(velocity|acceleration)_scaling_factor)["']?\s*:""": (
        "a joint_limits.yaml"
    ),
    r"(?m)^ *[\w$(){}. -]+:\s*$\n +(lower|upper|velocity|effort)\s*:": (
        "a table of a robot description package"
    ),
    r"(?m)^ *cartesian_limits\s*:": "a pilz_cartesian_limits.yaml",
    r"""(?m)^[ "'{-]*(joint_names|points|trajectory|position)["']?\s*:""": "a ROS message",
    r"""["'](time_from_start|joint_trajectory|joint_names)["']\s*:""": "a ROS message",
    r"""["'](breaks|coefficients)["']\s*:""": "a motion of polynomials",
    r"""["']waypoints["']\s*:|\A\s*\[\s*\[\s*[-\d.]""": "a JSON file of waypoints",
    r"\A\s*(\{|\[\s*[\"{\d-])": "a JSON file of another kind",
    r"(?m)^```": "a Markdown file",
    r"(?m)^(import|from|def|class) \w": "a Python file",
    r"(?m)^\s*(way_?points?\b|\[limits|units\b|angle_unit)": "a problem file",
    r"(?m)^(\[[\w.\"' -]+\]|[\w.\"-]+\s*=)": "a TOML file of another kind",
    r"(?m)^[\w/]+:( |$)": "a YAML file of another kind",
    r"(?i)\A\W*([\w./]*(time|stamp)[\w.]*|t|secs?)\b[^\n]*[,;\t ]|\A[^\n]*\[[mun]?s\]": (
        "a CSV of a motion"
    ),
    r"(?m)^ *[-+\d.][-+\d.eE,;\t ]*$": "a CSV of waypoints",
}

# The kinds of file that are taken, and what would be right.
_PROBLEM = (
    "expected a problem file (.toml), a built-in name, or waypoints: give limits with --urdf, "
    "--limits or --robot"
)
_ROWS = "expected waypoints, a row of joint positions each (.csv, .txt, .npy, .json)"
_TEXTS = (".csv", ".txt")  # endings of tables, whose text may look like another language's
_LANGUAGES = (
    "a YAML file of another kind",
    "a TOML file of another kind",
    "a ROS message",
    "a problem file",
)
_ARRAYS = ("a NumPy array", "a NumPy archive", "a JSON file of another kind")
_WANTED = {
    "problem": (("a problem file",), _PROBLEM),
    "waypoints": (
        ("a CSV of waypoints", "a JSON file of waypoints", "a NumPy array", "a problem file"),
        _ROWS,
    ),
    "stated problem": (
        ("a problem file",),
        "expected a problem file (.toml), which `trajopt new` writes, or a built-in name",
    ),
    "motion": (
        (
            "a CSV of a motion",
            "a ROS message",
            "a motion of polynomials",
            "a trial's file",
        ),
        "expected a motion: a CSV with a column of times, a ROS message, arrays (.npz, .json), or "
        "polynomials (.json)",
    ),
    "targets": (
        (
            *("a CSV of a motion", "a CSV of waypoints", "a JSON file of waypoints"),
            *(*_ARRAYS, "an HDF5 file", "a binary file"),
        ),
        "expected targets, or recorded episodes: .csv, .npz, .npy, .json, .parquet, .hdf5, .mcap",
    ),
    "--urdf": (("a URDF",), "expected a URDF behind --urdf"),
    "--limits": (("a joint_limits.yaml",), "expected a joint_limits.yaml behind --limits"),
    "limits": (
        ("a problem file", "a joint_limits.yaml"),
        "expected a joint_limits.yaml behind --limits, or the name of a robot or a problem",
    ),
    "results": (
        ("an HDF5 file", "a folder", "a trial's file"),
        "expected results: a folder that `trajopt compare` has filled, or its results.h5",
    ),
}
# Advice for files of known kinds that are in the wrong place.
_PLACES = {
    "a URDF": "a URDF goes behind --urdf",
    "a CSV of a motion": "`trajopt judge MOTION PROBLEM` takes the motion first",
    "a joint_limits.yaml": (
        "`trajopt verify MOTION --limits FILE` judges a motion by its limits alone"
    ),
    "a pilz_cartesian_limits.yaml": out_of_scope("cartesian_limits"),
    "a spreadsheet": "save the sheet as CSV",
    "a robot program": (
        "robot programs are not read: write the joint positions of its moves as a CSV, a row each"
    ),
    "a table of a robot description package": (
        "its limits are in the URDF made of it, which goes behind --urdf"
    ),
}
# Advice for a file (second word) in the place of another kind (first word).
_PLACES_WANTED = {
    ("waypoints", "a CSV of a motion"): (
        "remove the column of times to plan through its positions; `trajopt judge MOTION PROBLEM` "
        "judges the motion"
    ),
    ("waypoints", "a NumPy archive"): "np.save writes the rows of one array as a .npy",
    ("waypoints", "a JSON file of another kind"): "a list of rows of numbers is one",
    ("motion", "a NumPy array"): "np.savez('log.npz', t=a[:, 0], q=a[:, 1:]) names its columns",
    ("motion", "a CSV of waypoints"): "`trajopt plan` plans through points without times",
}


def kind(path: Path) -> str:
    """Return what a file is, in words; empty if nothing tells."""
    if path.is_dir():
        return "a folder"
    if not path.is_file():
        return ""
    with files.opened(path) as file:
        read = file.read(_LOOKED_AT)
    encoding = "utf-16" if files.is_utf_16(read) else "latin-1"
    beginning = read.decode(encoding, errors="ignore").removeprefix("\xef\xbb\xbf")
    found = (name for sign, name in _SIGNS.items() if re.search(sign, beginning))
    if path.suffix in _TEXTS:
        found = (name for name in found if name not in _LANGUAGES)
    return next(found, "")


@contextmanager
def reading(path: Path | str, wanted: str) -> Iterator[None]:
    """Read a file in this context: an error then tells if it is a file of another kind.

    Args:
        path: The file; a name that is no file's is left to its reader.
        wanted: "problem" or, with a robot's flags, "waypoints"; "stated problem" where no flags
            are taken; "motion", "targets", "--urdf", "--limits", "limits" (by name too), "results".

    Raises:
        TrajoptError: The reader's own error for a file that looks right, else one with its kind.
    """
    try:
        yield
    except TrajoptError as error:
        right, sentence = _WANTED[wanted]
        found = kind(Path(path)) if Path(path).exists() else ""
        if not found or found in right or ABOVE in str(error):
            raise
        if wanted == "motion" and found in _ARRAYS and NO_MOTION not in str(error):
            raise
        _, known, header = str(error).partition(READABLE)
        if not known:
            _, known, header = str(error).partition(NO_MOTION)
        place = _PLACES_WANTED.get((wanted, found), _PLACES.get(found, ""))
        words = [f"{path} is {found}", sentence, place, known + header]
        raise TrajoptError("; ".join(filter(None, words))) from None
