"""Rigid bodies: what their methods keep, what an attitude costs, and what a nearly symmetric body gains."""
