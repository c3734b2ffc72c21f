"""Tests of trajopt.benchmark.suites; a package: other folders have a test_read_me_first.py too."""
