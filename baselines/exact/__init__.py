"""Exact minimum times, without discretisation: the planners `exact` and `exact-jerk`.

In reading order:

- `several_starts`: what both planners share, the best of several local optima.
- `scaled`: a problem without units.
- `acceleration`, `acceleration_profiles`, `cells`, `newton_step`: velocity and acceleration limits.
- `jerk`, `jerk_profiles`, `jerk_cells`: jerk limits too.
- `interior_point`, `chain`, `crossover`: the method of both, its Newton steps, active limits.
- `acceleration_motion`, `jerk_motion`, `segments`, `pieces`: the motion of an optimum.
- `by_ipopt`, `jerk_by_ipopt`: the optima of sections 3 and 4 by IPOPT, an independent check.
- `one_sided_jerk`: why limits of jerk on one side only have no optimum.
"""
