"""The contract that every planner in trajopt keeps, and that the name is registered."""

from chord_cubic import ChordCubic

from trajopt.planners.registry import load
from trajopt.planners.testing import check_planner


def test_it_keeps_the_contract():
    check_planner(ChordCubic())


def test_trajopt_knows_it_by_name():
    assert load("chord-cubic:spare=3") == ChordCubic(spare=3.0)
