"""Tests of `baselines/exact/jerk`."""
