"""The degree of a polynomial H up to which a Hamiltonian boundary value method (HBVM) conserves the energy.

Source: L. Brugnano, F. Iavernaro, D. Trigiante, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 17-37.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem


def too_few_nodes(method: str, system: PartitionedSystem) -> bool:
    """True if HBVM(k, s), with k nodes and order 2 s, has too few nodes to conserve a system's H.

    It conserves polynomials of degree at most 2k/s; for an H that is no polynomial the answer is True.  ``method`` is
    the method's id, "hbvm-k-s"; for the id of any other method the answer is False.
    """
    kind, *sizes = method.split("-")
    if kind != "hbvm":
        return False
    degree = system.polynomial_degree
    return degree is None or degree > 2 * int(sizes[0]) / int(sizes[1])
