"""Swarms: box-constrained minimisers that know nothing of robots, batched over independent runs."""

from trajopt.swarm.issa import ISSA
from trajopt.swarm.optimiser import Box, Compared, Optimiser, Result, Streams, minimise
from trajopt.swarm.pso import PSO
from trajopt.swarm.ssa import SSA

__all__ = ["ISSA", "PSO", "SSA", "Box", "Compared", "Optimiser", "Result", "Streams", "minimise"]
