"""Attacks on the toolkit, by the thousand: each module asks whether one promise can be broken.

Reading order:

- `soak_report`: the report of every soak.
- `tricks`: motions that claim too little.
- `moving_ends`: the same, with the velocities at the ends of problems in motion.
- `forgeries`: proofs that claim too much.
- `relations`: inequalities and symmetries between planners, on random problems.
- `hostile_inputs`: files that a stranger crafted or an accident changed, made by `hostile_texts`
  and `forged_results`; `said` runs a command on them.
- `nasty_planners`: planners that mean harm, which `nasty` defines.
- `trusted`: what a planner's file, a package or a file of results makes a command believe.

Attacks that are texts or tables stand in the folder `data`.
"""
