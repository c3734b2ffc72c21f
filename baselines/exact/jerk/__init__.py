"""The exact minimum time under velocity, acceleration and jerk limits: the planner `exact-jerk`.

In reading order:

- `planner`: the program, its initial guesses and its answer.
- `gaps`: the initial guesses of a motion that begins or ends in motion.
- `profiles`: the two extreme profiles of a joint in a segment, in closed form.
- `cells`: unknowns, inequalities and Newton steps of the program.
- `motion`: the motion through the waypoint states of an optimum.
- `by_ipopt`: the same optimum by IPOPT, an independent check.
- `one_sided`: why jerk limits on one side only have no optimum.
"""

from baselines.exact.jerk.planner import ExactJerk

__all__ = ["ExactJerk"]
