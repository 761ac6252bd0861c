"""Ladders: runs at ever finer steps or tolerances, to find where an integrator meets an accuracy at the least cost.

A `rung` is a run at one size (a number of steps or a tolerance); `climb` runs size after size until a rule ends it;
`race` is a climb that is given up if others are cheaper; `bracket` finds the two rungs around an accuracy and the cost
between them; `refine` narrows a bracket; `search` finds the size in few runs from a first guess; `curves` writes rungs
as rows.
"""
