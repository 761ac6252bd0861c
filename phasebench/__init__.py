"""phasebench: a validation benchmark suite for geometric integrators of Hamiltonian systems.

>>> import phasebench as pb
>>> pendulum = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
>>> pb.integrate(pendulum, "scheme-i", lam=-1, h=0.01, t_end=1.0, q0=[1.0], p0=[0.0]).status
'ok'
>>> pb.integrate("henon-heiles:box", "heyoka", t_end=10.0).status
'ok'
"""

from __future__ import annotations

from phasebench.integrators.engine import lazy as _lazy

#: Public name -> the package or module that it comes from, loaded when it is first asked for.
_HOMES = {
    "Ensemble": "integrators",
    "Hamiltonian": "integrators",
    "InvalidInput": "integrators",
    "METHODS": "integrators",
    "Orbit": "benchmarks.problems.base",
    "PEERS": "reference.peers",
    "PROBLEMS": "benchmarks.problems",
    "Problem": "benchmarks.problems.base",
    "Solution": "benchmarks.measure.solution",
    "advise": "benchmarks.advice.table",
    "integrate": "benchmarks.measure.integrator",
    "integrate_ensemble": "benchmarks.measure.ensembles",
    "integrator": "benchmarks.measure.integrator",
    "method": "integrators",
    "planetary_system": "benchmarks.problems.planetary",
    "prepare": "benchmarks.measure.integrator",
    "problem": "benchmarks.problems",
    "stability": "benchmarks.measure.oscillator",
    "section": "benchmarks.measure.ensembles",
    "validate": "benchmarks.certificate.certificate",
    "workprecision": "benchmarks.workprecision",
}
__all__ = sorted(_HOMES)


_public = _lazy.attributes(__name__, _HOMES)


def __getattr__(name: str):
    # Numba loads only when a system or a kernel is asked for.
    if name == "__version__":
        from importlib.metadata import version

        return version("phasebench")
    return _public(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
