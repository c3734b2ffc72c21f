"""Tests of `trajopt/benchmark/store`."""
