r"""The relative motion of two spinning black holes, post-Newtonian to second order (2PN), in canonical variables.

Units: total mass, gravitational constant and semi-major axis of the Newtonian orbit are 1, momenta are divided by the
reduced mass :math:`\eta = m_1 m_2`; :math:`\epsilon` is the orbital speed over that of light.  With n = q / r and the
spins :math:`S_i` of lengths :math:`\Lambda_i = \epsilon\chi_i m_i/m_j`,

.. math::
    H = \tfrac12p^2 - \tfrac1r &+ \epsilon^2\Bigl[\tfrac18(3\eta - 1)p^4
        - \tfrac1{2r}\bigl((3 + \eta)p^2 + \eta(n\cdot p)^2\bigr) + \tfrac1{2r^2}\Bigr] \\
    &+ \epsilon^4\Bigl[\tfrac1{16}(1 - 5\eta + 5\eta^2)p^6
        + \tfrac1{8r}\bigl((5 - 20\eta - 3\eta^2)p^4 - 2\eta^2p^2(n\cdot p)^2 - 3\eta^2(n\cdot p)^4\bigr) \\
    &\qquad + \tfrac1{2r^2}\bigl((5 + 8\eta)p^2 + 3\eta(n\cdot p)^2\bigr) - \tfrac1{4r^3}(1 + 3\eta)\Bigr] \\
    &+ \frac{\epsilon^2}{r^3}\Bigl[(q\times p)\cdot\sum_i\bigl(2\eta + \tfrac32m_j^2\bigr)S_i
        + \tfrac32(n\cdot A)^2 - \tfrac12A^2\Bigr] , \qquad A = m_2S_1 + m_1S_2 .

A spin is :math:`(\rho\cos\theta, \rho\sin\theta, \xi)`, :math:`\rho^2 = \Lambda^2 - \xi^2`, with the conjugate
variables :math:`\theta` in q and :math:`\xi` in p.  The total angular momentum :math:`q\times p + S_1 + S_2` is
conserved.  :math:`\epsilon = 0` is the Kepler problem.

Start: at the pericentre of the Newtonian orbit, in the plane of x and y, to which both spins are inclined.
"""

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Pace, Problem, check_positive, decades
from .kepler import pericentre

PARAMETERS = {"ratio": 0.5, "chi1": 0.9, "chi2": 0.6, "e": 0.6, "eps": 0.125}
#: Of each spin at the start: the azimuth theta, and xi over the length; the spins stay away from the poles of theta.
DIRECTIONS = ((0.0, 0.25), (2.0, -0.25))


def make(ratio: float, chi1: float, chi2: float, e: float, eps: float) -> Problem:
    """Make the problem; ``ratio`` is m2 / m1 > 0, ``chi1`` and ``chi2`` are the spins over the greatest possible ones.

    0 <= ``e`` < 1 is the eccentricity of the Newtonian orbit, ``eps`` >= 0 its speed over that of light.
    """
    check_positive("the binary", ratio=ratio)
    if not eps >= 0:
        raise InvalidInput(f"the speed eps is {eps}; it must not be negative")
    for name, chi in (("chi1", chi1), ("chi2", chi2)):
        if not 0 <= chi <= 1:
            raise InvalidInput(f"the spin {name} is {chi}; it must be from 0 to 1")
    *names, theta1, theta2 = sp.symbols("x y z theta1 theta2", real=True)
    *momenta, xi1, xi2 = sp.symbols("p_x p_y p_z xi1 xi2", real=True)
    q, p, k = sp.Matrix(names), sp.Matrix(momenta), sp.Rational(eps) ** 2
    r = sp.sqrt(q.dot(q))
    m1 = 1 / (1 + sp.Rational(ratio))
    m2 = 1 - m1
    eta, p2, radial = m1 * m2, p.dot(p), (q.dot(p) / r) ** 2
    first = (3 * eta - 1) * p2**2 / 8 - ((3 + eta) * p2 + eta * radial) / (2 * r) + 1 / (2 * r**2)
    second = (
        (1 - 5 * eta + 5 * eta**2) * p2**3 / 16
        + ((5 - 20 * eta - 3 * eta**2) * p2**2 - 2 * eta**2 * p2 * radial - 3 * eta**2 * radial**2) / (8 * r)
        + ((5 + 8 * eta) * p2 + 3 * eta * radial) / (2 * r**2)
        - (1 + 3 * eta) / (4 * r**3)
    )
    lengths = [sp.Rational(eps) * sp.Rational(chi1) * m1 / m2, sp.Rational(eps) * sp.Rational(chi2) * m2 / m1]
    spins = []
    for length, theta, xi in zip(lengths, (theta1, theta2), (xi1, xi2), strict=True):
        rho = sp.sqrt(length**2 - xi**2)
        spins.append(sp.Matrix([rho * sp.cos(theta), rho * sp.sin(theta), xi]) if length else sp.zeros(3, 1))
    S1, S2 = spins
    orbital, A = q.cross(p), m2 * S1 + m1 * S2
    coupling = orbital.dot((2 * eta + 3 * m2**2 / 2) * S1 + (2 * eta + 3 * m1**2 / 2) * S2)
    coupling += 3 * (q.dot(A) / r) ** 2 / 2 - A.dot(A) / 2
    kept = {f"angular-momentum-{i + 1}": J for i, J in enumerate(orbital + S1 + S2)}
    start = pericentre(e, ())
    xi0 = [float(length) * part for length, (_, part) in zip(lengths, DIRECTIONS, strict=True)]
    return Problem(
        id="spinning-binary",
        name="two spinning black holes, post-Newtonian to second order",
        source="Damour 2001, Phys. Rev. D 64, 124013; Buonanno, Chen & Damour 2006, Phys. Rev. D 74, 104005; the spin "
        "variables: Wu & Xie 2010, Phys. Rev. D 81, 084045; data: this suite",
        cite=("damour2001", "buonanno2006", "wu-xie2010"),
        system=Hamiltonian(
            q=[*q, theta1, theta2],
            p=[*p, xi1, xi2],
            H=p2 / 2 - 1 / r + k * first + k**2 * second + k * coupling / r**3,
            singular=[r],
            invariants=kept.values(),
        ),
        orbits=(
            Orbit(
                "precessing",
                (*start.q, 0.0, *(theta for theta, _ in DIRECTIONS)),
                (*start.p, 0.0, *xi0),
                f"pericentre of eccentricity {e:g}, inclined spins",
                decades(100.0),
            ),
        ),
        invariants=kept,
        pace=Pace(step=0.15, span=2.0, later=0.7),
    )
