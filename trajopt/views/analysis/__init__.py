"""Frames, statistics and comparisons of stored trials."""
