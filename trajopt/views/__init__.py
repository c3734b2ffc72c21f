"""Views of trials. In reading order:

- `analysis`: tables;
- `figures`, `report`, `export`: pictures, a page, files for other tools;
- `inline`: what a notebook shows;
- `results`: the tables with their figures, as users have them.

Every view is a function of a list of trials. `analysis.results.Tables` makes the tables; the other
views show them.
"""
