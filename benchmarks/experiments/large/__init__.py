"""Experiment: what does a step of an integrator cost for many degrees of freedom?"""
