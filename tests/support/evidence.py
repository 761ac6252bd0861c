"""Fabricated rows of measurements, as the judge reads them, and the verdicts of a certificate."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phasebench.benchmarks.certificate.result import Certificate


def order_row(
    on: str = "pendulum", value: float = 2.0, separable: bool = True, terms: Sequence[float] = (1e-17,) * 8
) -> dict:
    """The row of an order ``value`` +- 0.01; ``terms`` are the error's relative coefficients of h, h^2, ..."""
    row = {"on": on, "value": value, "low": value - 0.01, "high": value + 0.01, "separable": separable}
    clean = 0 if isnan(value) else round(value)
    return row | {"terms": list(terms), "clean": clean, "arithmetic": "multiprecision"}


def part(value: float, slope: float = 0.0) -> dict:
    """The row of a long run to t = 500: the size of its error and the error's slope in time +- 1e-12."""
    row = {"value": value, "slope": slope, "low": slope - 1e-12, "high": slope + 1e-12, "scale": 1.0}
    return row | {"steps": 2500, "time": 500.0}


def verdicts(certificate: Certificate) -> dict[str, str]:
    """{name of a requirement or claim: its verdict}."""
    return {j.name: j.verdict for j in certificate.claims}
