"""Trials and motions for other tools. In reading order:

- `tables`: CSV and Parquet.
- `latex`: tables for a paper.
- `motion_file`: one certified trajectory, for a controller or as a picture.
"""
