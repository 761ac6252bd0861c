"""The benchmark harness: problems, scenes, measurements, and the reports written from them."""
