"""Simplified models of some problems, from the simplest to the full one, with maps to full states."""
