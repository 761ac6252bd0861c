"""Which integrator is the fastest at each accuracy: the trade between error and time, in pages."""

from . import gauss, ratios, scenes, trade

STUDIES = (trade.STUDY, ratios.STUDY, gauss.STUDY, *scenes.STUDIES)
