r"""Splittings with modified kicks, :math:`e^{b h B + c h^3 C}` with :math:`C = [B, [A, B]]`.

A is the drift by T(p), B the kick by V(q).  Where T is quadratic C is a kick,
:math:`p \leftarrow p + c h^3\,\nabla(\nabla V\cdot M^{-1}\nabla V)`.  A step is a product of drifts and modified kicks,
a series over words of A and B modulo :math:`[B, [B, [B, A]]] = 0`, as that of a Nystrom splitting (`order_conditions`);
its order is the degree up to which it equals :math:`e^{A + B}`.  Tables are given as published; `polish` solves these
conditions for the numbers nearest to the published ones, to 60 digits.

In a name nF mG, a step has n forces, m of them with a gradient; V begins with a kick (velocity), P with a drift
(position).

Sources: M. Takahashi, M. Imada, J. Phys. Soc. Jpn. 53 (1984) 3765-3769; S. A. Chin, Phys. Lett. A 226 (1997) 344-348;
S. A. Chin, C. R. Chen, J. Chem. Phys. 117 (2002) 1409-1415; I. P. Omelyan, I. M. Mryglod, R. Folk, Phys. Rev. E 66
(2002) 026701 and Comput. Phys. Commun. 151 (2003) 272-314; J. Laskar, P. Robutel, Celest. Mech. Dyn. Astron. 80 (2001)
39-62 (correctors); K. Schaefers et al., arXiv:2403.10370 (Hessian-free).  Omelyan's numbers are as the program MDevolve
lists them with their equations, the Hessian-free ones as the authors' program openQCD_force-gradient does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import mpmath
import numpy as np

from . import gauss
from .fractions import DIGITS, mirror
from .order_conditions import normal_form
from .polish import DIFFERENCE
from .polish import polish as nearest_solution
from .polished_file import PolishedFile
from .table import Table

#: A drift ("A", a, 0) or a modified kick ("B", b, c).
Substep = tuple[str, mpmath.mpf, mpmath.mpf]


@dataclass(frozen=True)
class ForceGradientTable(Table):
    """A symmetric splitting into drifts exp(a h A) and modified kicks exp(b h B + c h^3 C), as published.

    Attributes
    ----------
    a, b, ... : as in `Table`: a are the coefficients of the drifts, b those of the kicks
    c : coefficients of the force gradient C = [B, [A, B]], as text, one for each number of ``b``
    hessian_free : True if the kick is approximated by two evaluations of the force, without the Hessian (`residual`)
    """

    c: tuple[str, ...] = ()
    hessian_free: bool = False

    @property
    def published(self) -> tuple[str, ...]:
        """Every published number as text: a, b, and then c."""
        return self.a + self.b + self.c

    @property
    def digest(self) -> str:
        """A hash of the published numbers and of the fields that say how they are used.

        Numbers refined to more digits are stored with it, and are used only as long as the table still has this hash.
        """
        used = self.order, self.a, self.b, self.c, self.first, self.hessian_free
        return hashlib.sha256(repr(used).encode()).hexdigest()[:16]

    def steps(self, numbers: Sequence[mpmath.mpf]) -> list[Substep]:
        """All substeps, drifts ("A", a, 0) and modified kicks ("B", b, c), from numbers in the order of `published`."""
        n, m = len(self.a), len(self.a) + len(self.b)
        drifts = [("A", a, mpmath.mpf(0)) for a in numbers[:n]]
        kicks = [("B", b, c) for b, c in zip(numbers[n:m], numbers[m:], strict=True)]
        rows = zip_longest(drifts, kicks) if self.first == "A" else zip_longest(kicks, drifts)
        return list(mirror([x for row in rows for x in row if x is not None]))


def _times_kick(b: mpmath.mpf, c: mpmath.mpf, series: list[np.ndarray]) -> list[np.ndarray]:
    """Multiply a series S from the left by exp(b B + c C), a modified kick, with C = [B, [A, B]]; return the product.

    ``series`` has the coefficients of S as in `_times_drift`.
    """
    out, term = [x.copy() for x in series], series
    for k in range(1, len(series)):
        term = _times_generator(b / k, c / k, term)
        out = [x + y for x, y in zip(out, term, strict=True)]
    return out


def _times_generator(b: mpmath.mpf, c: mpmath.mpf, series: list[np.ndarray]) -> list[np.ndarray]:
    """Multiply a series S from the left by b B + c C, with C = 2 BAB - BBA - ABB; return the product.

    ``series`` has the coefficients of S as in `_times_drift`.
    """
    out = [x * 0 for x in series]
    for n in range(1, len(series)):
        out[n][2 ** (n - 1) :] = series[n - 1] * b
        if n >= 3 and c != 0:
            for prefix, factor in ((0b101, 2), (0b110, -1), (0b011, -1)):
                part = slice(prefix * 2 ** (n - 3), (prefix + 1) * 2 ** (n - 3))
                out[n][part] = out[n][part] + series[n - 3] * (factor * c)
    return out


def _times_drift(a: mpmath.mpf, series: list[np.ndarray]) -> list[np.ndarray]:
    """Multiply a series S from the left by exp(a A), a drift; return the product.

    Item n of ``series`` is an array (2^n,): the coefficients in S of all words (products) of n letters A, B.  Words
    that begin with A stand in the first half.
    """
    out = [x.copy() for x in series]
    for n in range(1, len(series)):
        factor = mpmath.mpf(1)
        for k in range(1, n + 1):
            factor = factor * a / k
            out[n][: 2 ** (n - k)] = out[n][: 2 ** (n - k)] + series[n - k] * factor
    return out


def residuals(steps: Sequence[Substep], degree: int) -> list[np.ndarray]:
    """Coefficients of a step minus exp(A + B), the exact flow: for each degree 0, ..., ``degree`` an array over words.

    ``steps`` are the step's substeps.  A word is a product of letters A and B, as many as its degree; words are reduced
    to normal form by [B, [B, [B, A]]] = 0.
    """
    with mpmath.workdps(max(DIGITS, mpmath.mp.dps)):
        series = [np.full(2**n, mpmath.mpf(n == 0), dtype=object) for n in range(degree + 1)]
        for letter, weight, c in reversed(list(steps)):
            series = _times_drift(weight, series) if letter == "A" else _times_kick(weight, c, series)
        return [normal_form(x - 1 / mpmath.factorial(n)) for n, x in enumerate(series)]


def residual(table: ForceGradientTable, numbers: Sequence[mpmath.mpf]) -> np.ndarray:
    r"""The error coefficients that vanish if the table has its order: those of odd degree, since the step is symmetric.

    A kick without the Hessian differs from the modified one by :math:`2 c^2 h^5 / b\,V'''(M^{-1}\nabla V,
    M^{-1}\nabla V)` and terms of degree 7, so that order 6 needs the sum of :math:`c^2 / b` to vanish, too.
    """
    steps = table.steps(numbers)
    found = np.concatenate(residuals(steps, table.order[0] - 1)[1::2])
    if not table.hessian_free or table.order[0] < 6:
        return found
    return np.append(found, mpmath.fsum(c * c / b for letter, b, c in steps if letter == "B"))


def _jacobian(table: ForceGradientTable, x: np.ndarray, free: Sequence[int]) -> np.ndarray:
    """The matrix of derivatives of `residual` at x, by central differences.

    Its columns are for the numbers of x with the indices ``free``.
    """
    columns = []
    for k in free:
        above, below = x.copy(), x.copy()
        above[k], below[k] = x[k] + DIFFERENCE, x[k] - DIFFERENCE
        columns.append((residual(table, above) - residual(table, below)) / (2 * DIFFERENCE))
    return np.array(columns, dtype=object).T


def polish(table: ForceGradientTable) -> list[mpmath.mpf]:
    """The solution of the order conditions nearest to the published numbers, to full precision.

    Raises ArithmeticError if their residual does not fall to round-off.
    """
    return nearest_solution(table, residual=residual, jacobian=_jacobian)


def excess(table: ForceGradientTable, numbers: Sequence[mpmath.mpf]) -> mpmath.mpf:
    """The largest residual of the order conditions, in absolute value, of a table with these numbers."""
    return max(map(abs, residual(table, numbers)))


def _table(
    name: str, order: int, source: str, cite: tuple[str, ...], first: str, a: str, b: str, c: str
) -> ForceGradientTable:
    a, b, c = (tuple(text.split()) for text in (a, b, c))
    return ForceGradientTable(name, "force-gradient", (order,), source, cite, a=a, b=b, c=c, first=first)


def _omelyan(name: str, order: int, equation: str, first: str, a: str, b: str, c: str) -> ForceGradientTable:
    source = f"Omelyan, Mryglod & Folk 2003, ({equation})"
    return _table(f"omelyan-{name}", order, source, ("omelyan2003",), first, a, b, c)


def _schaefers(letters: str, order: int, a: str, b: str, c: str) -> ForceGradientTable:
    source = f"Schaefers, Finkenrath, Guenther & Knechtli 2024, {letters}"
    cite, first = ("schaefers2024",), "A" if letters[0] == "A" else "B"
    return replace(_table(f"hessian-free-{letters.lower()}", order, source, cite, first, a, b, c), hessian_free=True)


def _corrected(n: int, half: str) -> ForceGradientTable:
    """Make the table of SABAC_n: half of a corrector, the splitting SABA_n, and the other half of the corrector.

    Each half is a modified kick with b = 0 and c = ``half``.
    """
    table = gauss.saba(n)
    source, c = f"Laskar & Robutel 2001, SABAC_{n}", " ".join([half, *["0"] * len(table.b)])
    return _table(f"sabac-{n}", 4, source, table.cite, "B", " ".join(table.a), " ".join(("0", *table.b)), c)


_CHIN = ("chin1997",)

TABLES: tuple[ForceGradientTable, ...] = (
    _table("takahashi-imada", 2, "Takahashi & Imada 1984", ("takahashi-imada1984",), "A", "1/2", "1", "1/24"),
    _table("chin-4a", 4, "Chin 1997, algorithm A", _CHIN, "B", "1/2", "1/6 2/3", "0 1/72"),
    _table(
        "chin-4b",
        4,
        "Chin 1997, algorithm B",
        _CHIN,
        "A",
        "0.21132486540518711775 0.57735026918962576451",
        "1/2",
        "0.0055822748423150563848",
    ),
    _table("chin-4c", 4, "Chin 1997, algorithm C", _CHIN, "A", "1/6 1/3", "3/8 1/4", "0 1/192"),
    _table("chin-4d", 4, "Chin & Chen 2002, algorithm D", ("chin-chen2002",), "B", "1/3 1/3", "1/8 3/8", "0 1/384"),
    _omelyan("4-2f2g-v", 4, "28", "B", "1/2", "1/6 2/3", "-17/18000 71/4500"),
    _omelyan(
        "4-3f3g-v",
        4,
        "36",
        "B",
        "0.2728983001988755 0.454203399602249",
        "0.08002565306418874 0.41997434693581126",
        "0.0002725753410753873 0.002960781208329478",
    ),
    _omelyan(
        "4-3f2g-v",
        4,
        "37",
        "B",
        "0.2813980611667719 0.4372038776664562",
        "0.08789368601680707 0.4121063139831929",
        "0 0.0030618101223697743",
    ),
    _omelyan(
        "4-3f1g-v",
        4,
        "38",
        "B",
        "0.2409202729169543 0.5181594541660914",
        "0.04432204907934767 0.45567795092065233",
        "0.004179297897540417 0",
    ),
    _omelyan(
        "4-3f3g-p",
        4,
        "42",
        "A",
        "0.11599536084864154 0.38400463915135846",
        "0.2825633404177051 0.4348733191645898",
        "0.0012260889895363604 0.003035236056708454",
    ),
    _omelyan(
        "4-3f2g-p",
        4,
        "43",
        "A",
        "0.1364371009136296 0.3635628990863704",
        "0.3152315246820299 0.36953695063594016",
        "0.0024272119854875976 0",
    ),
    _omelyan(
        "4-3f1g-p",
        4,
        "44",
        "A",
        "0.08935804763220157 0.4106419523677984",
        "0.2470939580390842 0.5058120839218316",
        "0 0.006938106540706989",
    ),
    _omelyan(
        "4-4f2g-vg",
        4,
        "53",
        "B",
        "0.1921125277429464 0.3078874722570536",
        "0.05851872613455621 0.2852162240687091 0.31253009959346938",
        "0.0004339598806816256 0 0.002427475259663050",
    ),
    _omelyan(
        "4-4f2g-v",
        4,
        "54",
        "B",
        "0.2189286596427438 0.2810713403572562",
        "0.06840805970727767 0.3109406355938166 0.24130260939781146",
        "0 0.001602503681334363 0",
    ),
    _omelyan(
        "4-5f2g-v",
        4,
        "68",
        "B",
        "0.2029270564692829 0.1926052063353027 0.2089354743908288",
        "0.06668876199434440 0.2620356629687677 0.1712755750368879",
        "0 0.001042387551227681 0",
    ),
    _omelyan(
        "4-5f2g-p",
        4,
        "78",
        "A",
        "0.06419108866816235 0.1919807940455741 0.24382811728626355",
        "0.1518179640276466 0.2158369476787619 0.264690176587183",
        "0 0.0009628905212024874 0",
    ),
    _omelyan(
        "4-5f1g-v",
        4,
        "70",
        "B",
        "0.2797644436188271 -0.001180329820696323 0.4428317724037385",
        "0.08010998355755116 -2.0220148671481104 2.44190488359055924",
        "0.0003098750751031143 0 0",
    ),
    _omelyan(
        "4-5f1g-p",
        4,
        "79",
        "A",
        "0.1255768596433302 -0.002407093745014925 0.376830234101684725",
        "-0.8938074259467744 1.1758501877269955 0.4359144764395578",
        "0 0 0.002952744354631969",
    ),
    _table(
        "omelyan-6-4f3g-v",
        6,
        "Omelyan, Mryglod & Folk 2002, Phys. Rev. E 66, G6'",
        ("omelyan2002b",),
        "B",
        "1.0798524263824310 -0.5798524263824310",
        "0.35995080879414365 -0.14371472730265417 0.56752783701702104",
        "0 -0.013965254224239 -0.039247029382346",
    ),
    _omelyan(
        "6-5f5g-v",
        6,
        "64",
        "B",
        "0.5309910490348568 -0.2573883543804353 0.452794610691157",
        "0.08281492492827128 0.008354543940755644 0.40883053113097308",
        "-0.0001633190022736910 -0.0002401600937577623 0.004267631995107088",
    ),
    _omelyan(
        "6-5f4g-v",
        6,
        "64",
        "B",
        "0.7236067977499789 -0.4472135954999579 0.447213595499958",
        "1/12 0.0016836191862033 0.4149830474804634",
        "0 -0.00006408390325142108 0.003536306125473645",
    ),
    _omelyan(
        "6-5f5g-p",
        6,
        "73",
        "A",
        "0.1098059301577147 0.4828099940251012 -0.0926159241828159",
        "0.2693816517677854 0.07611936345860829 0.30899796954721262",
        "0.001011249349033012 -0.001803378129376054 0.01083650107661986",
    ),
    _omelyan(
        "6-5f3g-p",
        6,
        "76",
        "A",
        "0.1097059723948682 0.4140632267310831 -0.0237691991259513",
        "0.2693315848935301 1.1319803486515564 -1.802623867090173",
        "0.0008642161339706166 0 -0.01324638643416052",
    ),
    _corrected(2, "0.005582274842315056384844867885294325688691557212283736915504"),
    _corrected(3, "0.002817296681561404701133911884898769335780877956180030288859"),
    _corrected(4, "0.001698387524104300665766078891746071898510706625037437520896"),
    _table("sbabc-2", 4, "Laskar & Robutel 2001, SBABC_2", ("laskar-robutel2001",), "B", "1/2", "1/6 2/3", "1/144 0"),
    _schaefers(
        "BADAB",
        4,
        "1/2",
        "1/6 2/3",
        "0 1/72",
    ),
    _schaefers(
        "ADADA",
        4,
        "0.211324865405187 0.577350269189626",
        "1/2",
        "0.005582274842315",
    ),
    _schaefers(
        "ABADABA",
        4,
        "0.089775972994422 0.410224027005578",
        "0.247597680043986 0.504804639912028",
        "0 0.006911440413815",
    ),
    _schaefers(
        "ADADADA",
        4,
        "0.116438749543126 0.383561250456874",
        "0.283216992495952 0.433566015008096",
        "0.001247201195115 0.002974030329635",
    ),
    _schaefers(
        "ABADABADABA",
        4,
        "0.062702644098210 0.193174566017780 0.244122789884010",
        "0.149293739165427 0.220105234408407 0.261202052852332",
        "0 0.000966194415594 0",
    ),
    _schaefers(
        "BADADADAB",
        6,
        "1.079852426382431 -0.579852426382431",
        "0.359950808794144 -0.143714727302654 0.567527837017021",
        "0 -0.013965254224239 -0.039247029382346",
    ),
    _schaefers(
        "BADADADADAB",
        6,
        "0.270990466773838 0.635374358266882 -0.812729650081440",
        "0.090330155591279 0.430978044876253 -0.021308200467532",
        "0 0.00263743598047 -0.000586445610932",
    ),
)
FILE = PolishedFile("phasebench.integrators.coefficients.force_gradient", TABLES, polish, excess)

if __name__ == "__main__":
    FILE.write()
