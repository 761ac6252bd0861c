"""What only a hand-made case shows of the measures by which statements of others are judged."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.solar_system import PLANETS
from phasebench.benchmarks.store.arrays import pack, unpack
from phasebench.benchmarks.studies.said import brouwer, energies, julia, minimum_norm, planets, timed
from phasebench.benchmarks.studies.said.minimum_norm import LEAPFROG, MINIMUM_NORM, MOMENTA, POSITIONS
from phasebench.benchmarks.studies.said.talks import convergence, linear_map, measure, perturbed_kepler, statements
from phasebench.benchmarks.studies.said.talks.judges import judge
from phasebench.benchmarks.studies.said.talks.measure import CHECKS
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.pages import REPORTS

# -- printed numbers ---------------------------------------------------------------------------------------------------


def test_perihelia_turn_with_the_planes():
    """A rotation about the ecliptic's axis adds to every longitude, a scaling to none."""
    made = problem("solar-system")
    q, p = np.array([made.q0]), np.array([made.p0])
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.kron(np.eye(9), [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    before, after = planets.longitudes(made, q, p), planets.longitudes(made, q @ turn.T, p @ turn.T)
    np.testing.assert_allclose((after - before - 0.3 + np.pi) % (2 * np.pi), np.pi, atol=1e-12)


def test_a_rate_is_in_seconds_of_arc_a_year():
    t = np.linspace(0, 1000 * planets.YEAR, 50)
    assert planets.rate(t, 1.0 + np.radians(5.0 / 3600) * t / planets.YEAR) == pytest.approx(5.0, rel=1e-9)


def rms_of_oscillator(id: str, h: float, steps: int) -> float:
    """The rms of Delta H on the harmonic oscillator: z'(M'M - 1)z / 2 for Gaussian z, from the step's matrix alone."""
    lam = 0.19318332750378357396
    substeps = [("A", 0.5), ("B", 1.0), ("A", 0.5)]
    if id == MINIMUM_NORM:
        substeps = [("A", lam), ("B", 0.5), ("A", 1 - 2 * lam), ("B", 0.5), ("A", lam)]
    step = np.eye(2)
    for letter, c in substeps:
        step = (np.array([[1, c * h], [0, 1]]) if letter == "A" else np.array([[1, 0], [-c * h, 1]])) @ step
    M = np.linalg.matrix_power(step, steps)
    S = M.T @ M - np.eye(2)
    return float(np.sqrt((2 * np.trace(S @ S) + np.trace(S) ** 2) / 4))


@pytest.mark.parametrize("id", [LEAPFROG, MINIMUM_NORM])
@pytest.mark.parametrize("first", [POSITIONS, MOMENTA])
def test_rms_on_the_oscillator_is_that_of_the_step_matrix(id, first):
    d, weights = minimum_norm.jumps("oscillator", id, first, 1.0, 8)
    assert np.sqrt(weights @ d**2) == pytest.approx(rms_of_oscillator(id, 1 / 8, 8), rel=1e-9)
    assert weights @ np.expm1(-d) == pytest.approx(0, abs=1e-12)


def test_the_rule_for_averages_has_the_moments():
    q, p, weights = minimum_norm.states("anharmonic")
    x = np.linspace(-8, 8, 20001)
    density = np.exp(-minimum_norm.potential("anharmonic", x))
    assert weights @ q**2 == pytest.approx((density @ x**2) / density.sum(), rel=1e-4)
    assert weights @ p**4 == pytest.approx(3.0, rel=1e-9)


def test_exponents_of_random_walks_and_of_lines():
    random = np.random.default_rng(1)
    a, low, high = brouwer.exponent(np.cumsum(random.normal(size=(64, 100)), axis=1))
    assert low < 0.5 < high
    assert abs(a - 0.5) < 0.12
    line, low, high = brouwer.exponent(np.outer(random.uniform(1, 2, 64), np.arange(1, 101)))
    assert line == pytest.approx(1.0)
    assert low == pytest.approx(high)


def test_short_runs_grow_by_round_off_and_by_truncation(monkeypatch):
    monkeypatch.setattr(brouwer, "STARTS", 4)
    ours, control = (np.abs(brouwer.errors(*run, orbits=100)).max() for run in (("gauss-8", None), brouwer.CONTROL))
    assert ours < 1e-14
    assert control > 1e-12


def test_heavier_giants_are_the_giants_of_the_solar_system():
    made = timed.heavier()
    assert made.bodies.names == ("sun", *timed.GIANTS)
    assert made.bodies.masses[1] == pytest.approx(timed.HEAVIER / PLANETS["jupiter"][0])


# -- guides ------------------------------------------------------------------------------------------------------------

N = np.arange(1, 1001)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0])
def test_the_power_of_time_is_found_under_an_oscillation(power):
    assert abs(julia.power(1e-9 * N**power * (1 + 0.3 * np.sin(N))) - power) < 0.07
    assert julia.power(np.where(N == 50, 1.0, 1e-9)) == 0, "of the largest error so far"


def test_growth_of_a_symplectic_method_and_of_one_that_is_not(monkeypatch):
    monkeypatch.setattr(julia, "ORBITS", 100)
    for id, powers in {"calvo-sanz-serna-4": (0, 1), "rk4": (1, 2)}.items():
        row = julia.growth(id)
        assert (row["energy power"], row["position power"]) == pytest.approx(powers, abs=0.12)


def test_orders_with_both_kinetic_energies():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + q**4/4")
    for id, order in julia.STATED.items():
        assert [r["order"] for r in julia.orders(id)] == pytest.approx([order, 3], abs=0.1)
        s = integrate(system, id, h=julia.SPAN / 64, steps=64, q0=julia.START[:1], p0=julia.START[1:])
        assert np.abs(julia.end(id, 64, True) - [s.q[-1, 0], s.p[-1, 0]]).max() < 1e-13, "another composition"


def test_plain_and_compensated_sums_take_the_same_steps():
    made, ((q, p), _) = problem("henon-heiles"), energies.SCENES["henon-heiles"]
    states = energies.plain(made.system, q, p, 0.05, 200, 50)
    s = integrate(made, energies.COMPENSATED, h=0.05, steps=200, q0=q, p0=p, save_every=50)
    assert np.abs(states - np.hstack([s.q, s.p])).max() < 1e-12
    assert not np.array_equal(states[1:], np.hstack([s.q, s.p])[1:])


def test_errors_fall_with_evaluations():
    rows = julia.cost("pendulum:swinging", "calvo-sanz-serna-4")
    (n1, e1), (n2, e2) = ((r["evaluations"], r["error"]) for r in (rows[10], rows[14]))
    assert abs(np.log(e1 / e2) / np.log(n2 / n1) - 4) < 0.2


# -- the talks ---------------------------------------------------------------------------------------------------------

STATEMENTS = [(s, *statement) for s, section in statements.SECTIONS.items() for statement in section["said"]]
#: What makes a statement fail, by column.
BAD = dict.fromkeys(("defect", "energy", "symplecticity", "largest", "two-form", "total energy error"), 1.0)
BAD |= dict.fromkeys(("invariant error", "angular momentum error", "energy error"), 1.0)
BAD |= {"value": 1e3, "order": 17.0, "units": 99.0, "median": 9.0, "x": "1 2 3 4", "y": "2 1 1 1"}


def tables(**columns):
    """The committed tables, with other values in these columns."""
    known = report.Data(REPORTS)

    def changed(name):
        frame = known(name)
        here = {c: x for c, x in columns.items() if c in frame and (c != "status" or "figure" in frame)}
        return frame.assign(**{c: range(len(frame)) if x is None else x for c, x in here.items()})

    return changed


def named(entries, *names):
    """The entries of statements, also those under a condition, that name one of these judges."""
    inner = [e for entry in entries for key in ("judged", "otherwise") for e in entry.get(key, [])]
    return [entry for entry in (*entries, *inner) if {*names} & {*entry}]


@pytest.fixture(scope="module")
def data():
    return tables(), *(tables(**BAD, status="diverged", area=None, measure=None, energy_error=x) for x in (1e-9, 1e9))


@pytest.mark.parametrize("statement", STATEMENTS, ids=lambda s: f"{s[0]}-{s[1]}")
def test_wrong_rows_change_the_verdict(statement, data):
    judges = statement[5:]
    before, *after = (judge(tables, judges).verdict for tables in data)
    assert before != MISSING
    assert CONTRADICTED in after or before == UNTESTABLE
    assert judge(lambda name: None, judges).verdict in (MISSING, UNTESTABLE)


def test_every_check_is_used():
    used = {entry["check"] for s in STATEMENTS for entry in named(s[5:], "check")}
    assert used | {"species"} == {*statements.PROBES}


@pytest.mark.parametrize("entry", [entry for s in STATEMENTS for entry in named(s[5:], "check")])
def test_a_check_holds_up_to_its_bound_and_needs_a_control_that_fails(entry):
    bound, least = entry["at_most"], entry.get("control", entry["at_most"])
    row = {"check": entry["check"], "value": bound, "control": 1.001 * abs(least), "what": "a", "against": "b"}
    for change, verdict in (
        ({}, HOLDS),
        ({"value": -bound}, HOLDS),
        ({"value": 1.001 * bound}, CONTRADICTED),
        ({"control": least}, CONTRADICTED if least > 0 else HOLDS),
        ({"value": np.nan}, MISSING),
    ):
        assert judge(lambda name, change=change: pd.DataFrame([row | change]), [entry]).verdict == verdict
    assert judge(data_of(CHECKS), [entry]).verdict == HOLDS or entry["check"] in (
        "mass",
        "degenerate",
        "closed-midpoint",
    )


def data_of(table):
    known = report.Data(REPORTS)
    return lambda name: known(name) if name == table else None


EQUIP = {"id": "equip-box", "two-form, round-off": 1e-16}
#: (judge, rows within the bound, rows beyond it)
EDGES = (
    ({"printed": "avf", "entries": 2}, {"units": [0.5, 0.59]}, {"units": [0.5, 0.61]}),
    ({"printed": "avf", "entries": 2}, {"units": [0.5, 0.5]}, {"units": [0.5]}),
    ({"order": 2, "of": ["avf"]}, {"order": [2.0, 2.09]}, {"order": [2.0, 2.11]}),
    ({"order": 2, "of": ["avf"]}, {"order": [2.0, 1.91]}, {"order": [2.0, 1.89]}),
    ({"has": "symmetry", "of": ["avf"]}, {"defect": [0.0, 9e-23]}, {"defect": [0.0, 2e-22]}),
    ({"lacks": "symmetry", "of": ["avf"]}, {"defect": [1.0, 2e-22]}, {"defect": [1.0, 9e-23]}),
    ({"keeps_energy": ["avf"]}, {"energy": [0.0, 9e-12]}, {"energy": [0.0, 2e-11]}),
    ({"box": "two-form", "at_most": 10.0}, EQUIP | {"two-form": [9e-16]}, EQUIP | {"two-form": [0.0, 2e-15]}),
    ({"prey": True}, {"value": [-1.0], "control": 1.0}, {"value": [-1.0], "control": 0.0}),
)


@pytest.mark.parametrize("edge", EDGES)
def test_bounds_of_judges(edge):
    entry, good, bad = edge
    shared = {"scheme": "avf", "method": "avf", "property": "symmetry", "problem": "henon-heiles", "check": "species"}
    shared |= {"what": "a", "against": "b"}
    for rows, verdict in ((good, HOLDS), (bad, CONTRADICTED)):
        size = max(len(v) for v in rows.values() if isinstance(v, list))
        frame = pd.DataFrame({"order": [2.0] * size} | shared | rows)
        assert judge(lambda name, frame=frame: frame, [entry]).verdict == verdict


def test_the_worst_verdict_counts_and_a_condition_is_stated():
    rows = {"check": ["good", "bad"], "value": [0.0, 1.0], "control": 9.0, "what": "a", "against": "b"}
    good, bad, missing = ({"check": name, "at_most": 0.5} for name in ("good", "bad", "none"))

    def verdict(*entries):
        return judge(lambda name: pd.DataFrame(rows), entries).verdict

    assert [verdict(good, x) for x in (good, bad, missing)] == [HOLDS, CONTRADICTED, MISSING]
    for inside, outside, expected in ((good, bad, WHERE), (good, good, HOLDS), (bad, bad, CONTRADICTED),
                                      (bad, good, CONTRADICTED), (good, missing, MISSING)):  # fmt: skip
        assert verdict({"condition": "x > 0", "judged": [inside], "otherwise": [outside]}) == expected


#: The checks that compile no kernel, and two that do.
QUICK = (*(id for id, probe in statements.PROBES.items() if not probe.methods), "form-third", "adjoint")


@pytest.mark.parametrize("id", QUICK)
def test_a_check_reproduces_its_committed_row(id):
    then = report.Data(REPORTS)(CHECKS).set_index("check").loc[id]
    now = statements.probe(id)
    assert now["control"] == pytest.approx(then["control"], rel=1e-6, abs=1e-12)
    assert now["value"] == pytest.approx(then["value"], rel=1e-6, abs=1e-9)
    assert (now["what"], now["against"]) == (then["what"], then["against"])


def test_points_are_read_as_written():
    values = np.array([0.1, -1.2345678e-17, 3.0, np.nan])
    read = unpack(pack(values, 17))
    assert np.array_equal(read, values, equal_nan=True)
    assert unpack(pack(values))[1] == -1.23457e-17
    assert len(unpack(float("nan"))) == 0


def test_traced_path_keeps_its_ends_and_is_even():
    angle = np.linspace(0, 1, 5001) ** 3 * 2 * np.pi
    path = measure.thin_path(np.stack([np.cos(angle), np.sin(angle)], axis=1), n=100)
    apart = np.hypot(*np.diff(path, axis=0).T)
    assert len(path) <= 100
    assert (path[0] == (1, 0)).all()
    assert path[-1] == pytest.approx((1, 0))
    assert apart.max() < 1.2 * apart.min()


def test_enclosed_area_is_exact_and_oriented():
    ellipse = measure.circle((0.3, -2.0), 1.0, 64) * (3.0, 0.5)
    assert measure.enclosed_area(ellipse) == pytest.approx(1.5 * np.pi, rel=1e-13)
    assert measure.enclosed_area(ellipse[::-1]) == pytest.approx(-1.5 * np.pi, rel=1e-13)
    coarse, fine = (measure.enclosed_area(measure.cat((0, 0), 0.4, n)) for n in (256, 512))
    assert coarse == pytest.approx(fine, rel=1e-13)
    # The polygon's area converges only as n^-2.
    assert abs(measure.polygon_area(measure.cat((0, 0), 0.4, 256)) / fine - 1) > 1e-5


def test_linear_map_preserves_only_the_sum_of_areas():
    before = linear_map.areas(linear_map.XI, linear_map.ETA)
    midpoint = linear_map.areas(*linear_map.image("implicit-midpoint"))
    euler = linear_map.areas(*linear_map.image("explicit-euler"))
    assert midpoint.sum() == pytest.approx(before.sum(), abs=1e-14)
    assert np.abs(midpoint - before).min() > 0.1
    assert abs(euler.sum() - before.sum()) > 0.1


def test_thinned_series_keeps_the_peaks():
    t = np.arange(10_001.0)
    e = np.abs(np.sin(t))
    e[[17, 9_990]] = 5.0, 7.0
    times, maxima = measure.binned_maxima(t, e, 50)
    assert len(times) == 50
    assert {(17.0, 5.0), (9_990.0, 7.0)} <= set(zip(times, maxima, strict=True))
    assert (np.diff(times) > 0).all()


def test_precession_with_and_without_the_perturbation():
    still = perturbed_kepler.precession(measure.run(measure.start("kepler"), "scheme-iii-suzuki-6", 0.01, 60.0))
    turned = perturbed_kepler.precession(
        measure.run(measure.start("perturbed-kepler"), "scheme-iii-suzuki-6", 0.01, 60.0)
    )
    assert abs(still) < 1e-6
    # First order in mu: 2 pi mu / L^4 over a revolution.
    assert turned == pytest.approx(2 * np.pi * 0.0075 / 0.8**4, rel=0.1)


def test_section_agrees_with_finer_steps():
    start = measure.start("henon-heiles:box")
    coarse, fine = (measure.section(start, measure.run(start, "rk4", h, 60.0)) for h in (0.02, 0.005))
    assert len(coarse) == len(fine) > 5
    assert np.abs(coarse - fine).max() < 1e-7


@pytest.mark.parametrize(
    ("id", "order", "steps"),
    [("scheme-i", 1, 64), ("scheme-iii", 2, 32), ("scheme-iii-yoshida-4", 4, 16), ("scheme-iii-suzuki-6", 6, 2)],
)
def test_observed_orders(id, order, steps):
    start = measure.start(convergence.PROBLEM)
    h, differences, _ = measure.refinement_differences(start, id, [steps * 2**k for k in range(5)])
    assert measure.observed_order(h, differences) == pytest.approx(order, abs=0.15)


def test_caption_mentions_failed_runs_and_fallbacks():
    good = measure.run(measure.start("henon-heiles:box"), "scheme-iv", 0.1, 1.0)
    lost = dataclasses.replace(good, status="diverged", reason="the state is no longer finite")
    missed = dataclasses.replace(good, counts=good.counts | {"fallbacks": 3})

    def said(*solutions):
        return measure.troubles(pd.DataFrame([measure.row("", "", [], [], s) for s in solutions]))

    assert said(good) == ""
    assert "diverged" in said(good, lost)
    assert "3 of 20 (Scheme IV)" in said(good, missed)


def test_lost_points_stop_the_figure():
    with pytest.raises(InvalidInput, match="is lost"):
        measure.carry(measure.start("henon-heiles"), "explicit-euler", np.array([[3.0, 3.0, 9.0, 9.0]]), 0.5, 60)
