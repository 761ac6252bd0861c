"""Misuse of the public face: mypy --strict reports every line marked `# wrong`, and no other."""

from __future__ import annotations

import phasebench as pb

solution = pb.integrate("pendulum", "rk4", h=0.1, steps=10)
run = pb.prepare("pendulum", "rk4")
advice = pb.advise("pendulum", t_end=10.0, accuracy=1e-6)
Q, P = [[1.0], [2.0]], [[0.0], [0.0]]

pb.integrate("pendulum", "rk4", h=[0.1], steps=10)  # wrong
pb.integrate("pendulum", "rk4", h=0.1, stepz=3)  # wrong
pb.integrate("pendulum", "scheme-i", h=0.1, steps=10, lam=0.5)  # wrong
pb.integrate("pendulum", "scheme-i", h=0.1, steps=10, parameters={"lam": [0.5]})  # wrong
pb.integrate("pendulum", "rk4", 0.1, 10)  # wrong
pb.integrate("pendulum", "rk4", h=0.1, steps=10, q0="one")  # wrong
pb.integrate(3, "rk4", h=0.1, steps=10)  # wrong
pb.integrate("pendulum", lambda q, p: (q, p), h=0.1, steps=10)  # wrong
pb.prepare("pendulum", "rk4", tolerance=1e-3)  # wrong
run(0.1, 10)[2] + 1  # wrong
solution.states  # wrong
solution.status + 1  # wrong
solution.to_frame(3)  # wrong
pb.integrate_ensemble("pendulum", "rk4", Q, P, h=0.1, step=10)  # wrong
pb.section("pendulum", "rk4", Q, P, of=1, h=0.1, steps=10)  # wrong
pb.Hamiltonian(q="q", p="p", energy="p**2/2")  # wrong
pb.Hamiltonian("q", "p", "p**2/2")  # wrong
pb.Orbit("start", "1", "0")  # wrong
pb.stability("rk4", 3)  # wrong
pb.stability("rk4").limits  # wrong
pb.advise("pendulum", accuracy=1e-6)  # wrong
advice.choice.seconds  # wrong
advice.best  # wrong
pb.validate("rk4", ordr=4)  # wrong
pb.validate("rk4", energy="good")  # wrong
pb.certify("pendulum", t_end=1.0).holds  # wrong
pb.workprecision("pendulum", t_end="ten")  # wrong
pb.method("scheme-i", lam=[1])  # wrong
pb.nothing  # wrong
