"""Views of trials, in reading order: `analysis` (tables), `figures`, `report`, `export`.

Every view is a function of a list of trials. `analysis.results.Results` makes the tables that the
others show.
"""
