"""Tests of `baselines/exact/acceleration`."""
