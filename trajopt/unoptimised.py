"""Until every environment knows the new entry point: see `trajopt.swarm_planner`."""

from trajopt.swarm_planner import Unoptimised as Unoptimised
