"""Certificates: what anyone's integrator claims, judged on a fixed battery of systems, and how that is shown."""
