"""desolver's, pyhamsys's, diffrax's and pynamicalsys's integrators as peers: claims, orders, steps, restrictions."""

from __future__ import annotations

import importlib.metadata
import inspect
import re
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.reference.peers import (
    ase,
    blackjax,
    desolver,
    diffrax,
    integrate_peer,
    jax_loop,
    jax_md,
    mujoco,
    openmm,
    pyhamsys,
    pynamicalsys,
)
from phasebench.reference.peers.prepared import prepare_peer
from phasebench.reference.solvers.taylor import reference
from support.solutions import end, last

MODULES = (desolver, pyhamsys, diffrax, pynamicalsys, blackjax, openmm, ase, jax_md, mujoco)
PACKAGES = {m.PEERS[0].package: m for m in MODULES}
PEERS = {p.id: p for module in PACKAGES.values() for p in module.PEERS}
FIXED = [id for id, p in PEERS.items() if not p.adaptive]
ADAPTIVE = [id for id, p in PEERS.items() if p.adaptive]
END = 3.0
#: Order -> steps of the coarser run, for which errors are asymptotic and far above round-off.
STEPS = {1: 128, 2: 64, 3: 32, 4: 32, 5: 24, 6: 16, 7: 12, 8: 12, 10: 10}
#: Peers that need more steps on the pendulum because their leading error coefficient is small.
FINER = {"diffrax-tsit5": 256, "diffrax-dopri5": 128, "pyhamsys-yo8": 32, "pyhamsys-yo8-extended": 32}
FINER |= {"desolver-dopri45": 128, "pyhamsys-yo10": 24, "pyhamsys-bm6-omega": 48}
#: Peers that need a longer run for the same reason.
LONGER = {"diffrax-tsit5": 12.0}
NO_ORDER = ("desolver-rk1412", "desolver-radau-iia-19")
NOT_SEPARABLE = "double-pendulum"
WRONG_SIGN = Hamiltonian(q="q", p="p", H="p**2/2 + cos(q)")
BLOWN_UP = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")


def need(id: str):
    """The peer; skip the test if its package is not installed."""
    package = PEERS[id].package if id in PEERS else id.split("-")[0]
    try:
        PACKAGES[package].PEERS[0].load(package)
    except ImportError:
        pytest.skip(f"{package} is not installed: it comes with the extra [peers]")
    return PEERS.get(id)


@lru_cache(maxsize=8)
def truth(name="pendulum", end=END):
    """(problem, reference state at the end)."""
    made = problem(name)
    rows = reference(made, [end], certify=False)
    return made, np.concatenate([rows.q[-1], rows.p[-1]])


def error(chosen, system_or_problem, steps, **start):
    """Error of a peer's run with this number of steps, at its end."""
    t_end = LONGER.get(chosen.id, END)
    solution = integrate_peer(system_or_problem, chosen, steps=steps, t_end=t_end, save_every=0, **start)
    return np.abs(end(solution) - truth(end=t_end)[1]).max()


def has_order(chosen, system_or_problem, order, steps, **start) -> bool:
    """Whether the order observed from runs with ``steps`` and twice as many steps is the given one."""
    errors = [error(chosen, system_or_problem, n, **start) for n in (steps, 2 * steps)]
    return bool(abs(np.log2(errors[0] / errors[1]) - order) < 0.35)


# -- list and claims ----------------------------------------------------------------------------------------------


def test_desolvers_integrators_and_claims():
    need("desolver")
    package = desolver.load().integrators
    classes = {c.__name__: c for c in package.explicit_methods() + package.implicit_methods()}
    claimed = {}
    for p in desolver.PEERS:
        name = re.match(r"desolver\.integrators\.(\w+)\.", p.claims.source).group(1)
        if p.claims.order is None:  # Richardson extrapolation declares no order
            assert desolver.integrator_class(desolver.RICHARDSON + name).symplectic is p.claims.symplectic
        else:
            claimed[name] = (p.claims.order, p.claims.symplectic)
    assert claimed == {name: (c.__order__, c.symplectic) for name, c in classes.items()}


def test_desolvers_orders():
    """The orders in the names of desolver's methods are the claimed ones; five measured orders differ."""
    measured = {"rk8713m": 7, "symplectic-euler": 2, "babs9o7h": 4, "abas5o6h": 4, "radau-iia-3": 1}
    for p in desolver.PEERS:
        told = re.search(r"order (\d+)", p.name)
        assert told is None or p.claims.order == int(told.group(1)), p.id
        assert p.adaptive or p.order == measured.pop(p.id.removeprefix("desolver-"), p.claims.order), p.id
    assert not measured


def test_pyhamsys_methods_and_orders_are_those_of_its_readme():
    need("pyhamsys")
    from pyhamsys import METHODS

    readme = importlib.metadata.metadata("pyhamsys").get_payload()
    readme = readme or importlib.metadata.metadata("pyhamsys")["Description"]
    plain = {p.name.removeprefix("pyhamsys's "): p for p in pyhamsys.PEERS if "extended" not in p.name}
    assert {m for m in METHODS if "#" not in m} == {n for n in plain if not re.match(r"Yo\d", n)}
    for name, chosen in plain.items():
        if re.match(r"Yo\d", name):
            assert chosen.claims.order == int(name[2:])
            continue
        line = next(line for line in readme.splitlines() if f"`{name}`" in line and "order" in line)
        after = line[line.index(f"`{name}`") :]
        numbers = re.search(r"order (\d+|\([\d,]+\))", after).group(1)
        assert chosen.claims.order == min(int(n) for n in re.findall(r"\d+", numbers)), name
    assert "ensuring the preservation of the symplectic structure" in readme
    assert all(p.claims.symplectic for p in plain.values())


def test_diffrax_solvers_and_claims():
    need("diffrax")
    import diffrax as package

    solvers = {
        name
        for name, c in vars(package).items()
        if inspect.isclass(c) and issubclass(c, package.AbstractSolver) and "Abstract" not in name
    }
    both = {"Euler", "Heun", "Midpoint", "Ralston", "ReversibleHeun"}  # these solve stochastic equations too
    stochastic = (package.AbstractItoSolver, package.AbstractStratonovichSolver, package.AbstractSRK)
    stochastic = (*stochastic, package.AbstractFosterLangevinSRK)
    expected = {n for n in solvers if n in both or not issubclass(getattr(package, n), stochastic)} - {"HalfSolver"}
    found = {re.match(r"diffrax\.(\w+)\.", p.claims.source).group(1): p for p in diffrax.PEERS}
    assert set(found) == expected
    for name, chosen in found.items():
        assert diffrax.solver(name).order(None) == chosen.claims.order, name
        assert ("Symplectic method" in getattr(package, name).__doc__) is bool(chosen.claims.symplectic), name


LICENSES = [
    ("desolver", "MIT"),
    ("pyhamsys", "BSD"),
    ("diffrax", "Apache"),
    ("pynamicalsys", "GPL"),
    ("blackjax", "Apache"),
    ("ase", "LGPL"),
    ("jax_md", "Apache"),
    ("mujoco", "Apache"),
]


@pytest.mark.parametrize(("package", "license"), LICENSES)
def test_the_license_is_that_of_the_package(package, license):
    need(package)
    told = importlib.metadata.metadata(package)
    assert license in f"{told.get('License-Expression')} {told.get('License')}"
    assert {p.license.split("-")[0] for p in PACKAGES[package].PEERS} == {license}


# -- accuracy and steps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", FIXED)
def test_a_peer_has_its_order_on_the_pendulum(id):
    chosen = need(id)
    if id in NO_ORDER:  # already the coarsest useful step is at round-off
        assert error(chosen, truth()[0], 12) < 1e-12
        return
    order = chosen.order or 4
    assert has_order(chosen, truth()[0], order, FINER.get(id, STEPS[order]))


@pytest.mark.parametrize(
    "id",
    ["desolver-rk4", "pyhamsys-verlet", "pyhamsys-verlet-extended", "diffrax-midpoint", "pynamicalsys-midpoint"],
)
def test_a_wrong_sign_of_the_force_is_seen(id):
    chosen, made = need(id), truth()[0]
    start = {"q0": made.q0, "p0": made.p0}
    assert not has_order(chosen, WRONG_SIGN, chosen.order, STEPS[chosen.order], **start)
    assert error(chosen, WRONG_SIGN, 64, **start) > 0.1


@pytest.mark.parametrize("id", FIXED)
def test_rows_equal_the_ends_of_shorter_runs(id):
    chosen, made = need(id), truth()[0]
    rows = integrate_peer(made, chosen, h=0.11, steps=11, save_every=5)
    assert (rows.t / 0.11).round(9).tolist() == [0, 5, 10, 11]
    for i, n in enumerate((5, 10, 11), start=1):
        alone = integrate_peer(made, chosen, h=0.11, steps=n, save_every=0)
        assert rows.q[i] == pytest.approx(alone.q[-1], rel=1e-12, abs=0 if "omega" not in id else 1e-12)
        assert rows.p[i] == pytest.approx(alone.p[-1], rel=1e-12)


@pytest.mark.parametrize(
    ("id", "method", "tolerance"),
    [
        ("desolver-symplectic-euler", "stormer-verlet", 1e-12),
        ("desolver-implicit-midpoint", "implicit-midpoint", 1e-11),  # it shortens steps in between
        ("pyhamsys-verlet", "stormer-verlet", 1e-12),
        ("diffrax-semi-implicit-euler", "symplectic-euler-q", 1e-12),
        ("blackjax-velocity-verlet", "stormer-verlet", 1e-12),
        ("openmm-verlet", "stormer-verlet", 1e-12),
        ("openmm-custom-velocity-verlet", "stormer-verlet", 1e-12),
        ("ase-velocity-verlet", "stormer-verlet", 1e-12),
        ("jax-md-nve", "stormer-verlet", 1e-6),  # its step is 0.05 in single precision
        ("mujoco-euler", "symplectic-euler-p", 1e-12),
        ("blackjax-implicit-midpoint-converged", "implicit-midpoint", 1e-12),
        ("pynamicalsys-verlet", "stormer-verlet", 1e-12),
        ("pynamicalsys-yoshida-4", "forest-ruth", 1e-12),
        ("pynamicalsys-midpoint", "implicit-midpoint", 1e-9),  # its residuals are below 1e-12, not at round-off
    ],
)
def test_exactly_n_steps_of_length_h_are_taken(id, method, tolerance):
    chosen, made = need(id), truth()[0]
    theirs = integrate_peer(made, chosen, h=0.05, steps=600, save_every=1)
    ours = integrate(made, method, h=0.05, steps=600)
    assert (len(theirs.q), theirs.counts["steps"]) == (601, 600)
    assert np.abs(theirs.q - ours.q).max() < tolerance
    assert np.abs(theirs.p - ours.p).max() < tolerance


def test_a_two_step_method_continues_across_pieces():
    chosen, made, h = need("diffrax-leapfrog-midpoint"), truth()[0], 0.01
    theirs = integrate_peer(made, chosen, h=h, steps=600)
    field = made.system.vector_field()
    before = np.concatenate([made.q0, made.p0])
    now = before + h * field(0.0, before)
    for k in range(1, 601):
        assert np.abs(np.concatenate([theirs.q[k], theirs.p[k]]) - now).max() < 1e-11
        before, now = now, before + 2 * h * field(0.0, now)


@pytest.mark.parametrize("id", ADAPTIVE)
def test_an_adaptive_peer_roughly_meets_its_tolerance(id):
    chosen, (made, exact) = need(id), truth()
    errors = [
        np.abs(end(integrate_peer(made, chosen, t_end=END, steps=3, tol=tol)) - exact).max() for tol in (1e-5, 1e-8)
    ]
    assert errors[0] < 1e-3
    assert errors[1] < 1e-6


@pytest.mark.parametrize(
    ("id", "name"),
    [
        ("desolver-rk108", NOT_SEPARABLE),
        ("pyhamsys-bm6-extended", NOT_SEPARABLE),
        ("mujoco-rk4", NOT_SEPARABLE),
        ("diffrax-dopri8", NOT_SEPARABLE),
        ("desolver-rk108", "lotka-volterra"),
        ("diffrax-kencarp5", "lotka-volterra"),
    ],
)
def test_peers_for_any_system_run_on_non_separable_ones(id, name):
    made, exact = truth(name, 1.0)
    solution = integrate_peer(made, need(id), t_end=1.0, steps=100, save_every=0)
    assert np.abs(last(solution) - exact).max() < 1e-7


def test_the_declared_half_goes_first(monkeypatch):
    """Two of pyhamsys's lists of methods declare which half of the splitting goes first together with the order."""
    need("pyhamsys")
    first, split = [], pyhamsys._separable_system

    def noted(system, position_first):
        first.append(position_first)
        return split(system, position_first)

    monkeypatch.setattr(pyhamsys, "_separable_system", noted)
    told = 0
    for chosen in pyhamsys.PEERS:
        words = re.search(r"\b([TV]) first", chosen.about)
        if words:
            integrate_peer(truth()[0], chosen, h=0.1, steps=2)
            assert first.pop() is (words.group(1) == "T"), chosen.id
            told += 1
    assert told == 8
    system, y = truth()[0].system, np.array([0.7, 0.4])
    for position in (True, False):
        found = split(system, position).chi(0.1, 0.0, y)
        moved = y[0] + 0.1 * y[1]
        kick = y[1] - 0.1 * np.sin(moved if position else y[0])
        assert found == pytest.approx([moved if position else y[0] + 0.1 * kick, kick], abs=1e-15)


def test_extended_phase_space_versions_of_methods():
    """The exceptions are a duplicate name and a method with hundreds of evaluations per step."""
    plain, extended, bound = (
        {p.id.removesuffix(kind) for p in pyhamsys.PEERS if p.id.endswith(kind)} for kind in ("", "-extended", "-omega")
    )
    general = {p.id for p in pyhamsys.PEERS if "for all purposes" in p.about and p.claims.symplectic}
    assert len(general) == 11
    assert general - extended == {"pyhamsys-yo4", "pyhamsys-yo10"}
    assert extended <= general <= plain
    assert bound == {"pyhamsys-verlet", "pyhamsys-bm4", "pyhamsys-bm6"}
    for p in pyhamsys.PEERS:
        doubled = p.id.endswith(("-extended", "-omega"))
        assert ("extension" in p.claims.source) == ("two copies" in p.about) == doubled
        assert p.claims.symplectic is (None if doubled else True)


@pytest.mark.parametrize("id", ["pyhamsys-verlet", "pyhamsys-verlet-extended", "desolver-rk4", "diffrax-euler"])
def test_a_run_prints_and_logs_nothing(id, capfd, caplog):
    integrate_peer(truth()[0], need(id), h=0.1, steps=3)
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


@pytest.mark.parametrize(
    ("id", "readings"),
    [
        ("desolver-rk4", [7.0, 9.5]),
        ("desolver-dopri45-adaptive", [7.0, 9.5]),
        ("diffrax-euler", [7.0, 9.5]),
        ("pyhamsys-verlet", [7.0, 8.0, 11.0, 12.5]),  # pieces of two and one steps; the time between is not counted
    ],
)
def test_seconds_are_those_between_clock_readings(id, readings, monkeypatch):
    chosen, left = need(id), list(readings)
    integrate_peer(truth()[0], chosen, h=0.1, steps=3)
    clocked = jax_loop if chosen.package == "diffrax" else PACKAGES[chosen.package]
    monkeypatch.setattr(clocked, "time", SimpleNamespace(perf_counter=lambda: left.pop(0)))
    assert integrate_peer(truth()[0], chosen, h=0.1, steps=3, tol=1e-6 if chosen.adaptive else None).seconds == 2.5
    assert left == []


def test_implicit_explicit_terms_are_described():
    named = {p.id.removeprefix("diffrax-"): p.about for p in diffrax.PEERS if "terms:" in p.about}
    assert {*named} == {"semi-implicit-euler", "sil3", "kencarp3", "kencarp4", "kencarp5"}
    for name, about in named.items():
        assert ("explicit in q, implicit in p" in about) == (name != "semi-implicit-euler")
    solved = {p.id.removeprefix("diffrax-") for p in diffrax.PEERS if "Newton's method" in p.about}
    assert solved == {*named, "implicit-euler", "kvaerno3", "kvaerno4", "kvaerno5"} - {"semi-implicit-euler"}


@pytest.mark.parametrize("id", ADAPTIVE[:2])
def test_rows_of_adaptive_steps_lie_on_the_orbit(id):
    solution = integrate_peer(truth()[0], need(id), t_end=1.0, steps=4, tol=1e-9)
    exact = reference(truth()[0], solution.t, certify=False)
    assert np.abs(np.hstack([solution.q - exact.q, solution.p - exact.p])).max() < 1e-6
    assert solution.counts["gradient"] > 4 * solution.counts["steps"] >= 16


# -- restrictions -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["desolver-babs9o7h", "pyhamsys-bm4", "diffrax-semi-implicit-euler"])
def test_unsupported_problems_are_refused(id):
    for name in (NOT_SEPARABLE, "lotka-volterra"):
        with pytest.raises(InvalidInput, match="H must be"):
            integrate_peer(problem(name), PEERS[id], h=0.1, steps=3)


def test_extended_versions_need_canonical_coordinates():
    with pytest.raises(InvalidInput, match="canonical"):
        integrate_peer(problem("lotka-volterra"), PEERS["pyhamsys-bm4-extended"], h=0.1, steps=3)


@pytest.mark.parametrize("id", ["desolver-rk4", "desolver-dopri45-adaptive", "pyhamsys-verlet", "diffrax-kvaerno3"])
def test_a_blow_up_keeps_the_rows_before_it(id):
    solution = integrate_peer(BLOWN_UP, need(id), t_end=20.0, steps=40, q0=[1.0], p0=[1.0])
    assert solution.status == "diverged"
    assert 1 < len(solution.q) < 40
    assert np.isfinite(solution.q).all()


def test_a_run_ends_with_the_piece_in_which_it_overflows():
    chosen = need("pyhamsys-verlet")
    solution = integrate_peer(BLOWN_UP, chosen, t_end=400.0, steps=400, q0=[1.0], p0=[1.0])
    assert (solution.status, solution.counts["steps"]) == ("diverged", pyhamsys.PIECE)
    assert "no longer finite" in solution.reason


def test_rows_end_before_a_failing_newton_step():
    stiff = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    solution = integrate_peer(stiff, need("diffrax-kvaerno3"), h=0.5, steps=10, q0=[1.0], p0=[1.0])
    failed = int(re.match(r"its equations were not solved in step (\d+);", solution.reason).group(1))
    assert failed > 1
    assert len(solution.t) == failed
    every_third = integrate_peer(stiff, need("diffrax-kvaerno3"), h=0.5, steps=10, q0=[1.0], p0=[1.0], save_every=3)
    assert len(every_third.t) == 1 + (failed - 1) // 3


def test_a_second_run_compiles_nothing():
    """Whatever the number of calls of the compiled loop is."""
    need("diffrax-euler")
    with jax_loop.double_precision():
        loop = diffrax._compile.__wrapped__("Euler", diffrax.WHOLE, truth()[0].system)
        before = loop._loop._cache_size()
        rows, failed = loop.rows(np.array([1.0, 0.0]), 1e-3, np.arange(1, 2 * jax_loop.ROWS + 3))
    assert (len(rows), failed) == (2 * jax_loop.ROWS + 2, -1)
    assert loop._loop._cache_size() == before


def test_the_loop_is_first_compiled_for_its_own_output(monkeypatch):
    """diffrax's loop is called at once with its own output, for which some versions of JAX compile it separately."""
    need("diffrax-euler")
    taken, rows = [], jax_loop.Loop.rows

    def noted(self, y, h, numbers):
        taken.append(len(numbers))
        return rows(self, y, h, numbers)

    monkeypatch.setattr(jax_loop.Loop, "rows", noted)
    with jax_loop.double_precision():
        diffrax._compile.__wrapped__("Euler", diffrax.WHOLE, truth()[0].system)
    assert min(taken) > jax_loop.ROWS


# -- pitfalls of the packages -------------------------------------------------------------------------------------


def test_only_desolvers_explicit_methods_keep_the_step():
    need("desolver")
    package, made = desolver.load(), truth()[0]
    field = made.system.vector_field()
    for name, constant in (("RK4Solver", True), ("GaussLegendre4", False)):
        system = package.OdeSystem(field, y0=np.concatenate([made.q0, made.p0]), t=(0.0, 2.0), dt=0.125)
        system.method = desolver.integrator_class(name)
        system.integrate()
        taken = np.diff(system.t)
        assert bool((taken == 0.125).all()) is constant
        if constant:
            ours = integrate_peer(made, PEERS["desolver-rk4"], h=0.125, steps=16)
            assert np.array_equal(np.hstack([ours.q, ours.p]), system.y)
        else:
            assert taken.max() > 0.25


def test_pyhamsys_ignores_its_projection_option():
    need("pyhamsys")
    from pyhamsys import HamSys, Parameters

    made = HamSys(y_dot=lambda t, y: np.array([y[1], -np.sin(y[0])]))
    ends = [
        made.integrate(
            np.array([1.0, 0.0]),
            np.arange(6) * 0.1,
            Parameters(step=1.0, solver="Verlet", extension=True, display=False, projection=projection),
        )
        for projection in ("symmetric", None)
    ]
    assert [s.projection for s in ends] == ["midpoint", "midpoint"]
    assert np.array_equal(ends[0].y, ends[1].y)


def test_jaxs_double_precision_is_switched_back():
    chosen = need("diffrax-midpoint")
    import jax.numpy as jnp

    before = jnp.ones(1).dtype
    integrate_peer(truth()[0], chosen, h=0.1, steps=3)
    assert jnp.ones(1).dtype == before


def test_pynamicalsys_prepared_runs_end_where_others_do_and_a_run_longer_than_a_piece_is_one():
    made, n = truth()[0], pynamicalsys.PIECE + 5
    for chosen in (need(p.id) for p in pynamicalsys.PEERS):
        rows = integrate_peer(made, chosen, h=1e-3, steps=n, save_every=pynamicalsys.PIECE - 1)
        assert (rows.status, rows.t.tolist()) == ("ok", [0.0, *(1e-3 * k for k in (pynamicalsys.PIECE - 1, n))])
        q, p, status = prepare_peer(made, chosen)(1e-3, n)
        assert (status, *q, *p) == ("ok", *rows.q[-1], *rows.p[-1])
    made, size = problem(NOT_SEPARABLE), {"h": 0.01, "steps": 100, "save_every": 0}
    theirs, ours = integrate_peer(made, pynamicalsys.PEERS[2], **size), integrate(made, "implicit-midpoint", **size)
    assert np.abs(theirs.q[-1] - ours.q[-1]).max() < 1e-9
    stuck = integrate_peer(BLOWN_UP, need("pynamicalsys-midpoint"), h=0.5, steps=400, q0=[3.0], p0=[3.0])
    assert stuck.status in ("not-converged", "diverged")


def test_pynamicalsys_explicit_methods_take_large_systems_and_its_implicit_one_says_why_not():
    wave = problem("klein-gordon")  # 128 degrees of freedom: compiling its Hessian would take many minutes
    theirs = integrate_peer(wave, need("pynamicalsys-verlet"), h=0.1, steps=9)
    ours = integrate(wave, "stormer-verlet", h=0.1, steps=9)
    assert np.abs(theirs.q[-1] - ours.q[-1]).max() < 1e-12
    with pytest.raises(InvalidInput, match="Hessian of H, compiled up to d = 20"):
        integrate_peer(wave, need("pynamicalsys-midpoint"), h=0.1, steps=9)


@pytest.mark.parametrize(("id", "order"), [(p.id, p.order) for p in mujoco.PEERS])
def test_mujocos_models_are_those_of_the_problems(id, order):
    chosen = need(id)
    for name in ("double-pendulum:regular", "free-rigid-body"):
        made = problem(name)
        exact, errors = last(integrate(made, "gauss-8", h=0.02, steps=100, save_every=0)), []
        for steps in (200, 400):
            errors.append(
                np.abs(last(integrate_peer(made, chosen, t_end=2.0, steps=steps, save_every=0)) - exact).max()
            )
        assert abs(np.log2(errors[0] / errors[1]) - order) < 0.4 or errors[1] < 1e-13, name
    with pytest.raises(InvalidInput, match="here pendulum, double-pendulum, free-rigid-body"):
        integrate_peer(problem("kepler"), chosen, h=0.1, steps=1)
    with pytest.raises(InvalidInput, match="has m1 = 1"):
        integrate_peer(problem("double-pendulum", m1=2), chosen, h=0.1, steps=1)


def test_jax_md_rounds_the_step_to_single_precision():
    """Its step is exact where single precision holds it."""
    made, chosen = truth()[0], need("jax-md-nve")
    for h, low, high in ((0.0625, 0.0, 1e-13), (0.05, 1e-9, 1e-6)):
        theirs, ours = integrate_peer(made, chosen, h=h, steps=64), integrate(made, "stormer-verlet", h=h, steps=64)
        assert low <= np.abs(theirs.q - ours.q).max() <= high


def test_openmms_variable_steps_keep_positions_and_momenta_at_one_time():
    made, chosen = problem("kepler", e=0.3), need("openmm-variable-verlet-adaptive")
    before = made.system.energies([made.q0], [made.p0])[0]
    ends = [integrate_peer(made, chosen, t_end=3.0, steps=1, tol=tol).energy()[-1] for tol in (1e-4, 1e-6)]
    assert 3 < abs(ends[0] - before) / abs(ends[1] - before) < 300
