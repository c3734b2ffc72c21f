"""`trajopt list` reads what is stored of our planners, and describes those of others."""

import json
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from importlib.util import find_spec

from trajopt.cli import described, listing
from trajopt.core.built_in import data_folder, listed

REGISTERED = tomllib.loads((data_folder().parent / "pyproject.toml").read_text())["project"][
    "entry-points"
]["trajopt.planners"]


def test_what_is_stored_is_what_would_be_described():
    stored = json.loads(listed().read_text(encoding="utf-8"))
    again = json.loads(json.dumps(described.to_store()))
    for kind in ("problems", "robots", "limits"):
        assert stored[kind] == again[kind], "run: python -m trajopt.cli.described"
    known = {row["name"]: row for row in stored["planners"]}
    assert {name: row["value"] for name, row in known.items()} == REGISTERED
    for row in again["planners"]:
        if row["name"] in REGISTERED:  # another checkout may have registered more
            assert known[row["name"]] == row, "run: python -m trajopt.cli.described"


def test_a_stored_row_is_the_described_one():
    rows = {row["name"]: row for row in listing.lists("planners")["planners"]}
    for name in ("exact", "copp"):
        assert rows[name] == described.described(described.entries()[name])


def test_listing_imports_no_planner():
    code = (
        "import sys\n"
        "from importlib import metadata\n"
        "from trajopt.cli import listing\n"
        f"ours = {sorted(REGISTERED)!r}\n"
        "every = metadata.entry_points\n"
        "listing.entry_points = lambda group: [p for p in every(group=group) if p.name in ours]\n"
        "listing.list_()\n"
        "assert not [name for name in sys.modules if name.startswith(('baselines', 'scipy'))]\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "exact" in done.stdout


def test_a_planner_of_another_place_is_described_anew(monkeypatch):
    """Its entry point leads elsewhere, so the stored row is not its own."""
    moved = EntryPoint("exact", "somewhere:Else", "trajopt.planners")
    monkeypatch.setattr(listing, "entry_points", lambda group: [moved] if "pl" in group else [])
    asked = []
    monkeypatch.setattr(described, "described", lambda entry: asked.append(entry.name) or {})
    assert listing.lists("planners") == {"planners": [{}]}
    assert asked == ["exact"]


def test_with_a_kind_of_limit_of_others_all_is_described_anew(monkeypatch):
    point = EntryPoint("tool_speed", "somewhere:ToolSpeed", "trajopt.limits")
    monkeypatch.setattr(listing, "entry_points", lambda group: [point] if "li" in group else [])
    monkeypatch.setitem(described.READ, "limits", lambda: [{"name": "tool_speed"}])
    assert listing.lists("limits") == {"limits": [{"name": "tool_speed"}]}


def test_a_missing_package_is_looked_for_now(monkeypatch):
    monkeypatch.setattr(
        listing, "find_spec", lambda name: None if name == "toppra" else find_spec("json")
    )
    monkeypatch.setattr(listing, "_is_ours", lambda point: True)
    rows = {row["name"]: row for row in listing.lists("planners")["planners"]}
    assert rows["toppra"]["available"] is False
    assert "pip install" in rows["toppra"]["missing"]
    assert rows["exact"]["available"] is True
