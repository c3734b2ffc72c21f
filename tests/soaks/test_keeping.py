"""What keeping costs is measured on whole folders, and commands that fail are not measured."""

from __future__ import annotations

from pathlib import Path

import pytest
from trials import solved

from soaks import keeping
from trajopt.benchmark.store.folder import Store, read


def test_trials_are_kept_under_new_seeds_and_each_part_is_measured(tmp_path: Path) -> None:
    base, folder = tmp_path / "base", tmp_path / "kept"
    Store(base).write(solved())
    keeping.added(base, folder, 0, 2, keeping.SOURCES)
    spent = keeping.added(base, folder, 2, 1, keeping.SOURCES)
    assert {"seen", "judging", "keeping", "results.h5", "MB", "peak"} == set(spent)
    assert all(value >= 0 for value in spent.values())
    assert sorted(trial.seed for trial in read(folder)) == [0, 1, 2]
    assert not Store(folder).refresh()


def test_a_command_that_fails_says_why(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="nothing here"):
        keeping.measured(["-c", "raise SystemExit('nothing here')"], keeping.SOURCES, tmp_path)
