"""Run a command as a user does."""

from pathlib import Path

import pytest

from trajopt import cli


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command in an empty folder; return its exit code, output and errors, unfolded."""
    monkeypatch.chdir(tmp_path)

    def command(line, **files):
        for name, text in files.items():
            content = text if isinstance(text, bytes) else text.encode()
            Path(name.replace("__", ".")).write_bytes(content)
        with pytest.raises(SystemExit) as ended:
            cli.main(line.split())
        out, err = capsys.readouterr()
        return ended.value.code, out, " ".join(err.split())

    return command
