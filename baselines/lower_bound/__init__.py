"""Proved lower bounds on the minimum time (docs/mathematics.md, sections 7 and 7b).

    from baselines.lower_bound.bound import prove
    bound = prove(problem)
    print(bound.lower_bound, bound.upper_bound, bound.status)

In reading order:

- `planner.py`: the registered planner `prove`;
- `bound.py`: the function `prove`, for any trajectory and for 3-5-3 splines;
- `incumbent.py`: the best trajectory of the references.

The bound on every trajectory, under every kind of limit:

- `relaxation.py`: the variables, their box, and the rows of a box;
- `costates.py`, `jerk_rows.py`: rows that hold in every box;
- `dual_check.py`: a proof, and the bounds of its steps in floats; what it proves, the kernel says;
- `extremal.py`, `separation.py`: the rows that a point violates;
- `row_pool.py`: the linear program with the rows found so far;
- `branching.py`: the search for a proof.

The bound on the 3-5-3 splines: `ratio_boxes.py`, search and check.
"""
