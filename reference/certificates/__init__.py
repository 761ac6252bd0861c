"""Certified end states: how they are made, where they are stored, how they are found again."""
