"""Planners: the contract, how planners are found, and the 3-5-3 spline. Read in this order:

- `planner`: the contract that every planner keeps;
- `reductions`: a problem made simpler for a planner, and its answer brought back;
- `registry`: planners by name, and their options as text;
- `testing`: the contract as a check of your own planner;
- `rest_to_rest`: stopping at every waypoint, in closed form;
- `spline353`: the 3-5-3 spline in closed form;
- `spline_family`: splines of any degrees;
- `timing`: a spline as a function of its times, and the fitness of a search;
- `compiled`: that function for one candidate, compiled;
- `swarm`: particle and sparrow searches, free of robots;
- `swarm_planner`: the 3-5-3 spline timed by a swarm;
- `objective`: the same fitness for any other optimiser;
- `kinematics`: a robot's forward and inverse kinematics, and a Cartesian path as a problem.
"""
