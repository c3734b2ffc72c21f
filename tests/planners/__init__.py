"""Tests of trajopt.planners; a package, because other folders have a test_read_me_first.py too."""
