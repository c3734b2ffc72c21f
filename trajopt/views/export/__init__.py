"""Trials and motions for other tools, in reading order.

all_trials: the formats of all trials.
tables: CSV and Parquet.
latex: tables for a paper.
ioh: convergence histories for IOHanalyzer.
motion: one certified trajectory for a controller, or as a picture.
"""
