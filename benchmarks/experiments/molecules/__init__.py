"""Experiment: packages of molecular dynamics on argon atoms and a rigid water, at default and at best settings."""
