r"""The undamped, unforced Duffing oscillator :math:`H = p^2/2 + \alpha q^2/2 + \beta q^4/4`, beta > 0.

For alpha < 0 there are two wells at :math:`\pm\sqrt{-\alpha/\beta}` and a saddle at 0, whose separatrix
:math:`q = a\,\mathrm{sech}(\sqrt{-\alpha}\,t)` leaves :math:`a = \sqrt{-2\alpha/\beta}`.  From rest at q = a > 0 the
motion is an elliptic function of time (`exact` gives q and the period):

- around both wells, or in the one well of alpha >= 0: :math:`q = a\,\mathrm{cn}(\omega t, m)` with
  :math:`\omega^2 = \alpha + \beta a^2`, :math:`m = \beta a^2/2\omega^2`, of period :math:`4K(m)/\omega`;
- in one of two wells: :math:`q = a\,\mathrm{dn}(\omega t, m)` with :math:`\omega^2 = \beta a^2/2`,
  :math:`m = 2 + 2\alpha/\beta a^2`, of period :math:`2K(m)/\omega`.
"""

from __future__ import annotations

import mpmath
import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem, decades

PARAMETERS = {"alpha": -1.0, "beta": 1.0}
#: Amplitudes in units of the wells' distance from 0; the separatrix is at sqrt(2).
WELLS = {"one-well": 1.2, "near-separatrix": 1.4142, "both-wells": 1.8}


def exact(
    alpha: float | mpmath.mpf, beta: float | mpmath.mpf, a: float | mpmath.mpf, t: float | mpmath.mpf
) -> tuple[mpmath.mpf, mpmath.mpf]:
    """Return (q(t), period) from rest at the outer turning point a > 0, in mpmath's working precision."""
    alpha, beta, a = mpmath.mpf(alpha), mpmath.mpf(beta), mpmath.mpf(a)
    if alpha + beta * a**2 / 2 > 0:
        w = mpmath.sqrt(alpha + beta * a**2)
        m, function, quarters = beta * a**2 / (2 * w**2), "cn", 4
    else:
        w = mpmath.sqrt(beta / 2) * a
        m, function, quarters = 2 + 2 * alpha / (beta * a**2), "dn", 2
    return a * mpmath.ellipfun(function, w * t, m=m), quarters * mpmath.ellipk(m) / w


def make(alpha: float, beta: float) -> Problem:
    """Make the oscillator, ``beta`` > 0: two wells have the orbits of `WELLS`, one has "one-well" from q = 1."""
    if not beta > 0:
        raise InvalidInput(f"beta is {beta}; it must be positive: the motion is to be bounded")
    q, p = sp.symbols("q p", real=True)
    H = p**2 / 2 + sp.Rational(alpha) * q**2 / 2 + sp.Rational(beta) * q**4 / 4
    amplitudes = {k: x * (-alpha / beta) ** 0.5 for k, x in WELLS.items()} if alpha < 0 else {"one-well": 1.0}
    return Problem(
        id="duffing",
        name="Duffing oscillator",
        source="Duffing 1918; Guckenheimer & Holmes 1983, section 2.2; NIST DLMF, 22.19(ii) (the solutions)",
        cite=("guckenheimer1983",),
        system=Hamiltonian(q=[q], p=[p], H=H),
        orbits=tuple(Orbit(k, (a,), (0.0,), f"at rest at q = {a:g}", decades(200.0)) for k, a in amplitudes.items()),
    )
