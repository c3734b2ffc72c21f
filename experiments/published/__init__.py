"""Figures and page of `experiments.literature`."""
