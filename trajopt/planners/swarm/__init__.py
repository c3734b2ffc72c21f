"""Swarms: box-constrained minimisers, free of robots, batched over independent runs.

In reading order:

- `optimiser`: the loop that all share;
- `pso`, `ssa`, `issa`: one algorithm each.
"""

from trajopt.planners.swarm.issa import ISSA
from trajopt.planners.swarm.optimiser import Box, Compared, Optimiser, Result, Streams, minimise
from trajopt.planners.swarm.pso import PSO
from trajopt.planners.swarm.ssa import SSA

__all__ = ["ISSA", "PSO", "SSA", "Box", "Compared", "Optimiser", "Result", "Streams", "minimise"]
