"""Measurements of errors, orders, conservation, stability and time; mostly pure functions of trajectories."""
