"""Trials in supervised processes, here or on a cluster."""
