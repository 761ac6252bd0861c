"""The store of measurements: cells, the run that measures them, tables on disk, and their provenance."""
