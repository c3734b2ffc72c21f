"""Messages that others published: each gets a gap, with its limits and without a flag."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from work import one_in

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.formats.motion import motion
from trajopt.formats.samples import Samples
from trajopt.judgement import judge

PUBLISHED = json.loads((Path(__file__).parent / "data" / "public_messages.json").read_text())
FIELDS = ("positions", "velocities", "accelerations")
POINTS_MAX = 9  # of a message, as waypoints


TIMED = "time-optimal timing"
AT_REST = [own for own in PUBLISHED if not own["producer"].endswith(TIMED)]


def sent(own, tmp_path):
    """The message in a file, as it was sent."""
    rows = [
        {field: own[field][row] for field in FIELDS if field in own}
        for row in range(len(own["times"]))
    ]
    points = [row | {"time_from_start": time} for row, time in zip(rows, own["times"], strict=True)]
    path = tmp_path / "sent.json"
    path.write_text(json.dumps({"joint_names": own["joint_names"], "points": points}))
    return motion(path)


def through_its_points(own):
    """The problem whose waypoints are the message's own points, or some of them."""
    rows = np.array(own["positions"])
    spread = np.linspace(0, len(rows) - 1, min(len(rows), POINTS_MAX))
    limits = Limits(own["velocity_limits"], own["acceleration_limits"])
    return Problem(
        rows[np.unique(spread.round().astype(int))], limits, joint_names=own["joint_names"]
    )


def test_there_are_twenty_of_several_producers():
    assert len(PUBLISHED) >= 20
    assert len({own["producer"] for own in PUBLISHED}) >= 5


@pytest.mark.parametrize("own", one_in(4, PUBLISHED), ids=[own["name"] for own in PUBLISHED])
def test_a_published_message_gets_a_gap(tmp_path, own):
    found = judge(through_its_points(own), sent(own, tmp_path)).best
    assert found.gap is not None
    assert not found.below_optimum
    parts = found.explanation
    assert (1 + parts.timing_gap) * (1 + parts.route_gap) == pytest.approx(1 + parts.gap, abs=1e-3)
    assert min(parts.timing_gap, parts.route_gap) > -1e-6  # no path is faster than the optimum
    # All of it is as published; only MoveIt's time-optimal timing does not begin at rest.
    assert found.via_tolerance == 0
    first = np.abs(own["velocities"][0]).max()
    assert found.ends_taken == pytest.approx(first, abs=1e-9)
    assert (first > 0) == (own not in AT_REST)


@pytest.mark.parametrize("own", one_in(4, PUBLISHED), ids=[own["name"] for own in PUBLISHED])
def test_resampled_it_takes_the_second_verdict_within_its_miss(tmp_path, own):
    asked = through_its_points(own)
    given = sent(own, tmp_path).trajectory
    times = np.linspace(0, given.duration, 101)
    states = [given(times, order) for order in range(3)]
    found = judge(asked, Samples(tuple(own["joint_names"]), times, *states))
    best = found.best
    assert best.gap is not None
    assert not best.below_optimum
    missed = np.abs(found.trajectory(found.trajectory.waypoint_times) - asked.waypoints).max()
    assert missed <= max(best.via_tolerance, 1e-9)  # rad, far below what a controller resolves
    assert (best is found) == found.certificate.valid
    assert best.via_tolerance < 1e-3
