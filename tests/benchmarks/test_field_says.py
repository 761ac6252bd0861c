"""What packages' guides say: the measures beside what is known, and verdicts that follow the rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.field_says import (
    bench_field_says,
    claims,
    cost,
    encounters,
    energy,
    growth,
    orders,
    page,
)
from phasebench.benchmarks.page.verdict import FINDING, PASS
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.driver import integrate
from support.pages import data

N = np.arange(1, 1001)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0])
def test_the_power_of_time_is_found_under_an_oscillation(power):
    assert abs(growth.power(1e-9 * N**power * (1 + 0.3 * np.sin(N))) - power) < 0.07


def test_a_power_is_of_the_largest_error_so_far():
    assert growth.power(np.where(N == 50, 1.0, 1e-9)) == 0


def test_growth_of_a_symplectic_method_and_of_one_that_is_not(monkeypatch):
    monkeypatch.setattr(growth, "ORBITS", 100)
    found = {id: growth.measure_rows(id)[growth.TABLE][0] for id in ("calvo-sanz-serna-4", "rk4")}
    for id, (of_energy, of_position) in {"calvo-sanz-serna-4": (0, 1), "rk4": (1, 2)}.items():
        assert abs(found[id]["energy power"] - of_energy) < 0.12
        assert abs(found[id]["position power"] - of_position) < 0.12


def test_orders_with_both_kinetic_energies():
    for id, quadratic in (("mclachlan-atela-4", 4), ("mclachlan-atela-5", 5)):
        first, other = orders.measure_rows(id)[orders.TABLE]
        assert abs(first["order"] - quadratic) < 0.1
        assert abs(other["order"] - 3) < 0.1


def test_the_composition_is_that_of_this_suite():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + q**4/4")
    for id in orders.METHODS:
        s = integrate(system, id, h=orders.SPAN / 64, steps=64, q0=[orders.START[0]], p0=[orders.START[1]])
        assert np.abs(orders.end(id, 64, True) - [s.q[-1, 0], s.p[-1, 0]]).max() < 1e-13


def test_plain_and_compensated_sums_take_the_same_steps():
    made, ((q, p), _) = problem("henon-heiles"), energy.SCENES["henon-heiles"]
    states = energy.plain(made.system, q, p, 0.05, 200, 50)
    s = integrate(made, energy.COMPENSATED, h=0.05, steps=200, q0=q, p0=p, save_every=50)
    assert states.shape == (5, 4)
    assert np.abs(states - np.hstack([s.q, s.p])).max() < 1e-12
    assert not np.array_equal(states[1:], np.hstack([s.q, s.p])[1:])


def test_errors_fall_with_evaluations_and_references_are_exact():
    rows = cost.measure_rows("pendulum:swinging", "calvo-sanz-serna-4")[cost.TABLE]
    assert not bench_field_says.unsound(rows)
    assert bench_field_says.unsound([rows[0] | {"uncertainty": 1e-9}])
    (n1, e1), (n2, e2) = ((r["evaluations"], r["error"]) for r in (rows[10], rows[14]))
    assert abs(np.log(e1 / e2) / np.log(n2 / n1) - 4) < 0.2


def growth_rows(symplectic=(0.0, 1.0), other=(1.0, 2.0)):
    lines = [("a", True, *symplectic), ("b", False, *other)]
    return pd.DataFrame(lines, columns=["called", "symplectic", "energy power", "position power"])


@pytest.mark.parametrize(
    ("verdict", "good", "bad"),
    [
        (claims.bounded, growth_rows(), growth_rows(symplectic=(0.5, 1.0))),
        (claims.linear, growth_rows(symplectic=(1.0, 1.0)), growth_rows()),
        (claims.quadratic, growth_rows(other=(2.0, 2.0)), growth_rows()),
        (claims.positions, growth_rows(), growth_rows(symplectic=(0.0, 2.0))),
        (claims.other_positions, growth_rows(), growth_rows(other=(1.0, 1.0))),
    ],
)
def test_verdicts_on_growth(verdict, good, bad):
    assert verdict(data(field_says_growth=good)).outcome == PASS
    assert verdict(data(field_says_growth=bad)).outcome == FINDING
    assert verdict(data()) is None


def cost_rows(mcate2: float, verlet: float, best: float):
    """Rows of methods of order 2 with these constants, and one of order 4 with the constant ``best``."""
    rows = []
    for id, size, order in ((claims.MCATE2, mcate2, 2), (claims.VERLET, verlet, 2), ("calvo-sanz-serna-4", best, 4)):
        rows += [
            {"problem": "kepler", "method": id, "evaluations": n, "error": size * n**-order, "uncertainty": 0.0}
            for n in 10 ** np.linspace(0, 8, 200)
        ]
    return pd.DataFrame(rows)


def test_verdicts_on_cost():
    usual, dear = cost_rows(1.0, 3.0, 1e9), cost_rows(3.0, 1.0, 1.0)
    assert claims.than_verlet(data(field_says_cost=usual)).outcome == PASS
    assert claims.than_verlet(data(field_says_cost=dear)).outcome == FINDING
    assert claims.efficient(data(field_says_cost=usual)).measured < 100
    assert claims.efficient(data(field_says_cost=dear)).measured == 0
    best = cost_rows(1.0, 3.0, 1e99)
    assert [claims.efficient(data(field_says_cost=rows)).outcome for rows in (best, dear)] == [PASS, FINDING]
    assert [claims.loose(data(field_says_cost=rows)).outcome for rows in (best, dear)] == [PASS, FINDING]


def test_verdicts_on_orders_energies_and_ias15():
    def of_orders(fourth, fifth):
        ids = ("mclachlan-atela-4", "mclachlan-atela-5")
        rows = [(id, T, o) for id, pair in zip(ids, (fourth, fifth), strict=True) for T, o in pair.items()]
        return data(field_says_orders=pd.DataFrame(rows, columns=["method", "T", "order"]))

    as_found = of_orders({orders.QUADRATIC: 4.0, orders.OTHER: 3.0}, {orders.QUADRATIC: 5.0, orders.OTHER: 3.0})
    as_said = of_orders({orders.QUADRATIC: 4.0, orders.OTHER: 3.0}, {orders.QUADRATIC: 5.0, orders.OTHER: 5.0})
    assert (claims.fourth(as_found).outcome, claims.fifth(as_found).outcome) == (PASS, FINDING)
    assert claims.fifth(as_said).outcome == PASS
    kept = of_orders({orders.QUADRATIC: 4.0, orders.OTHER: 4.0}, {orders.QUADRATIC: 5.0, orders.OTHER: 5.0})
    assert claims.fourth(kept).outcome == FINDING

    def of_energy(compensated, plain, boson=1.0):
        sizes = {energy.COMPENSATED: compensated, energy.PLAIN: plain, "heyoka": (1e-15, 1e-13)}
        sizes["scipy-dop853-numba"] = (1e-13, 1e-11)
        rows = [
            {"problem": name, "integrator": id, "t": t, "energy error": x * (boson if "boson" in name else 1.0)}
            for name in energy.SCENES
            for id, pair in sizes.items()
            for t, x in zip((1e2, 1e3), pair, strict=True)
        ]
        return data(field_says_energy=pd.DataFrame(rows))

    quiet, noisy = of_energy((1e-16, 1e-16), (1e-14, 2e-14)), of_energy((1e-14, 1e-13), (1e-15, 1e-12))
    assert [f(quiet).outcome for f in (claims.short, claims.later, claims.later_boson)] == [FINDING, PASS, PASS]
    assert [f(noisy).outcome for f in (claims.short, claims.later, claims.later_boson)] == [PASS, FINDING, FINDING]
    harder = of_energy((1e-16, 1e-16), (1e-14, 2e-14), boson=3.0)
    assert [claims.harder(rows).outcome for rows in (quiet, harder)] == [FINDING, PASS]

    for worse, outcome in ((1, PASS), (2, FINDING)):
        rows = pd.DataFrame({"e": [0.0, 0.6, 0.9], "energy error": [1e-15] * (3 - worse) + [1e-13] * worse})
        assert claims.machine(data(**{encounters.TABLE: rows})).outcome == outcome

    for power, outcome in ((0.52, PASS), (0.7, FINDING)):
        row = {"integrator": "heyoka", "tolerance": np.nan, "exponent": power, "low": power - 0.1, "high": power + 0.1}
        assert claims.taylor(data(**{claims.BROUWER: pd.DataFrame([row | {"rms": 6e-14}])})).outcome == outcome


def rival(id, error, time=1.0, problem=claims.PLANETS, h=1.0):
    """A row of REBOUND's: an integrator's energy error and time with a step on a problem."""
    row = {"problem": problem, "kind": "rebound", "method": id, "h": h}
    return row | {"energy error": error, "ns a unit of time": time}


def of_rivals(*rows):
    return data(**{claims.RIVALS: pd.DataFrame(rows)})


def test_the_fastest_of_rebound_s_splittings_is_counted_by_error():
    for time, n, outcome in ((3.0, 10, PASS), (0.5, 0, FINDING)):
        found = claims.planets(of_rivals(rival("rebound-whfast", 1e-14), rival("rebound-saba-4", 1e-14, time)))
        assert (found.measured.n, found.measured.of, found.outcome) == (n, 10, outcome)
    elsewhere = rival("rebound-saba-4", 1e-14, 0.1, "perturbed-kepler, e = 0.2")
    found = claims.planets(of_rivals(rival("rebound-whfast", 1e-9), elsewhere))
    assert (found.measured.n, found.measured.of) == (6, 6)
    assert claims.planets(of_rivals(rival("rebound-whfast", np.nan, np.nan))) is None


def test_the_best_corrector_and_kernel_are_counted():
    for last, outcome in ((1e-10, PASS), (3e-9, FINDING)):
        errors = dict.fromkeys(claims.CORRECTORS, 2e-9) | {3: 1e-9, 11: 4e-9, 17: last}
        rows = [rival(claims.CORRECTORS[n], x) for n, x in errors.items()]
        assert claims.correctors(of_rivals(*rows)).outcome == outcome
    assert claims.correctors(of_rivals(*rows[:4])) is None
    for time, outcome in ((0.5, PASS), (2.0, FINDING)):
        found = claims.kernels(of_rivals(rival("rebound-whfast", 1e-14, time), rows[4] | {"energy error": 1e-14}))
        assert found.outcome == outcome


def test_the_answer_counts_the_statements():
    told = page.answer(data(field_says_growth=growth_rows()))
    assert told == "Of 5 statements of packages' guides 3 hold where they were tested; 2 do not."
    assert page.answer(data()) is None
    shown = page.table(data(field_says_growth=growth_rows())).frame
    assert len(shown) == len(claims.SAID)
    assert list(shown["outcome"][:3]) == [PASS, FINDING, FINDING]
