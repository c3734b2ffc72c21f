"""The code that ran: which distribution, which version, and a digest of its sources.

A trial's identity contains that digest, so an edited planner never shows what it answered before.
What is digested depends on where the code lies:

- installed from a wheel: the distribution's version, and the module's own file;
- a package that is not (an editable install, a checkout): every source of the package;
- a script: its file, and the modules beside it that it imports;
- a notebook, or a text given to `exec`: the compiled functions of the class, and of whatever they
  use of the notebook.

This package belongs to every digest, since it judges: of a checkout the modules that can change a
trial, not those that only show it.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import platform
import re
import site
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import (
    Distribution,
    PackageNotFoundError,
    distribution,
    packages_distributions,
    version,
)
from numbers import Integral, Real
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from trajopt.core.exceptions import InvalidInput
from trajopt.core.harmless import harmless
from trajopt.planners.planner import Planner
from trajopt.planners.registry import entries

PACKAGES = ("trajopt", "numpy", "scipy", "casadi", "toppra", "ruckig", "highspy", "h5py")

_OURS = ("trajopt", "baselines")
# No trial depends on these files, except on `_JUDGES`.
_SHOWS_ONLY = ("trajopt/cli/", "trajopt/comparison.py", "trajopt/views/", "trajopt/benchmark/")
_JUDGES = ("trajopt/benchmark/trial.py",)
_SOURCES = (".py", ".so", ".pyd")
_SHORT_ARRAY = 100  # values that an option shows before it shows their digest instead
_CPU_MODEL = re.compile(r"^model name\s*:\s*(?P<name>\S.*)$", re.MULTILINE)
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")


@dataclass(frozen=True)
class Code:
    """The code of a planner; empty where a script belongs to no distribution."""

    distribution: str
    version: str
    digest: str

    def as_dict(self) -> dict[str, str]:
        """As a trial's provenance has it."""
        return {
            "planner_distribution": self.distribution,
            "planner_version": self.version,
            "planner_digest": self.digest,
        }


@cache
def provenance() -> dict[str, str]:
    """Versions of this package and of every solver, the code that judges, and the machine."""
    versions = {name: _version(name) for name in PACKAGES}
    return versions | {
        "python": platform.python_version(),
        "commit": _commit(),
        "sources": _installed_sources(),
        "judge_digest": _ours(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "cpu": _processor(),
    }


def code_of(planner: Planner) -> Code:
    """The code that runs when this planner does: its own, its bases', its nested options', ours."""
    own = type(planner)
    parts: dict[str, str] = {}
    for cls in _classes(planner):
        name = f"{cls.__module__}.{cls.__qualname__}"
        parts[name] = _digest(cls)
    identity = [own.__qualname__, sorted(parts.values()), _ours()]
    released = _release(own.__module__)
    return Code(released.name, released.version, digest=_sha(json.dumps(identity)))


def plain(value: Any, option: str = "option") -> Any:
    """An option's value as JSON can say it, whole: two that differ stay different.

    Raises `InvalidInput` for an object whose text does not say what it holds.
    """
    if isinstance(value, str):
        return harmless(value)
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, Enum):
        return f"{type(value).__name__}.{value.name}"
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if isinstance(value, np.ndarray):
        return _plain_array(value)
    if isinstance(value, Mapping):
        return {harmless(str(key)): plain(item, option) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, option) for item in value]
    if isinstance(value, set | frozenset):
        return sorted((plain(item, option) for item in value), key=repr)
    if isinstance(value, type | FunctionType):
        name = f"{value.__module__}.{value.__qualname__}"
        return f"{name} {_digest(value)[:12]}"
    if is_dataclass(value):
        table = {"class": type(value).__qualname__}
        for field in fields(value):
            item = getattr(value, field.name)
            table[field.name] = plain(item, option)
        return table
    text = str(value)
    if _ADDRESS.search(text):
        right = "a number, a text, an array, a collection of these, or what says all as text"
        raise InvalidInput(option, right, value=text)
    return harmless(text)


def _plain_array(array: np.ndarray[Any, Any]) -> Any:
    if array.size <= _SHORT_ARRAY:
        return plain(array.tolist())
    numbers = _sha(array.tobytes())
    return f"array {array.shape} {array.dtype.str} {numbers}"


def _classes(planner: Planner) -> Iterator[type]:
    """The classes whose code runs: of the planner, of its nested options, and their bases."""
    waiting: list[object] = [planner]
    while waiting:
        value = waiting.pop()
        for cls in type(value).__mro__:
            if not _is_standard(cls):
                yield cls
        if is_dataclass(value):
            waiting += [getattr(value, field.name, None) for field in fields(value)]


def _is_standard(cls: type) -> bool:
    package = cls.__module__.partition(".")[0]
    if package == "__main__":
        return False
    if package == "builtins":  # also of a class that `exec` made where no module was named
        return "__module__" not in vars(cls)
    return package in sys.stdlib_module_names


def _digest(cls: type | FunctionType) -> str:
    """Of the sources that a class or a function comes from, and of what it was made with."""
    module = sys.modules.get(cls.__module__)
    file = None if module is None else _file(module)
    if module is None or file is None:
        compiled = list(_compiled(cls, set()))
        return _sha(json.dumps(compiled))
    sources = _sources(module.__name__)
    made_by_a_function = "<locals>" in cls.__qualname__  # perhaps with values of its own
    if made_by_a_function or _is_executed_text(cls):
        compiled = list(_compiled(cls, set()))
        return _sha(json.dumps([sources, *compiled]))
    return sources


def _is_executed_text(value: type | FunctionType) -> bool:
    """Whether `exec` made it of a text, which the file of its module need not hold."""
    members = vars(value) if isinstance(value, type) else {value.__name__: value}
    waiting: list[Any] = []
    for name, member in members.items():
        if not name.startswith("__"):  # as those that `dataclass` made, by `exec` too
            waiting += _functions(member)
    seen: set[int] = set()
    while waiting:
        function = waiting.pop()
        if not isinstance(function, FunctionType) or id(function) in seen:
            continue
        seen.add(id(function))
        if not Path(function.__code__.co_filename).is_file():
            return True
        waiting += _enclosed(function)
    return False


@cache
def _sources(name: str) -> str:
    """A digest of the sources of a module: see the top of this file."""
    module = sys.modules[name]
    file = _file(module)
    if file is None:
        return ""
    package = (module.__package__ or "").partition(".")[0]
    if package in _OURS:
        return _ours()
    if _is_installed(file):
        release = " ".join(_release(name)).strip()
        return _sha(f"{release} {_sha(file.read_bytes())}")
    if not package:
        return _sha_of({path.name: path for path in _script(file)})
    sources: dict[str, Path] = {}
    for folder in sys.modules[package].__path__:
        root = Path(folder)
        sources |= _named(_files(root), root)
    return _sha_of(sources)


@cache
def _ours() -> str:
    """This package: its version, and where it is a checkout the sources that a trial depends on."""
    root = Path(__file__).resolve().parents[2]
    if _is_installed(Path(__file__)):
        return _version("trajopt")
    sources: dict[str, Path] = {}
    for package in _OURS:
        sources |= _named(_files(root / package), root)
    deciding = {name: path for name, path in sources.items() if _decides(name)}
    return _sha_of(deciding)


def _named(files: list[Path], root: Path) -> dict[str, Path]:
    """Files by their paths below a folder."""
    return {file.relative_to(root).as_posix(): file for file in files}


def _decides(name: str) -> bool:
    """Whether a module of ours can change a trial."""
    return name in _JUDGES or not name.startswith(_SHOWS_ONLY)


def _files(folder: Path) -> list[Path]:
    paths = sorted(folder.rglob("*"))
    return [path for path in paths if path.suffix in _SOURCES]


def _script(file: Path) -> list[Path]:
    """A script and the modules beside it that it imports, theirs too."""
    found: dict[Path, None] = {}
    waiting = [file]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found[path] = None
        for name in _imported(path):
            waiting += _beside(file.parent, name)
    return sorted(found)


def _beside(folder: Path, name: str) -> list[Path]:
    module = folder / f"{name}.py"
    if module.is_file():
        return [module]
    package = folder / name
    if package.is_dir():
        return _files(package)
    return []


def _imported(path: Path) -> set[str]:
    """Top-level names of the modules that a source imports, wherever in it."""
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):  # not Python: compiled
        return set()
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.partition(".")[0])
    return names


def _compiled(value: Any, seen: set[int]) -> Iterator[Any]:
    """What a class or a function does, where there is no file to say so: as compiled.

    Follows what it uses of its own module, and the values that it was made with.
    """
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, type):
        for name, member in sorted(vars(value).items()):
            for function in _functions(member):
                yield name
                yield from _compiled(function, seen)
            if isinstance(member, str | int | float | tuple | list):
                yield [name, repr(member)]
    elif isinstance(value, FunctionType):
        yield from _instructions(value.__code__)
        yield repr((value.__defaults__, value.__kwdefaults__))
        for used in _used(value):
            yield from _compiled(used, seen)
    elif isinstance(value, np.ndarray):
        yield _plain_array(value)
    elif not isinstance(value, ModuleType):
        yield _ADDRESS.sub("", repr(value))


def _functions(member: Any) -> list[FunctionType]:
    if isinstance(member, property):
        member = member.fget
    member = getattr(member, "__func__", member)  # static and class methods
    return [member] if isinstance(member, FunctionType) else []


def _instructions(code: CodeType) -> Iterator[Any]:
    yield [code.co_code.hex(), code.co_names, code.co_varnames]
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _instructions(constant)
        elif isinstance(constant, frozenset):
            yield sorted(map(repr, constant))
        else:
            yield repr(constant)


def _used(function: FunctionType) -> Iterator[Any]:
    """What a function uses of its module's own names, and of the function that made it."""
    for name in _names(function.__code__):
        value = function.__globals__.get(name)
        own = getattr(value, "__module__", function.__module__) == function.__module__
        if value is not None and own:
            yield value
    yield from _enclosed(function)


def _enclosed(function: FunctionType) -> Iterator[Any]:
    """What a function uses of the functions around it."""
    for cell in function.__closure__ or ():
        try:
            yield cell.cell_contents
        except ValueError:  # not set yet
            continue


def _names(code: CodeType) -> list[str]:
    nested = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    names = list(code.co_names)
    for inner in nested:
        names += _names(inner)
    return names


def _file(module: ModuleType) -> Path | None:
    """The module's source file, where there is one: not of a notebook, nor of standard input."""
    name = getattr(module, "__file__", None)
    if name is None or not Path(name).is_file():
        return None
    return Path(name).resolve()


def _is_installed(file: Path) -> bool:
    """Whether it lies where installed packages do, and not in somebody's own tree."""
    paths = [sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
    paths += [*site.getsitepackages(), site.getusersitepackages()]
    return any(file.is_relative_to(Path(path).resolve()) for path in paths)


class _Release(NamedTuple):
    """An installed distribution and its version; empty for what belongs to none."""

    name: str
    version: str


@cache
def _release(module: str) -> _Release:
    """The distribution that a module belongs to; its metadata, a README in it, is parsed once."""
    package = module.partition(".")[0]
    if package in _OURS and module != "trajopt":
        return _release("trajopt")
    found = _distribution(module)
    return _Release("", "") if found is None else _Release(found.name, found.version)


def _distribution(module: str) -> Distribution | None:
    """The installed distribution that a module belongs to."""
    package = module.partition(".")[0]
    if package in _OURS:
        package = "trajopt"
    for entry in entries().values():
        point = entry.point
        if point.module.partition(".")[0] == package and point.dist is not None:
            return point.dist
    if _is_script(module):
        return None
    try:
        return distribution(package)
    except PackageNotFoundError:
        names = _packages().get(package, [])
    return distribution(names[0]) if names else None


@cache
def _packages() -> Mapping[str, list[str]]:
    """The installed distributions of every package: their records of files are read, a second."""
    return packages_distributions()


def _is_script(module: str) -> bool:
    found = sys.modules.get(module)
    file = None if found is None else _file(found)
    package = "" if found is None else found.__package__
    return not package and (file is None or not _is_installed(file))


def _sha_of(files: Mapping[str, Path]) -> str:
    text = hashlib.sha256()
    for name in sorted(files):
        content = files[name].read_bytes()
        text.update(f"{name}\0{len(content)}\0".encode())
        text.update(content)
    return text.hexdigest()


def _sha(content: str | bytes) -> str:
    data = content.encode() if isinstance(content, str) else content
    return hashlib.sha256(data).hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _commit() -> str:
    """The commit of the checkout this runs from, marked if changed, or of the installed package.

    An installer writes down the commit of what it took from version control (PEP 610); of any other
    installed package it is empty, and `_installed_sources` tells which code it is.
    """
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return _installed_commit()
    describe = ["describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    command = ["git", "-C", str(root), *describe]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


def _installed_commit() -> str:
    origin = json.loads(_metadata("direct_url.json") or "{}")
    commit = origin.get("vcs_info", {}).get("commit_id", "")
    return str(commit)


def _installed_sources() -> str:
    """A digest of the installed modules, as their RECORD lists them; empty for a checkout."""
    if not _is_installed(Path(__file__)):
        return ""
    hashes = []
    for line in _metadata("RECORD").splitlines():
        path, _, rest = line.partition(",")
        if path.startswith(_OURS) and path.endswith(_SOURCES):
            hashes.append(f"{path},{rest}")
    return f"SHA-256 {_sha(json.dumps(sorted(hashes)))}"


def _metadata(file: str) -> str:
    """A file that the installer wrote beside this distribution; empty where it did not."""
    try:
        return distribution("trajopt").read_text(file) or ""
    except PackageNotFoundError:
        return ""


def _processor() -> str:
    """The processor's model, as Linux or else Python names it; perhaps empty."""
    try:
        described = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor()
    model = _CPU_MODEL.search(described)
    return model["name"] if model else platform.processor()
