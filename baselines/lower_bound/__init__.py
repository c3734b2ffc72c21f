"""Proved lower bounds on the minimum time, by SCIP (docs/mathematics.md, section 5).

    from baselines.lower_bound import certify
    bound = certify(problem)
    print(bound.lower_bound, bound.upper_bound, bound.status)

`planner.py` is the registered planner, `bound.py` asks, `free.py` and `spline353.py` say what
about, `program.py` what they share.
"""

from baselines.lower_bound.bound import Bound, certify, recheck

__all__ = ["Bound", "certify", "recheck"]
