"""Wisdom-Holman splittings beside REBOUND's."""
