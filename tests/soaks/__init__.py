"""Thousands of attacks on the toolkit: each module tries to break one of its promises.

Reading order:

- `soak_report`: the report of every soak.
- `tricks`: motions that claim too little.
- `moving_ends`: motions that claim too little, by their velocities at the ends.
- `forgeries`: proofs that claim too much.
- `relations`: inequalities and symmetries between planners, on random problems.
- `hostile_inputs`: files that a stranger crafted or an accident changed, made by `hostile_texts`
  and `forged_results`; `said` runs a command on them.
- `nasty_planners`: malicious planners, which `nasty` defines.
- `trusted`: false statements that a planner's file, a package or a file of results makes.

Attacks that are texts or tables are in the folder `data`.
"""
