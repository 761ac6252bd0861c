"""Experiment: packages of molecular dynamics on the same atoms and a rigid water, at defaults and at their best."""
