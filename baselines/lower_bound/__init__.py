"""Proved lower bounds on the minimum time (docs/mathematics.md, sections 5 and 5b).

    from baselines.lower_bound.bound import certify
    bound = certify(problem)
    print(bound.lower_bound, bound.upper_bound, bound.status)

`planner.py` is the registered planner, and `bound.py` asks. Any trajectory, every limit counted:
`relaxation.py` has the variables, `costates.py` and `jerk_rows.py` the rows, `extremal.py` and
`separation.py` find those that are broken, `branching.py` searches with `row_pool.py` and HiGHS
(`linear.py`), and `dual_check.py` checks the proof without a solver. The best 3-5-3 spline:
`spline353.py` asks, and `ratio_boxes.py` searches and checks.
"""
