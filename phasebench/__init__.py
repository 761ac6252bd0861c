"""phasebench: a validation benchmark suite for geometric integrators of Hamiltonian systems.

>>> import phasebench as pb
>>> pendulum = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
>>> pb.integrate(pendulum, "scheme-i", parameters={"lam": -1}, h=0.01, t_end=1.0, q0=[1.0], p0=[0.0]).status
'ok'
>>> pb.integrate("henon-heiles:box", "heyoka", t_end=10.0).status
'ok'
"""

from __future__ import annotations

from phasebench.integrators.compile import lazy as _lazy

#: True to a type checker; the module typing would double the time of an import.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from phasebench.benchmarks.advice.table import Advice as Advice
    from phasebench.benchmarks.advice.table import advise as advise
    from phasebench.benchmarks.audit.audit import Audit as Audit
    from phasebench.benchmarks.audit.audit import audit as audit
    from phasebench.benchmarks.certificate.certificate import validate as validate
    from phasebench.benchmarks.certificate.maps import validate_map as validate_map
    from phasebench.benchmarks.certificate.result import Certificate as Certificate
    from phasebench.benchmarks.measure.certify import CertifiedState as CertifiedState
    from phasebench.benchmarks.measure.certify import References as References
    from phasebench.benchmarks.measure.certify import certify as certify
    from phasebench.benchmarks.measure.chaos import Lyapunov as Lyapunov
    from phasebench.benchmarks.measure.chaos import lyapunov as lyapunov
    from phasebench.benchmarks.measure.ensembles import Ensemble as Ensemble
    from phasebench.benchmarks.measure.ensembles import Section as Section
    from phasebench.benchmarks.measure.ensembles import integrate_ensemble as integrate_ensemble
    from phasebench.benchmarks.measure.ensembles import section as section
    from phasebench.benchmarks.measure.integration import integrate as integrate
    from phasebench.benchmarks.measure.integration import prepare as prepare
    from phasebench.benchmarks.measure.integrator import Integrator as Integrator
    from phasebench.benchmarks.measure.integrator import integrator as integrator
    from phasebench.benchmarks.measure.oscillator import Stability as Stability
    from phasebench.benchmarks.measure.oscillator import stability as stability
    from phasebench.benchmarks.measure.own_step import System as System
    from phasebench.benchmarks.measure.series import Drift as Drift
    from phasebench.benchmarks.measure.series import drift as drift
    from phasebench.benchmarks.measure.solution import Solution as Solution
    from phasebench.benchmarks.problems import PROBLEMS as PROBLEMS
    from phasebench.benchmarks.problems import problem as problem
    from phasebench.benchmarks.problems.base import Orbit as Orbit
    from phasebench.benchmarks.problems.base import Problem as Problem
    from phasebench.benchmarks.problems.planetary import planetary_system as planetary_system
    from phasebench.benchmarks.workprecision import WorkPrecision as WorkPrecision
    from phasebench.benchmarks.workprecision import workprecision as workprecision
    from phasebench.integrators.errors import InvalidInput as InvalidInput
    from phasebench.integrators.prepared import PreparedRun as PreparedRun
    from phasebench.integrators.record import Method as Method
    from phasebench.integrators.registry import METHODS as METHODS
    from phasebench.integrators.registry import method as method
    from phasebench.integrators.statuses import STATUSES as STATUSES
    from phasebench.integrators.systems.constrained import ConstrainedHamiltonian as ConstrainedHamiltonian
    from phasebench.integrators.systems.hamiltonian import Hamiltonian as Hamiltonian
    from phasebench.integrators.systems.parts import SplitHamiltonian as SplitHamiltonian
    from phasebench.integrators.systems.rigid import RigidBody as RigidBody
    from phasebench.reference.peers import PEERS as PEERS
    from phasebench.reference.peers import Peer as Peer
    from phasebench.reference.peers.prepared import PreparedPeer as PreparedPeer

    __version__: str

#: Public name -> the package or module that it comes from, loaded when it is first asked for.
_HOMES = {
    "Advice": "benchmarks.advice.table",
    "Audit": "benchmarks.audit.audit",
    "Certificate": "benchmarks.certificate.result",
    "CertifiedState": "benchmarks.measure.certify",
    "ConstrainedHamiltonian": "integrators",
    "Drift": "benchmarks.measure.series",
    "Ensemble": "benchmarks.measure.ensembles",
    "Hamiltonian": "integrators",
    "Integrator": "benchmarks.measure.integrator",
    "InvalidInput": "integrators",
    "Lyapunov": "benchmarks.measure.chaos",
    "METHODS": "integrators",
    "Method": "integrators",
    "Orbit": "benchmarks.problems.base",
    "PEERS": "reference.peers",
    "PROBLEMS": "benchmarks.problems",
    "Peer": "reference.peers",
    "PreparedPeer": "reference.peers.prepared",
    "PreparedRun": "integrators.prepared",
    "Problem": "benchmarks.problems.base",
    "RigidBody": "integrators",
    "STATUSES": "integrators.statuses",
    "References": "benchmarks.measure.certify",
    "Section": "benchmarks.measure.ensembles",
    "Solution": "benchmarks.measure.solution",
    "SplitHamiltonian": "integrators",
    "Stability": "benchmarks.measure.oscillator",
    "System": "benchmarks.measure.own_step",
    "WorkPrecision": "benchmarks.workprecision",
    "advise": "benchmarks.advice.table",
    "audit": "benchmarks.audit.audit",
    "certify": "benchmarks.measure.certify",
    "drift": "benchmarks.measure.series",
    "integrate": "benchmarks.measure.integration",
    "integrate_ensemble": "benchmarks.measure.ensembles",
    "integrator": "benchmarks.measure.integrator",
    "lyapunov": "benchmarks.measure.chaos",
    "method": "integrators",
    "planetary_system": "benchmarks.problems.planetary",
    "prepare": "benchmarks.measure.integration",
    "problem": "benchmarks.problems",
    "section": "benchmarks.measure.ensembles",
    "stability": "benchmarks.measure.oscillator",
    "validate": "benchmarks.certificate.certificate",
    "validate_map": "benchmarks.certificate.maps",
    "workprecision": "benchmarks.workprecision",
}
__all__ = sorted(_HOMES)


_public = _lazy.attributes(__name__, _HOMES)


if not TYPE_CHECKING:  # a type checker sees the imports above

    def __getattr__(name: str):
        # Numba loads only when a system or a kernel is asked for.
        if name == "__version__":
            from importlib.metadata import version

            return version("phasebench")
        return _public(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
