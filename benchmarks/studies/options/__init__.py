"""What do the options of methods give, and cost: lambda, orders, nodes, stage solvers, sums, precision?

On disk the tables are named `knobs_*`, and an option's column is `knob`.
"""

from . import numerics, step_map

STUDIES = (step_map.STUDY, numerics.STUDY)
