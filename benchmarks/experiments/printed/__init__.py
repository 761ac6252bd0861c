"""Experiment: are the error tables printed in a talk on symplectic schemes reproduced?"""
