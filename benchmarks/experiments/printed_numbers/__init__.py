"""Experiment: are numbers that papers print on integrators measured here, too?"""
