"""Experiment: splittings and force gradients for Hamiltonian Monte Carlo, and the energy without the Hessian."""
