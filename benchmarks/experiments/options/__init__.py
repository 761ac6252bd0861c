"""Experiment: what do the methods' options gain and cost: a scheme's parameter lambda, order, nodes, stage solver?"""
