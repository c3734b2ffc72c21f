"""A problem, a trajectory and a solution: what every other folder talks about."""
