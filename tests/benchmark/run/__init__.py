"""Tests of trajopt.benchmark.run; a package: other folders have a test_read_me_first.py too."""
