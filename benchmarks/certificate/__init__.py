"""Certificates: judge what an integrator claims by measuring it on a fixed battery of systems, and show the result."""
