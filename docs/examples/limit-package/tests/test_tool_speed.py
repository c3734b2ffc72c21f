"""The limit keeps what the judge and planners ask of a kind."""

from tool_speed import ToolSpeed

from trajopt.planners.testing_limits import check_limit


def test_it_keeps_the_contract():
    check_limit(ToolSpeed.read({"links": [0.6, 0.4], "speed": 0.5}, joints=2))
