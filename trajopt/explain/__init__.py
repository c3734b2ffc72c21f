"""Why a planner is as far from optimal as it is: what its gap is made of, which limits bind."""
