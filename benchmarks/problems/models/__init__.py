"""Ladders of models: from the simplest to the full one, each with a map of its solution to the full problem's state."""
