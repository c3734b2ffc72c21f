"""Why a planner is as far from optimal as it is. Read in this order:

- `references`: which planner is the reference for which problem;
- `decomposition`: the parts that a gap is made of;
- `active_limits`: which limits are active when, and the saving of each;
- `claims`: the verdict on a published duration.
"""
