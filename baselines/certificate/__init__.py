"""Proved lower bounds on the minimum time, by SCIP (mathematics, section 5).

from baselines.certificate import certify
bound = certify(problem)
print(bound.lower_bound, bound.upper_bound, bound.status)
"""

from baselines.certificate.bound import Bound, certify

__all__ = ["Bound", "certify"]
