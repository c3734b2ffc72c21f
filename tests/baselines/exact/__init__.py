"""Tests of `baselines/exact`."""
