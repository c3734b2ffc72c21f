"""Views of trials. In reading order:

- `analysis`: tables;
- `figures`, `report`, `export`: pictures, a page, files for other tools;
- `inline`: what a notebook shows.

Every view is a function of a list of trials. `analysis.results.Results` makes the tables that the
others show.
"""
