"""What steps are built from: the loop, stage solvers, the root finder, Kepler's flow; the contract of a family."""
