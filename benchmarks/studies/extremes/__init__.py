"""How far methods can be pushed: stability, round-off, close encounters, resonances, stiffness; six pages."""

from . import encounters, multistep, springs

STUDIES = tuple(module.STUDY for module in (encounters, springs, multistep))
