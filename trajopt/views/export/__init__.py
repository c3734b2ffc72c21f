"""Trials and motions for other tools."""
