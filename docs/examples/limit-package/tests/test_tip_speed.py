"""The limit keeps what the judge and planners ask of a kind."""

from tip_speed import TipSpeed

from trajopt.planners.testing_limits import check_limit


def test_it_keeps_the_contract():
    check_limit(TipSpeed.read({"links": [0.6, 0.4], "speed": 0.5}, joints=2))
