"""Only regular files are read: what has no end is refused at once, in a line."""

import os
from pathlib import Path

import pytest

from trajopt import StoreError
from trajopt.benchmark.store.folder import Store, is_trial, read
from trajopt.cli import kinds, main
from trajopt.core import files

COMMANDS = [
    ("plan", "x.toml"),
    ("plan", "x.csv", "--robot", "ur5e"),
    ("judge", "x.csv", "one-joint"),
    ("judge", "x.json", "one-joint"),
    ("judge", "x.yaml", "one-joint"),
    ("verify", "x.csv", "--limits", "one-joint"),
    ("verify", "x.h5"),
    ("verify", "x.parquet", "--robot", "ur5e"),
    *(("chunk", f"x.{ending}", "--robot", "ur5e") for ending in ("csv", "npz", "hdf5")),
    ("report", "x.h5"),
    ("export", "x.h5", "--to", "csv"),
    ("plan", "x.npy", "--robot", "ur5e"),
    ("new", "y.toml", "x.npy", "--robot", "ur5e"),
    ("best-known", "propose", "x.h5"),
]


@pytest.mark.skipif(os.name != "posix", reason="pipes and devices of this kind are POSIX's")
@pytest.mark.parametrize("kind", ["pipe", "device"])
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_pipes_and_devices_are_a_line(tmp_path, monkeypatch, capsys, kind, command):
    monkeypatch.chdir(tmp_path)
    (name,) = (word for word in command if word.startswith("x."))
    if kind == "pipe":
        os.mkfifo(name)
    else:
        os.symlink("/dev/zero", name)
    with pytest.raises(SystemExit) as stop:
        main(list(command))
    assert stop.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "it is a pipe, a socket or a device" in line


def test_a_link_to_a_file_is_read(tmp_path):
    (tmp_path / "f").write_bytes(b"text")
    (tmp_path / "l").symlink_to(tmp_path / "f")
    assert files.content(tmp_path / "l") == b"text"


@pytest.mark.skipif(os.name != "posix", reason="devices of this kind are POSIX's")
def test_a_device_is_of_no_kind():
    zero = Path("/dev/zero")
    assert kinds.kind(zero) == ""
    assert not is_trial(zero)
    with pytest.raises(StoreError, match="/dev/zero: cannot be read: it is a pipe"):
        read(zero)
    with pytest.raises(OSError, match="a device"):
        files.content(zero)


def test_too_little_memory_is_not_called_damage(tmp_path, monkeypatch):
    def full(path, max_bytes):
        raise MemoryError

    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / f"{0:020x}.json").write_bytes(b"")
    monkeypatch.setattr(files, "content", full)
    with pytest.raises(StoreError, match=r"0000\.json: there is not enough memory to read it"):
        Store(tmp_path).read()


@pytest.mark.parametrize("content", ["[", "(", "[[\n1", ",", "[ ] (\n1 2 3"])
@pytest.mark.parametrize("command", [("judge", "one-joint"), ("plan", "--robot", "ur5e")])
def test_a_table_without_columns_is_a_line(tmp_path, capsys, content, command):
    file = tmp_path / "m.csv"
    file.write_text(content)
    name, *rest = command
    with pytest.raises(SystemExit) as stop:
        main([name, str(file), *rest])
    assert stop.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
