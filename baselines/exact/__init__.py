"""Exact minimum times: no discretisation."""
