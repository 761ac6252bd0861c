"""Experiment: how well do the methods keep energy and angular momentum over long times?"""
