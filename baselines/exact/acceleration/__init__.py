"""The exact minimum time under velocity and acceleration limits: the planner `exact`.

In reading order:

- `planner`: the program, where it starts, and what it answers.
- `gaps`: where it starts if the motion begins or ends in motion.
- `profiles`: the two extreme profiles of a joint in a segment, in closed form.
- `cells`, `newton_step`: unknowns, inequalities and Newton steps of the program.
- `motion`: the motion through the waypoint velocities of an optimum.
- `by_ipopt`: the same optimum by IPOPT, an independent check.
"""

from baselines.exact.acceleration.planner import Exact

__all__ = ["Exact"]
