"""Ladders: runs at ever finer steps or tolerances, to find where an integrator meets an accuracy at the least cost."""
