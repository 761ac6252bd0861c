r"""The explicit Runge-Kutta method of order 8 with 12 stages that the code DOP853 steps with.

The published numbers (30 digits) satisfy the 200 conditions of order 8 to 6e-29.  Here they have 60 digits, from Newton
steps of minimum norm on these conditions and on the nodes, which are rational or in Q(sqrt 6): :math:`c = 0,
\tfrac49 c_4, \tfrac23 c_4, \tfrac{6 - \sqrt6}{30}, \tfrac{6 + \sqrt6}{30}, \tfrac13, \tfrac14, \tfrac4{13},
\tfrac{127}{195}, \tfrac35, \tfrac67, 1` (the fourth entry is c_4).  No number moved by more than 6e-29.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), II.5 and II.10; the
method is J. R. Dormand's and P. J. Prince's.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

from .table import value

STAGES = 12


@cache
def tableau() -> tuple[tuple, ...]:
    """The tableau of DOP853's method of order 8: the rows of A, then b, as numbers of `DIGITS` digits."""
    text = Path(__file__).with_name("published").joinpath("dop853.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text)["rows"]
    return tuple((*(0 if x == "0" else value(x) for x in row), *(0,) * (STAGES - len(row))) for row in rows)
