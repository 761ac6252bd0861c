"""What is said of round-off: every ensemble is counted, numbers of one row stand together, biases are judged."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from phasebench.benchmarks.experiments.extremes import brouwer, brouwer_kepler
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as verdicts


def data(**tables):
    """name -> table, as a page is given them."""
    return lambda name: tables.get(name)


def ensemble(label="a", kind=brouwer.USUAL, energy=0.5, phase=0.5, units=1.0, steps=1000, mean=0.5, **more) -> dict:
    """The row of an ensemble; its exponents are known to 0.03."""
    row = {"label": label, "kind": kind, "h": 0.02, "steps": steps, "starts": 100, "in units": units}
    row |= {verdicts.MEAN: mean}
    for name, x in (("energy", energy), ("phase", phase)):
        row |= {f"{name} exponent": x, f"{name} low": x - 0.03, f"{name} high": x + 0.03}
    return row | more


def long_run(units=1.0, steps=10**6) -> dict:
    return {"label": "a", "kind": brouwer.USUAL, "h": 0.02, "steps": steps, "starts": 1, "in units": units}


CONTROL = ensemble(brouwer.CONTROL, brouwer.HAND, units=100.0)


def law(*rows):
    return verdicts.brouwers_law(data(extremes_growth=pd.DataFrame(rows)))


ABOVE = verdicts.ABOVE + 0.031


@pytest.mark.parametrize(
    ("changes", "holds", "counts"),
    [
        ({}, True, ("2 of 2", "in 2.")),
        ({"energy": verdicts.ENERGY + 0.06}, True, ("1 of 2", "in 2.")),
        ({"energy": verdicts.ENERGY + ABOVE}, False, ("1 of 2", "in 2.")),
        ({"phase": verdicts.PHASE + 0.06}, True, ("2 of 2", "in 1 (")),
        ({"phase": verdicts.PHASE + ABOVE}, False, ("2 of 2", "in 1 (")),
        ({"units": 1.01 * verdicts.UNITS}, False, ("2 of 2", "in 2.")),
        ({"mean": 3.0}, False, ("2 of 2", "in 2.")),
        ({"mean": -3.0}, False, ("2 of 2", "in 2.")),
    ],
)
def test_brouwers_law_fails_for_growth_size_and_bias(changes, holds, counts):
    """What is counted is by intervals; it fails from a tolerance on."""
    found = law(ensemble(), ensemble("b", **changes), CONTROL, long_run())
    assert found.holds is holds
    assert f"in {counts[0]} ensembles" in found.text
    assert f"than n^1.5 {counts[1]}" in found.text
    assert found.short == f"Round-off grows by Brouwer's law in {counts[0]} ensembles."


def test_brouwers_law_fails_for_a_long_run_and_for_a_blind_control():
    assert not law(ensemble(), CONTROL, long_run(1.01 * verdicts.UNITS)).holds
    assert law(ensemble(), CONTROL, long_run(verdicts.UNITS)).holds
    blind = law(ensemble(), CONTROL | {"in units": verdicts.UNITS})
    assert not blind.holds
    assert "not told apart" in blind.text
    assert law(ensemble()) is None
    assert law(CONTROL) is None


@pytest.mark.parametrize("kind", [brouwer.FRACTION, brouwer.ASIDE_OF, brouwer.USUAL])
def test_no_step_is_left_out_of_the_law(kind):
    found = law(ensemble(), ensemble("b", kind, energy=0.9), CONTROL)
    assert not found.holds
    assert "in 1 of 2 ensembles (above it: b at h = 0.02, n^0.90 [0.87, 0.93])" in found.text


def test_the_runs_by_hand_are_no_ensembles_of_the_law():
    found = law(ensemble(), ensemble(controls.HALF, brouwer.HAND, energy=0.9), CONTROL)
    assert found.holds
    assert "in 1 of 1 ensembles" in found.text


def test_a_size_stands_beside_its_own_steps():
    """The largest is of the shortest run; the longest run has another size."""
    rows = [ensemble("small", units=0.657, steps=10_240_000), ensemble("large", units=0.921, steps=512_000)]
    rows += [ensemble("near", brouwer.FRACTION, units=5.0, steps=2000), ensemble("near", brouwer.FRACTION, units=4.0)]
    text = law(*rows, CONTROL, long_run(1.5, 10**7), long_run(1.7, 10**6)).text
    assert "0.921 (large at h = 0.02, 512000 steps), next to fractions 5 (near at h = 0.02, 2000 steps), " in text
    assert "of the long run 1.7 (a at h = 0.02, 1.00e+06 steps), plain sums, the control, 100 " in text
    assert "1.02e+07" not in text


def test_kepler_has_no_size_and_its_phase_is_counted_with_its_interval():
    kepler = ensemble(brouwer_kepler.LABEL, units=np.nan, phase=1.575)
    found = law(ensemble(units=0.7), kepler, CONTROL)
    assert "than n^1.5 in 1 (above it: wisdom-holman on Kepler at h = 0.02, n^1.57 [1.54, 1.60])" in found.text
    assert "n^(1/2): 0.7 (a" in found.text


def test_a_step_beside_a_fraction_is_named_as_that():
    assert verdicts.named_step(brouwer.TENTH * brouwer.ASIDE) == "0.1 (1 + 2^-40)"
    assert verdicts.named_step(brouwer.TENTH) == "0.1"
    assert verdicts.named_step(brouwer.PLAIN) == "0.0123456789"


# -- biases ------------------------------------------------------------------------------------------------------------


def test_a_bias_is_named_by_chance_in_one_table_of_twenty():
    """Unbiased means, as many tables as tell 5 % within 3 standard errors; tables of shifted means are all named."""
    generator, tables, k = np.random.default_rng(5), 600, 40
    t = generator.standard_normal((tables, k, 100))
    means = t.mean(-1) / (t.std(-1, ddof=1) / 10)
    named = [len(verdicts.biased(pd.DataFrame({verdicts.MEAN: row, "starts": 100}))) > 0 for row in means]
    assert abs(np.mean(named) - verdicts.CHANCE) < 3 * np.sqrt(verdicts.CHANCE / tables)
    shifted = [len(verdicts.biased(pd.DataFrame({verdicts.MEAN: row + 7, "starts": 100}))) for row in means[:50]]
    assert min(shifted) > 0.9 * k


def test_the_more_ensembles_the_farther_a_mean_may_be_by_chance():
    rows = pd.DataFrame({"starts": [100] * 144})
    assert verdicts.critical(rows.head(1)) == pytest.approx(1.984, abs=1e-3)  # Student's, 99 degrees of freedom
    for k in (18, 144):
        beyond = 2 * stats.t.sf(verdicts.critical(rows.head(k)), 99)
        assert (1 - beyond) ** k == pytest.approx(0.95, abs=1e-9)
    assert verdicts.critical(rows.assign(starts=10)) > 5


def test_biases_are_named_the_farthest_first_with_the_steps_after_which_they_lead():
    rows = [ensemble(str(k), mean=0.1, reason="") for k in range(20)]
    rows += [ensemble("b", mean=-5.0, steps=1000, reason=""), ensemble("c", mean=4.0, reason="", by=every.ENERGY)]
    found = verdicts.every_method(data(extremes_growth_every=pd.DataFrame(rows)))
    assert not found.holds
    assert "2 of 22: b at h = 0.02, -5.0 (overtakes the walk after 4000 steps) and c at h = 0.02, 4.0 (an" in found.text
    assert found.short.endswith("; 2 are biased.")
    good = verdicts.every_method(data(extremes_growth_every=pd.DataFrame(rows[:20])))
    assert good.holds
    assert good.short.endswith("; 0 are biased.")


def test_a_bias_leads_when_its_mean_is_as_large_as_the_walk():
    """Walks with a mean step of 1/50 standard deviations: equal after 2500 steps."""
    generator, n = np.random.default_rng(1), 400
    ends = generator.standard_normal((4000, n)).sum(1) + n / 50
    mean = ends.mean() / (ends.std(ddof=1) / np.sqrt(len(ends)))
    assert verdicts.overtaken({"steps": n, "starts": len(ends), verdicts.MEAN: mean}) == pytest.approx(2500, rel=0.2)


def test_a_drift_next_to_a_fraction_is_no_bias_of_the_others():
    assert "No mean is beyond" in law(ensemble(), ensemble("b", brouwer.FRACTION, mean=40.0), CONTROL).text
    beside = law(ensemble(), ensemble("b", brouwer.ASIDE_OF, mean=4.0), CONTROL)
    assert not beside.holds
    assert "1 of 2: b at h = 0.02, 4.0" in beside.text


@pytest.mark.parametrize(("id", "is_biased"), [("implicit-midpoint", True), ("stormer-verlet", False)])
def test_the_bias_that_is_named_is_there_from_other_starts_too(monkeypatch, id, is_biased):
    """Four seeds that the pages do not use; the means of four ensembles add up, and chance adds up as a root."""
    means = []
    for seed in (101, 102, 103, 104):
        monkeypatch.setattr(brouwer, "SEED", seed)
        means.append(every.measured(id, {}, id)[every.TABLE][0][verdicts.MEAN])
    together = abs(sum(means)) / len(means) ** 0.5
    assert (together > 6) is is_biased
    assert (together < 3.5) is not is_biased


@pytest.mark.parametrize("h", [0.01, 0.25])
def test_an_error_is_told_in_units_of_eps_h_and_the_root_of_the_steps(h):
    """An error of eps h sqrt(n) is one unit after any number of steps; the control is four times the steps."""
    for n in (100, 400):
        size = brouwer.EPS * h * np.sqrt(n)
        ends = np.array([[0.0, size], [0.0, -size], [0.0, size], [0.0, size]])
        assert brouwer.summary(np.array([n // 2, n]), h, ends)["in units"] == pytest.approx(1, rel=1e-12)
    assert brouwer.summary(np.array([n, 4 * n]), h, ends)["in units"] == pytest.approx(0.5, rel=1e-12)


# -- fractions of small denominators -----------------------------------------------------------------------------------


def residues(fraction=0.9, beside=0.5, product=0.8, whole=0.5, without=None, mean=0.1):
    kinds = {"a": (brouwer.FRACTION, fraction), "b": (brouwer.ASIDE_OF, beside)}
    kinds |= {controls.HALF: (brouwer.HAND, product), controls.WHOLE: (brouwer.HAND, whole)}
    rows = [
        ensemble(label, kind, energy=e, mean=mean if label == "b" else 0.1)
        for label, (kind, e) in kinds.items()
        if label != without
    ]
    return verdicts.small_denominators(data(extremes_growth=pd.DataFrame(rows)))


def test_a_drift_is_explained_only_where_every_control_says_so():
    found = residues()
    assert not found.holds
    assert "the bias is of the rounded state's few residues" in found.text
    for broken in ({"beside": 0.9}, {"product": 0.5}, {"whole": 0.9}):
        assert "not explained" in residues(**broken).text
    assert residues(fraction=0.5).holds
    for missing in ("a", "b", controls.HALF, controls.WHOLE):
        assert residues(without=missing) is None, "not judged without all four"


def test_a_mean_that_stays_beside_the_fraction_is_told():
    assert re.search(r"No mean is beyond the 2\.0 standard errors", residues().text)
    assert "so a bias, has 1 of 1: b at h = 0.02, 3.1" in residues(mean=3.1).text
