"""Exact minimum times, without discretisation: the planners `exact` and `exact-jerk`.

Two programs, and the method that solves both. In reading order:

- `acceleration`: velocity and acceleration limits; the planner `exact`.
- `jerk`: jerk limits too; the planner `exact-jerk`.
- `method`: what both share: the interior-point method, active limits, the motion of an optimum.
"""
