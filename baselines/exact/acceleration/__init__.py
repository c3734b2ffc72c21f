"""The exact minimum time under velocity and acceleration limits: the planner `exact`.

In reading order:

- `planner`: the program, its initial guesses and its answer.
- `gaps`: the initial guesses of a motion that begins or ends in motion.
- `instants`: times at which such a motion is possible at single instants alone.
- `profiles`: the two extreme profiles of a joint in a segment, in closed form.
- `cells`, `newton_step`: unknowns, inequalities and Newton steps of the program.
- `boxes`: problems in which neighbouring waypoints are merged, where their tolerances overlap.
- `motion`: the motion through the waypoint velocities of an optimum.
- `by_ipopt`: the same optimum by IPOPT, an independent check.
"""

from baselines.exact.acceleration.planner import Exact

__all__ = ["Exact"]
