"""What methods are built from: the loop over steps, solvers of stage equations, a root finder, Kepler's flow."""
