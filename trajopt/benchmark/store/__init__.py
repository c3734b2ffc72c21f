"""What is kept: one file per trial, one consolidated `results.h5`."""
