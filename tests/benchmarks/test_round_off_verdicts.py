"""The verdicts on round-off: every ensemble is counted, biases are detected, controls must confirm the explanation."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from phasebench.benchmarks.experiments.extremes import brouwer, brouwer_kepler
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as verdicts
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count
from support.pages import data


def ensemble(label="a", kind=brouwer.USUAL, energy=0.5, phase=0.5, units=1.0, steps=1000, mean=0.5, **more) -> dict:
    """The fabricated row of an ensemble's round-off: exponents of growth +-0.03, size in units of round-off, mean."""
    row = {"label": label, "kind": kind, "h": 0.02, "steps": steps, "starts": 100, "in units": units}
    row |= {verdicts.MEAN: mean}
    for name, x in (("energy", energy), ("phase", phase)):
        row |= {f"{name} exponent": x, f"{name} low": x - 0.03, f"{name} high": x + 0.03}
    return row | more


def long_run(units=1.0, steps=10**6) -> dict:
    """The row of a single long run."""
    return {"label": "a", "kind": brouwer.USUAL, "h": 0.02, "steps": steps, "starts": 1, "in units": units}


CONTROL = ensemble(brouwer.CONTROL, brouwer.HAND, units=100.0)
JUDGED = {"energy": verdicts.energy, "phase": verdicts.phase, "size": verdicts.size, "bias": verdicts.bias}


def law(*rows) -> dict:
    """{name: verdict} of all of the page's verdicts on Brouwer's law, from these ensembles and the control's."""
    table = pd.DataFrame([*rows, CONTROL])
    return {name: judge(data(extremes_growth=table)) for name, judge in JUDGED.items()}


def findings(*rows) -> list[str]:
    """The names of those verdicts on Brouwer's law that are a "finding" on these rows: the claim does not hold."""
    return [name for name, found in law(*rows).items() if found.outcome == FINDING]


ABOVE = verdicts.ABOVE + 0.031


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, []),
        ({"energy": verdicts.ENERGY + 0.06}, []),
        ({"energy": verdicts.ENERGY + ABOVE}, ["energy"]),
        ({"phase": verdicts.PHASE + 0.06}, []),
        ({"phase": verdicts.PHASE + ABOVE}, ["phase"]),
        ({"units": 1.01 * verdicts.UNITS}, ["size"]),
        ({"mean": 3.0}, ["bias"]),
        ({"mean": -3.0}, ["bias"]),
    ],
)
def test_growth_size_and_bias_have_separate_verdicts(changes, wrong):
    """Each fails only if its own quantity exceeds its tolerance."""
    assert findings(ensemble(), ensemble("b", **changes), long_run()) == wrong


@pytest.mark.parametrize(("units", "wrong"), [(verdicts.UNITS, []), (1.01 * verdicts.UNITS, ["size"])])
def test_long_run_is_judged_by_its_size(units, wrong):
    assert findings(ensemble(), long_run(units)) == wrong


@pytest.mark.parametrize("kind", [brouwer.FRACTION, brouwer.ASIDE_OF, brouwer.USUAL])
def test_every_step_size_counts(kind):
    found = law(ensemble(), ensemble("b", kind, energy=0.9))["energy"]
    assert (found.measured, found.outcome, found.where) == (Count(1, 2), FINDING, "b at h = 0.02: n^0.90")


def test_handwritten_runs_do_not_count_as_ensembles():
    found = law(ensemble(), ensemble(controls.HALF, brouwer.HAND, energy=0.9))["energy"]
    assert (found.measured, found.outcome) == (Count(1, 1), PASS)
    assert law()["energy"] is None


def test_largest_error_is_shown_with_its_own_steps():
    """The largest error belongs to the shortest run."""
    rows = [ensemble("small", units=0.657, steps=10_240_000), ensemble("large", units=0.921, steps=512_000)]
    found = law(*rows)["size"]
    assert (found.measured, found.where) == (0.921, "large at h = 0.02, 512000 steps")


def test_kepler_ensemble_counts_by_its_phase_only():
    found = law(ensemble(units=0.7), ensemble(brouwer_kepler.LABEL, units=np.nan, phase=1.6))
    assert found["size"].measured == 0.7
    assert found["phase"].measured == Count(1, 2)
    assert found["phase"].where.startswith(f"{brouwer_kepler.LABEL} at h = ")


def test_both_tables_of_ensembles_are_counted():
    chosen, all_ = (
        pd.DataFrame([ensemble(), CONTROL]),
        pd.DataFrame([ensemble("m", reason=""), ensemble("n", reason="")]),
    )
    found = verdicts.energy(data(extremes_growth=chosen, extremes_growth_every=all_))
    assert found.measured == Count(3, 3)


def test_step_next_to_a_fraction_has_a_name():
    assert verdicts.named_step(brouwer.TENTH * brouwer.ASIDE) == "0.1 (1 + 2^-40)"
    assert verdicts.named_step(brouwer.TENTH) == "0.1"
    assert verdicts.named_step(brouwer.PLAIN) == "0.0123456789"


# -- biases ------------------------------------------------------------------------------------------------------------


def test_false_bias_in_one_table_of_twenty():
    """Unbiased means are named in 5 % of tables, within 3 standard errors; shifted means are named nearly always."""
    generator, tables, k = np.random.default_rng(5), 600, 40
    t = generator.standard_normal((tables, k, 100))
    means = t.mean(-1) / (t.std(-1, ddof=1) / 10)
    named = [len(verdicts.biased_ensembles(pd.DataFrame({verdicts.MEAN: row, "starts": 100}))) > 0 for row in means]
    assert abs(np.mean(named) - verdicts.CHANCE) < 3 * np.sqrt(verdicts.CHANCE / tables)
    shifted = [
        len(verdicts.biased_ensembles(pd.DataFrame({verdicts.MEAN: row + 7, "starts": 100}))) for row in means[:50]
    ]
    assert min(shifted) > 0.9 * k


def test_threshold_of_a_bias_grows_with_the_ensembles():
    rows = pd.DataFrame({"starts": [100] * 144})
    assert verdicts.critical(rows.head(1)) == pytest.approx(1.984, abs=1e-3)  # Student's t, 99 degrees of freedom
    for k in (18, 144):
        beyond = 2 * stats.t.sf(verdicts.critical(rows.head(k)), 99)
        assert (1 - beyond) ** k == pytest.approx(0.95, abs=1e-9)
    assert verdicts.critical(rows.assign(starts=10)) > 5


def test_largest_bias_is_named_first():
    rows = [ensemble(str(k), mean=0.1, reason="") for k in range(20)]
    rows += [ensemble("c", mean=4.0, reason="", by=every.ENERGY), ensemble("b", mean=-5.0, steps=1000, reason="")]
    found = verdicts.bias(data(extremes_growth_every=pd.DataFrame(rows)))
    assert (found.measured, found.outcome) == (Count(2, 22), FINDING)
    assert found.where.split(" at ")[0] == "b"
    assert "4000 steps" in found.where
    good = verdicts.bias(data(extremes_growth_every=pd.DataFrame(rows[:20])))
    assert (good.measured, good.outcome) == (Count(0, 20), PASS)


def test_steps_after_which_a_bias_dominates():
    """Walks with a mean step of 1/50 standard deviations: the drift equals the walk after 2500 steps."""
    generator, n = np.random.default_rng(1), 400
    ends = generator.standard_normal((4000, n)).sum(1) + n / 50
    mean = ends.mean() / (ends.std(ddof=1) / np.sqrt(len(ends)))
    assert verdicts.overtaken({"steps": n, "starts": len(ends), verdicts.MEAN: mean}) == pytest.approx(2500, rel=0.2)


def test_fractional_steps_do_not_count_as_biased():
    assert law(ensemble(), ensemble("b", brouwer.FRACTION, mean=40.0))["bias"].measured == Count(0, 1)
    beside = law(ensemble(), ensemble("b", brouwer.ASIDE_OF, mean=4.0))["bias"]
    assert (beside.measured, beside.outcome) == (Count(1, 2), FINDING)


@pytest.mark.parametrize(("id", "is_biased"), [("implicit-midpoint", True), ("stormer-verlet", False)])
def test_bias_is_reproduced_from_other_starts(monkeypatch, id, is_biased):
    """Four other seeds: the means of four ensembles add up if biased, else grow by the square root."""
    means = []
    for seed in (101, 102, 103, 104):
        monkeypatch.setattr(brouwer, "SEED", seed)
        means.append(every.measure_rows(id, {}, id)[every.TABLE][0][verdicts.MEAN])
    together = abs(sum(means)) / len(means) ** 0.5
    assert (together > 6) is is_biased
    assert (together < 3.5) is not is_biased


@pytest.mark.parametrize("h", [0.01, 0.25])
def test_error_in_units_of_eps_h_sqrt_n(h):
    """An error of eps h sqrt(n) is one unit for any n; as a control, 4 n steps halve it."""
    for n in (100, 400):
        size = brouwer.EPS * h * np.sqrt(n)
        ends = np.array([[0.0, size], [0.0, -size], [0.0, size], [0.0, size]])
        assert brouwer.summary(np.array([n // 2, n]), h, ends)["in units"] == pytest.approx(1, rel=1e-12)
    assert brouwer.summary(np.array([n, 4 * n]), h, ends)["in units"] == pytest.approx(0.5, rel=1e-12)


# -- fractions of small denominators -----------------------------------------------------------------------------------


def residues(beside=0.5, product=0.8, whole=0.5, plain=100.0, without=None):
    """The verdict on the explanation of the energy drift at h that are simple fractions, from fabricated control runs.

    Parameters
    ----------
    beside, product, whole : exponents of growth of the energy error slightly off the fraction, with exact products, and
        with velocity and force computed from the whole compensated state
    plain : error of plain sums in units of round-off
    without : label of a row to leave out
    """
    rows = [
        ensemble("b", brouwer.ASIDE_OF, energy=beside),
        ensemble(controls.HALF, brouwer.HAND, energy=product),
        ensemble(controls.WHOLE, brouwer.HAND, energy=whole),
        CONTROL | {"in units": plain},
    ]
    return verdicts.controls(data(extremes_growth=pd.DataFrame([r for r in rows if r["label"] != without])))


def test_drift_is_explained_if_every_control_agrees():
    assert (residues().measured, residues().outcome) == (Count(4, 4), PASS)


@pytest.mark.parametrize(
    ("broken", "where"),
    [
        ({"beside": 0.9}, "beside a fraction"),
        ({"product": 0.5}, controls.HALF),
        ({"whole": 0.9}, controls.WHOLE),
        ({"plain": verdicts.UNITS}, "plain sums"),
    ],
)
def test_deviating_control_is_a_failure(broken, where):
    found = residues(**broken)
    assert (found.measured, found.outcome, found.where) == (Count(3, 4), FAIL, where)


@pytest.mark.parametrize("missing", ["b", controls.HALF, controls.WHOLE, brouwer.CONTROL])
def test_controls_are_judged_only_together(missing):
    assert residues(without=missing) is None
