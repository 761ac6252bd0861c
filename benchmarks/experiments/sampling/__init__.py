"""Experiment: splittings and force-gradient methods for Hamiltonian Monte Carlo; energy drift of Hessian-free ones."""
