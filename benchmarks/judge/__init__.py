"""Judges claims about an integrator (order, symplecticity, conservation, ...) from rows of measurements."""
