"""Tests of `baselines/exact/method`."""
