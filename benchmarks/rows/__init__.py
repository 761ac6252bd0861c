"""Rows on disk, tables of them, and where they come from."""
