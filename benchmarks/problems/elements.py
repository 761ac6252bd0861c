r"""Position and velocity on an ellipse from its orbital elements, under the names of REBOUND's keywords.

With :math:`\mu = G (m_0 + m)`, the mean motion :math:`n = \sqrt{\mu / a^3} = 2\pi / P` and the eccentric anomaly E from
:math:`E - e\sin E = M`, the orbit has in its plane

.. math:: x = a(\cos E - e),\quad y = a\sqrt{1 - e^2}\sin E,\quad
          (\dot x, \dot y) = \frac{\sqrt{\mu a}}{r}\left(-\sin E, \sqrt{1 - e^2}\cos E\right),

turned by omega about z, by inc about x and by Omega about z.  The longitudes pomega, l and theta are Omega plus omega,
plus M, plus f; above inc = 90 degrees, where the motion is retrograde, Omega less these.  At the time T the body is at
the pericentre, at T0 in transit: nearest to an observer far out on the z axis, where f + omega is 90 degrees.

Source: C. D. Murray, A. C. M. Correia, in Exoplanets (2010) 15-23; J. N. Winn, ibid. 55-77 (transits); H. Rein, S.-F.
Liu, Astron. Astrophys. 537 (2012) A128 (the keywords).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mpmath

from phasebench.integrators.errors import InvalidInput

#: Elements of which a body has one: the size of the orbit, the pericentre, the place on the orbit; the first is usual.
SIZES, PERICENTRES, PLACES = ("a", "P"), ("omega", "pomega"), ("M", "f", "l", "theta", "T", "T0")
KEYWORDS = (*SIZES, "e", "inc", "Omega", *PERICENTRES, *PLACES)
ANGLES = ("inc", "Omega", *PERICENTRES, *PLACES[:4])

Vector = tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf]


def state(place: str, given: Mapping[str, float], mu: mpmath.mpf) -> tuple[Vector, Vector]:
    """Return (position, velocity) relative to the centre of attraction, with mpmath's precision.

    Parameters
    ----------
    place : where the elements stand, for messages
    given : name of an element, of `KEYWORDS` -> number, angles in degrees; those that are missing are 0
    mu : G times the sum of the masses

    Raises InvalidInput for an orbit that is not bound, without a size, or with two elements that say the same.
    """
    for group in (SIZES, PERICENTRES, PLACES):
        several = [name for name in group if name in given]
        if len(several) > 1:
            raise InvalidInput(f"{place}, columns {' and '.join(several)}: they say the same; give one of them")
    known = {name: mpmath.radians(x) if name in ANGLES else mpmath.mpf(x) for name, x in given.items()}
    size = next((name for name in SIZES if name in given), None)
    if size is None:
        raise InvalidInput(f"{place}, column a: it is empty; give the semi-major axis, or the period P")
    e, inc, node = (known.get(name, mpmath.mpf(0)) for name in ("e", "inc", "Omega"))
    if known[size] <= 0:
        what = "the semi-major axis" if size == "a" else "the period"
        raise InvalidInput(f"{place}, column {size}: {what} is {given[size]:g}; it must be positive")
    if not 0 <= e < 1:
        hint = "; give an orbit that is not bound by x, y, z, vx, vy, vz" if e >= 1 else ""
        raise InvalidInput(
            f"{place}, column e: the eccentricity is {given['e']:g}; it must be at least 0 and below 1{hint}"
        )
    n = 2 * mpmath.pi / known["P"] if size == "P" else mpmath.sqrt(mu / known["a"] ** 3)
    a = known["a"] if size == "a" else mpmath.cbrt(mu / n**2)
    sense = 1 if mpmath.cos(inc) > 0 else -1
    pericentre = sense * (known["pomega"] - node) if "pomega" in known else known.get("omega", mpmath.mpf(0))
    M = _mean_anomaly(known, e, n, node, pericentre, sense)
    M = M - 2 * mpmath.pi * mpmath.nint(M / (2 * mpmath.pi))
    E = _anomaly(M, e)
    c, s, b = mpmath.cos(E), mpmath.sin(E), mpmath.sqrt(1 - e**2)
    speed = mpmath.sqrt(mu / a) / (1 - e * c)
    turn = _rotation(inc, node, pericentre)
    return turn(a * (c - e), a * b * s), turn(-speed * s, speed * b * c)


def _mean_anomaly(
    known: Mapping[str, mpmath.mpf],
    e: mpmath.mpf,
    n: mpmath.mpf,
    node: mpmath.mpf,
    pericentre: mpmath.mpf,
    sense: int,
) -> mpmath.mpf:
    """The mean anomaly at the time 0 from the one element of `PLACES` that is known; 0 if none is."""
    if "l" in known:
        return sense * (known["l"] - node) - pericentre
    if "T" in known:
        return -n * known["T"]
    if "T0" in known:
        return _mean_of_true(mpmath.pi / 2 - pericentre, e) - n * known["T0"]
    if "theta" in known:
        return _mean_of_true(sense * (known["theta"] - node) - pericentre, e)
    if "f" in known:
        return _mean_of_true(known["f"], e)
    return known.get("M", mpmath.mpf(0))


def _mean_of_true(f: mpmath.mpf, e: mpmath.mpf) -> mpmath.mpf:
    E = mpmath.atan2(mpmath.sqrt(1 - e**2) * mpmath.sin(f), e + mpmath.cos(f))
    return E - e * mpmath.sin(E)


def _anomaly(M: mpmath.mpf, e: mpmath.mpf) -> mpmath.mpf:
    """Solve Kepler's equation E - e sin E = M for E, |M| <= pi, by Newton's method from above (monotonic there)."""
    E = min(abs(M) + e, mpmath.pi)
    least = mpmath.mpf(10) ** (5 - mpmath.mp.dps)
    for _ in range(200):
        step = (E - e * mpmath.sin(E) - abs(M)) / (1 - e * mpmath.cos(E))
        E -= step
        if abs(step) <= least * E:
            break
    return E if M >= 0 else -E


def _rotation(inc: mpmath.mpf, node: mpmath.mpf, pericentre: mpmath.mpf) -> Callable[..., Vector]:
    """Make the function (x, y) -> (X, Y, Z) from an orbit's plane, x towards the pericentre, to space."""
    cO, sO, co, so = mpmath.cos(node), mpmath.sin(node), mpmath.cos(pericentre), mpmath.sin(pericentre)
    ci, si = mpmath.cos(inc), mpmath.sin(inc)

    def turn(x: mpmath.mpf, y: mpmath.mpf) -> Vector:
        u, w = co * x - so * y, so * x + co * y
        return cO * u - sO * ci * w, sO * u + cO * ci * w, si * w

    return turn
