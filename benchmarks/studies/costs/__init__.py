"""What a step, a run, a first run cost."""

from . import large, solvers, start, step

STUDIES = (step.STUDY, start.STUDY, large.STUDY, solvers.STUDY)
