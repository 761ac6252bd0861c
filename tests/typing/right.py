"""Right use of the public face: mypy --strict passes on this file."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

import phasebench as pb

Floats = NDArray[np.float64]


def leapfrog(system: pb.System, q: Floats, p: Floats, h: float) -> tuple[Floats, Floats]:
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


def integrate() -> None:
    pendulum = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    solution: pb.Solution = pb.integrate(pendulum, "scheme-v", h=0.1, t_end=10, q0=[2.0], p0=[0.0])
    status: str = solution.status
    end: Floats = solution.q[-1]
    drift = float(np.ptp(solution.energy()))
    print(status, end, drift, solution.counts["steps"], solution.invariants(), solution.error().error)
    print(solution.to_frame(), solution.plot().get_size_inches())
    pb.integrate("henon-heiles:box", "scheme-i", h=0.1, steps=10, parameters={"lam": "1/3"})
    pb.integrate("henon-heiles:box", "scheme-i", h=0.1, steps=10, parameters={"lam": Fraction(1, 3)})
    pb.integrate("henon-heiles:box", pb.method("scheme-i", lam=-1), h=0.1, steps=10, q0=np.array([0.0, 0.1]))
    pb.integrate("henon-heiles:box", "heyoka", t_end=1.0, tol=1e-9)
    bound = pb.ConstrainedHamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + y", constraints=["x**2 + y**2 = 1"])
    print(pb.integrate(bound, "rattle", h=0.1, steps=10, q0=[0.6, -0.8], p0=[0.8, 0.6]).invariants())
    low: float = pb.drift([float(t) for t in range(50)], [0.0] * 50).interval[0]
    record: pb.Method = pb.METHODS["rk4"]
    print(low, record.order, pb.STATUSES["ok"].remedy)
    pb.integrate(pb.problem("kepler", e=0.2), leapfrog, h=0.1, steps=10, time_limit=60.0)


def prepare() -> None:
    run = pb.prepare("pendulum", "stormer-verlet")
    q, p, status = run(0.01, 100)
    print(q[0] + p[0], status.upper())


def many() -> None:
    Q, P = np.array([[0.0, 0.1], [0.0, 0.2]]), np.tile([0.3, 0.0], (2, 1))
    found: pb.Ensemble = pb.integrate_ensemble("henon-heiles", "stormer-verlet", Q, P, h=0.01, t_end=1.0)
    print(found, found.status.tolist(), found.seconds, len(found.to_frame()))
    crossings: pb.Section = pb.section("henon-heiles", "stormer-verlet", Q, P, of="q1", h=0.01, t_end=20.0)
    print(crossings, crossings.counts().sum(), crossings.plot().axes)


def problem_of_one_s_own() -> pb.Problem:
    system = pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**4/4")
    return pb.Problem("mine", "quartic", "own", system, (pb.Orbit("start", (1.0,), (0.0,)),))


def stable() -> None:
    found: pb.Stability = pb.stability("scheme-i", parameters={"lam": 0.25})
    limit: float | None = found.limit
    print(found, limit, found.intervals[0][0])


def questions() -> None:
    advice: pb.Advice = pb.advise(problem_of_one_s_own(), t_end=10.0, accuracy=1e-6)
    if advice.choice is not None:
        print(advice.choice.command, advice.choice.seconds, advice.verified)
    certificate: pb.Certificate = pb.validate(leapfrog, order=2, symplectic=True, requires="separable")
    print(certificate.verdict, certificate.claims[0].claim, certificate.plot("energy"))
    print(pb.workprecision("pendulum", ["pefrl", leapfrog], t_end=10.0).methods)
    print(pb.certify("pendulum").holds, pb.certify("pendulum", t_end=6.0).q[0])
    print(pb.audit(["scipy"], quick=True).contradictions)
