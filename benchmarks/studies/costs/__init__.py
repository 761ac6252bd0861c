"""What a step, a run, a first run cost."""

from . import start, step

STUDIES = (step.STUDY, start.STUDY)
