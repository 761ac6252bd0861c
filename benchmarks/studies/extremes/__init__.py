"""How far methods can be pushed: stability, round-off, close encounters, resonances, stiffness; six pages."""

from . import encounters, limits, multistep, round_off, springs, summary

STUDIES = tuple(module.STUDY for module in (summary, limits, round_off, encounters, springs, multistep))
