"""Simplified models of some problems, from the simplest to the full one, with maps of their states to full states."""
