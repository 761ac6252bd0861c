"""What steps are made of: the loop, stage solvers, the root finder, Kepler's flow; and the contract of a family."""
