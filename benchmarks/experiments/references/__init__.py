"""Experiment: are the stated uncertainties and horizons of the certified references true?"""
