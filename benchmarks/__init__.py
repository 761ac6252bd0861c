"""The benchmark harness: problems, time spans and steps to run them with, measurements, and reports of the results."""
