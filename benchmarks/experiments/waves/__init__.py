"""Experiment: which invariants of semi-discretized wave equations are preserved?"""
