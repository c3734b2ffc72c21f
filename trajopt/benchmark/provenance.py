"""The code that ran: which distribution, which version, and a digest of its sources.

A trial's identity contains that digest, so old answers are never shown for an edited planner. What
the digest covers depends on where the code is:

- installed from a wheel: the distribution's version, and the module's own file;
- in a package that is not (an editable install, a checkout): every source of the package;
- in a script: its file, and the modules beside it that it imports;
- in a notebook, or in a class made inside a function: the source of its functions, and of what they
  use from their own module and from the enclosing functions.

Code without a source, from `exec` or standard input, has a new digest in every process, so its
trials are never kept for the next run. A module that was edited after its import is refused, since
its source is not the code that runs. Every digest also covers the modules of this package that can
change a trial, since they judge it.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import linecache
import os
import platform
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.metadata import PackageNotFoundError, distribution, version
from numbers import Integral, Real
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np

from trajopt.benchmark.commit import commit
from trajopt.core.exceptions import InvalidInput
from trajopt.core.harmless import harmless
from trajopt.core.limits import KINDS
from trajopt.core.limits.strangers import is_ours
from trajopt.core.problem import Problem
from trajopt.planners.planner import Planner
from trajopt.planners.registry import entries

PACKAGES = ("mintime", "numpy", "scipy", "casadi", "toppra", "ruckig", "highspy", "h5py")

_OURS = ("trajopt", "baselines")
# No trial depends on these files, except on `_JUDGES`.
_SHOWS_ONLY = (
    "trajopt/cli/",
    "trajopt/comparison.py",
    "trajopt/judgement.py",
    "trajopt/best_planner.py",
    "trajopt/views/",
    "trajopt/benchmark/",
)
_JUDGES = ("trajopt/benchmark/trial.py",)
_SOURCES = (".py", ".so", ".pyd")
_SHORT_ARRAY = 100  # an array option with more values is stated by a digest
_CPU_MODEL = re.compile(r"^model name\s*:\s*(?P<name>\S.*)$", re.MULTILINE)
_CONSTANTS = (str, int, float, tuple, list)
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")


@dataclass(frozen=True)
class Code:
    """The code of a planner; empty where a script belongs to no distribution."""

    distribution: str
    version: str
    digest: str

    def as_dict(self) -> dict[str, str]:
        """Return the entries of a trial's provenance."""
        return {
            "planner_distribution": self.distribution,
            "planner_version": self.version,
            "planner_digest": self.digest,
        }


@cache
def provenance() -> dict[str, str]:
    """Return the versions of this package and its solvers, the judge's digest, the machine."""
    versions = {name: _version(name) for name in PACKAGES}
    return versions | {
        "python": platform.python_version(),
        "commit": commit(Path(__file__).resolve().parents[2]),
        "judge_digest": _ours(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "cpu": _processor(),
    }


def judge_digest(problem: Problem | None = None) -> str:
    """Return the digest of the code that judges a problem: ours, and that of strangers' limits.

    Without a problem: of all kinds of limits that this process has imported.
    """
    known = problem.limits.kinds if problem else KINDS
    kinds = [KINDS[key] for key in known]
    others = {own.key: _digest(own) for own in kinds if not is_ours(own)}
    ours = provenance()["judge_digest"]
    return _sha(json.dumps([ours, *sorted(others.items())])) if others else ours


def code_of(planner: Planner) -> Code:
    """Return the code of a planner: its own, its bases', its nested options', and ours."""
    linecache.checkcache()
    own = type(planner)
    parts: dict[str, str] = {}
    for cls in _classes(planner):
        name = f"{cls.__module__}.{cls.__qualname__}"
        parts[name] = _digest(cls)
    identity = [own.__qualname__, sorted(parts.values()), _ours()]
    released = _release(own.__module__)
    return Code(released.name, released.version, digest=_sha(json.dumps(identity)))


def plain(value: Any, option: str = "option") -> Any:
    """Return an option's value for JSON, such that different values stay different.

    Raises `InvalidInput` for an object whose text does not determine its value.
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
    """Return the classes whose code runs: the planner's, its nested options', their bases."""
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


def _digest(value: type | FunctionType) -> str:
    """Return the digest of the sources of a class or a function."""
    module = sys.modules.get(value.__module__)
    sources = ""
    if module is not None and _file(module) is not None:
        sources = _sources(module.__name__)
    in_file = all(map(_has_source, _functions(value).values()))
    if sources and in_file and "<locals>" not in value.__qualname__:
        return sources
    texts = list(_texts(value, set()))
    return _sha(json.dumps([sources, *texts]))


def _functions(value: type | FunctionType) -> dict[str, FunctionType]:
    """Return the functions of a class by name, or the function itself, without decorators."""
    members = vars(value) if isinstance(value, type) else {value.__name__: value}
    found = {}
    for name, member in members.items():
        if isinstance(member, property):
            member = member.fget
        inner: Any = getattr(member, "__func__", member)  # of static and class methods
        function = inspect.unwrap(inner) if callable(inner) else inner
        generated = name.startswith("__")  # as `dataclass` generates `__init__`
        if isinstance(function, FunctionType) and not generated:
            found[name] = function
    return found


def _has_source(function: FunctionType) -> bool:
    """Return whether files or notebook cells hold a function and those that it encloses."""
    waiting = [function]
    seen = set()
    while waiting:
        one = waiting.pop()
        if not _has_lines(one):
            return False
        seen.add(one)
        for used in inspect.getclosurevars(one).nonlocals.values():
            if isinstance(used, FunctionType) and used not in seen:
                waiting.append(used)
    return True


def _has_lines(function: FunctionType) -> bool:
    """Return whether Python can find the text of a function.

    From Python 3.13 on, `<string>` has the text of `python -c`, whichever text was executed.
    """
    file = function.__code__.co_filename
    return file != "<string>" and bool(linecache.getlines(file))


def _source(function: FunctionType) -> str:
    if not _has_lines(function):
        return _unknown(function)
    try:
        return inspect.getsource(function)
    except OSError:
        return _unknown(function)


@cache
def _unknown(function: FunctionType) -> str:
    """Return a new identity for a function without a source, different in each process."""
    return uuid4().hex


def _texts(value: Any, seen: set[int]) -> Iterator[Any]:
    """Yield the sources of a class or function, and of what it uses (see the module's text)."""
    if id(value) in seen or isinstance(value, ModuleType):
        return
    seen.add(id(value))
    if not isinstance(value, type | FunctionType):
        yield plain(value, "a value that the planner uses")
        return
    if isinstance(value, type):
        members = vars(value).items()
        constants = [(name, repr(item)) for name, item in members if isinstance(item, _CONSTANTS)]
        # pickling a class leaves its list of slots there
        yield sorted(pair for pair in constants if pair[0] != "__slotnames__")
    for name, function in sorted(_functions(value).items()):
        yield [name, _source(function)]
        for used in _used(function):
            yield from _texts(used, seen)


def _used(function: FunctionType) -> Iterator[Any]:
    """Yield the values that a function uses from its own module and the functions around it."""
    for name in _names(function.__code__):
        value = function.__globals__.get(name)
        own = getattr(value, "__module__", function.__module__) == function.__module__
        if value is not None and own:
            yield value
    yield from inspect.getclosurevars(function).nonlocals.values()


def _names(code: CodeType) -> list[str]:
    """Return the global names in a function and in the functions within it."""
    return [name for own in _codes(code) for name in own.co_names]


def _sources(name: str) -> str:
    """Return the digest of the sources of a module (see the module's text)."""
    module = sys.modules[name]
    file = _file(module)
    if file is None:
        return ""
    package = (module.__package__ or "").partition(".")[0]
    if package in _OURS:
        return _ours()
    release = " ".join(_release(name)).strip()
    if release and _is_installed(file):
        _check_imported([file])
        return _sha(f"{release} {_sha(file.read_bytes())}")
    sources: dict[str, Path] = {}
    if not package:
        sources = {path.name: path for path in _script(file)}
    else:
        for folder in sys.modules[package].__path__:
            root = Path(folder)
            sources |= _named(_files(root), root)
    _check_imported(sources.values())
    return _sha_of(sources)


def _check_imported(files: Iterable[Path]) -> None:
    """Raise `InvalidInput` if a function of a loaded module is not what its source file says.

    Python has no record of the source that a module was imported from, so the file is compiled
    again. Modules that an import hook rewrites, such as pytest's, are not checked.
    """
    paths = {str(file) for file in files if file.suffix == ".py"}
    for module in list(sys.modules.values()):
        path = getattr(module, "__file__", None)
        loader = getattr(module, "__loader__", None)
        if path not in paths or type(loader) is not SourceFileLoader:
            continue
        written = set(_codes(compile(Path(path).read_bytes(), path, "exec", dont_inherit=True)))
        for value in vars(module).values():
            if not isinstance(value, type | FunctionType):
                continue
            for function in _functions(value).values():
                code = function.__code__
                if code.co_filename == path and code not in written:
                    right = "a module that is not edited after its import: start Python anew"
                    raise InvalidInput("planner", right, value=module.__name__, file=path)


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Return the code objects of a module or function, and of the functions within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


@cache
def _ours() -> str:
    """Return the digest of the sources of this package that trials depend on."""
    root = Path(__file__).resolve().parents[2]
    sources: dict[str, Path] = {}
    for package in _OURS:
        sources |= _named(_files(root / package), root)
    deciding = {name: path for name, path in sources.items() if _decides(name)}
    return _sha_of(deciding)


def _named(files: list[Path], root: Path) -> dict[str, Path]:
    """Return files by their paths below a folder."""
    return {file.relative_to(root).as_posix(): file for file in files}


def _decides(name: str) -> bool:
    """Return whether a module of this package can change a trial."""
    return name in _JUDGES or not name.startswith(_SHOWS_ONLY)


def _files(folder: Path) -> list[Path]:
    paths = sorted(folder.rglob("*"))
    return [path for path in paths if path.suffix in _SOURCES]


def _script(file: Path) -> list[Path]:
    """Return a script and the modules beside it that it imports, directly or indirectly."""
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
    """Return the top-level names of all modules that a source imports."""
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


def _file(module: ModuleType) -> Path | None:
    """The module's source file, where there is one: not of a notebook, nor of standard input."""
    name = getattr(module, "__file__", None)
    if name is None or not Path(name).is_file():
        return None
    return Path(name).resolve()


def _is_installed(file: Path) -> bool:
    """Return whether a file lies in a folder of installed packages."""
    return not {"site-packages", "dist-packages"}.isdisjoint(file.parts)


class _Release(NamedTuple):
    """A registered or installed distribution and its version; empty for code of none."""

    name: str
    version: str


@cache
def _release(module: str) -> _Release:
    """The distribution that registers a module's planners, or has the name of its package."""
    package = module.partition(".")[0]
    found = None
    for entry in entries().values():
        if entry.point.module.partition(".")[0] == package and entry.point.dist is not None:
            found = entry.point.dist
    try:
        found = found or distribution("mintime" if package in _OURS else package)
    except (PackageNotFoundError, ValueError):  # a script
        return _Release("", "")
    return _Release(found.name, found.version)


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


def _processor() -> str:
    """The processor's model, as Linux or else Python names it; perhaps empty."""
    try:
        described = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor()
    model = _CPU_MODEL.search(described)
    return model["name"] if model else platform.processor()
