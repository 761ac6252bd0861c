"""Experiment: does the integrator that `phasebench advise` recommends meet the requested accuracy, and is it fast?"""
