"""Problems by name, and suites of them. In reading order:

- `catalogue`: finds a problem by its name, and lists the suites;
- `suite`: what a suite is;
- `literature`: published problems, with the times published for them;
- `robots`: problems of real arms;
- `edges`: degenerate problems, one kind each;
- `moving`: problems that begin or end in motion;
- `sections`: problems with limits of one segment;
- `demands`: problems of times, waits, loops and waypoints within tolerance;
- `families`: random families, reproducible on every machine;
- `random`: one random problem per seed, made to break planners.
"""
