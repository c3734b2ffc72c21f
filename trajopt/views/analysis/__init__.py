"""Tables of trials. In reading order:

- `versions`: the trials that are shown.
- `gap_reference`: the duration that gaps are measured against.
- `results`: one row per trial, and one line per problem and planner.
- `overview`: one line per planner over many problems.
- `failures`: the reasons why trials failed.
- `searches`: evaluations that searches of the best 3-5-3 need.
- `pairwise`: planners against each other.
- `statistics`: tests, intervals and profiles, of arrays.
"""
