"""Runs planners over problems, keeps everything, and tabulates and draws it."""
