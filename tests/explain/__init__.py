"""Tests of trajopt.explain; a package, because other folders have a test_read_me_first.py too."""
