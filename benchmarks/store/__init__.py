"""The store of measurements: cells (single measurements), the run that makes them, tables on disk, their provenance."""
