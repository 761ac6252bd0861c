r"""Geodesics in the equatorial plane of a Schwarzschild black hole, q = (t, r, phi), p = (p_t, p_r, p_phi), c = G = 1.

.. math::
    H = \tfrac12 g^{\mu\nu}p_\mu p_\nu
    = -\frac{p_t^2}{2(1 - 2M/r)} + \Bigl(1 - \frac{2M}r\Bigr)\frac{p_r^2}2 + \frac{p_\phi^2}{2r^2} ,

which is -1/2 on the orbit of a body (the time of the system is its proper time) and 0 on a ray of light.  The energy
E = -p_t and the angular momentum p_phi are conserved.  In these coordinates the horizon r = 2M is a singularity.

A bound orbit :math:`r = \ell M/(1 + e\cos\chi)` has
:math:`E^2 = ((\ell - 2)^2 - 4e^2)/(\ell(\ell - 3 - e^2))`, :math:`p_\phi^2 = \ell^2M^2/(\ell - 3 - e^2)` and advances
from pericentre to pericentre by :math:`4\sqrt{\ell/(\ell - 6 + 2e)}\,K(m)`, :math:`m = 4e/(\ell - 6 + 2e)`, which is
:math:`2\pi + 6\pi/\ell` for weak fields; there are none for :math:`\ell\le 6 + 2e`.

"precessing": from the pericentre given by the parameters.  "zoom-whirl": e = 1/2 just outside
:math:`\ell = 6 + 2e`.  "isco": the innermost stable circular orbit r = 6M, E^2 = 8/9, p_phi^2 = 12 M^2.
"photon-sphere": light on the unstable circle r = 3M with p_phi = sqrt(27) M E.
"""

from math import sqrt

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Pace, Problem, decades

PARAMETERS = {"M": 1.0, "semilatus": 10.0, "e": 0.5}


def _pericentre(name: str, M: float, semilatus: float, e: float, times: tuple[float, ...]) -> Orbit:
    x = semilatus - 3 - e**2
    E = sqrt(((semilatus - 2) ** 2 - 4 * e**2) / (semilatus * x))
    about = f"pericentre of semilatus rectum {semilatus:g} M, eccentricity {e:g}"
    return _from(name, semilatus * M / (1 + e), E, semilatus * M / sqrt(x), about, times)


def _from(name: str, r: float, E: float, L: float, about: str, times: tuple[float, ...]) -> Orbit:
    return Orbit(name, (0.0, r, 0.0), (-E, 0.0, L), about, times)


def make(M: float, semilatus: float, e: float) -> Problem:
    """Make the problem of mass ``M`` > 0; "precessing" has 0 <= ``e`` < 1, ``semilatus`` > 6 + 2 e in units of M."""
    if not M > 0:
        raise InvalidInput(f"the mass M is {M}; it must be positive")
    if not 0 <= e < 1:
        raise InvalidInput(f"the eccentricity e is {e}; it must be at least 0 and less than 1")
    if not semilatus > 6 + 2 * e:
        raise InvalidInput(f"the semilatus rectum is {semilatus}; it must be greater than 6 + 2 e = {6 + 2 * e}")
    t, r, phi, pt, pr, pphi = sp.symbols("t r phi p_t p_r p_phi", real=True)
    f = 1 - 2 * sp.Rational(M) / r
    kept = {"p_t": pt, "p_phi": pphi}
    return Problem(
        id="schwarzschild",
        name="geodesics of the Schwarzschild metric",
        source="Schwarzschild 1916; Chandrasekhar, The Mathematical Theory of Black Holes (1983), sections 19-20; "
        "Cutler, Kennefick & Poisson 1994, Phys. Rev. D 50, 3816-3835, section II",
        cite=("chandrasekhar1983", "cutler1994"),
        system=Hamiltonian(
            q=[t, r, phi],
            p=[pt, pr, pphi],
            H=-(pt**2) / (2 * f) + f * pr**2 / 2 + pphi**2 / (2 * r**2),
            singular=[r - 2 * sp.Rational(M)],
            invariants=kept.values(),
        ),
        orbits=(
            _pericentre("precessing", M, semilatus, e, decades(1000.0)),
            _pericentre("zoom-whirl", M, 7.001, 0.5, (*decades(1000.0), 2000.0)),
            _from("isco", 6 * M, sqrt(8 / 9), sqrt(12) * M, "innermost stable circular orbit", decades(1000.0)),
            _from("photon-sphere", 3 * M, 1.0, sqrt(27) * M, "light on the unstable circle", (0.1, 1.0, 10.0, 40.0)),
        ),
        invariants=kept,
        pace=Pace(unit=20.0, step=4.0, span=100.0, later=20.0),
    )
