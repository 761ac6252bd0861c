"""Experiment: are the talks' printed tables reproduced?"""
