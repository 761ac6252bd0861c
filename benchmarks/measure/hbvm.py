"""The degree of H up to which a Hamiltonian boundary value method keeps the energy.

Source: L. Brugnano, F. Iavernaro, D. Trigiante, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 17-37.
"""

from __future__ import annotations


def too_few_nodes(method: str, system) -> bool:
    """True if HBVM(k, s) has too few nodes for a system's H: it conserves polynomials of degree at most 2k/s.

    ``method`` is an id; False for other methods.
    """
    kind, *sizes = method.split("-")
    if kind != "hbvm":
        return False
    degree = system.polynomial_degree
    return degree is None or degree > 2 * int(sizes[0]) / int(sizes[1])
