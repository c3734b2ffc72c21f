"""The planners' contract and registry, and the 3-5-3 polynomial with its swarms."""
