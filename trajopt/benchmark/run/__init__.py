"""Run planners in processes of their own, and judge them in others. In reading order:

- `tasks`: which tasks there are, and what a trial may use;
- `profile`: what a run knows of a planner, in plain data;
- `runner`: runs tasks in this process, under judges, or on an executor's workers;
- `server`: a small process from which judges are forked;
- `judge`: a process that asks for answers, verifies them and stores trials;
- `solver`: the process that a planner runs in;
- `answer`: the message from a solver to its judge;
- `processes`: adopts, watches and ends processes;
- `dask`: connects to a Dask cluster;
- `progress`: says how many trials are finished.
"""
