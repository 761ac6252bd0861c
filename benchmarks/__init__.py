"""The harness: problems, scenes, sweeps, benchmarks and the reports written from them."""
