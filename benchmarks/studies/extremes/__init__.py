"""How far methods can be pushed: stability, round-off, close encounters, resonances, stiffness; six pages."""

from .multistep import STUDY as MULTISTEP

STUDIES = (MULTISTEP,)
