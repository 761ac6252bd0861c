"""The figures of the talks: small files, byte-identical when redrawn, nothing cut off; the measurements behind them."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from phasebench.benchmarks import style
from phasebench.benchmarks.experiments.talks import (
    convergence,
    henon_heiles,
    linear_map,
    measure,
    pendulum,
    perturbed_kepler,
)
from phasebench.benchmarks.experiments.talks.gallery import FIGURES, pictures
from phasebench.benchmarks.experiments.talks.page import PAGES
from phasebench.benchmarks.store.arrays import pack, unpack
from phasebench.integrators.errors import InvalidInput

IDS = [f.id for f in FIGURES]


@pytest.fixture(scope="module")
def curves(tmp_path_factory):
    """The rows of all figures of the talks, measured in quick mode and read back from a CSV file."""
    path = tmp_path_factory.mktemp("curves") / "curves.csv"
    rows = [row for figure in FIGURES if figure.measure for row in figure.rows(quick=True)]
    pd.DataFrame(rows).to_csv(path, index=False)
    return pd.read_csv(path)


@pytest.fixture(scope="module")
def saved_figures(curves, tmp_path_factory):
    """(folder, captions by figure) of all figures."""
    folder = tmp_path_factory.mktemp("figures")
    drawn = [p for section in dict.fromkeys(f.section for f in FIGURES) for p in pictures(curves, section, folder)]
    return folder, {p.file.removesuffix(".png"): p.caption for p in drawn}


@pytest.fixture(scope="module")
def drawings(curves):
    """{figure's id: matplotlib figure} of the talks' figures of errors and differences."""
    wanted = [f for f in FIGURES if any(word in f.id for word in ("energy", "invariants", "convergence"))]
    return {f.id: f.draw(curves[curves["figure"] == f.id])[0] for f in wanted}


def test_records_are_complete_and_frozen():
    assert isinstance(FIGURES, tuple)
    assert len(set(IDS)) == len(IDS)
    assert {f"talk-{f.section}" for f in FIGURES} == {p.id for p in PAGES}
    with pytest.raises(dataclasses.FrozenInstanceError):
        FIGURES[0].id = "other"


@pytest.mark.parametrize("id", IDS)
def test_figure_is_drawn_small_and_captioned(saved_figures, id):
    folder, captions = saved_figures
    path = folder / f"{id}.png"
    assert 5_000 < path.stat().st_size <= 150_000
    with Image.open(path) as image:
        assert image.width == pytest.approx(style.WIDTH * style.DPI, abs=1)
        assert len(image.getcolors(image.width * image.height)) > 8
        assert not set(image.info) - {"transparency", "gamma", "dpi"}
    caption = captions[id]
    assert caption.endswith(".")
    assert any(c.isdigit() for c in caption)
    assert "nan" not in caption


def test_redrawn_figures_are_byte_identical(curves, saved_figures, tmp_path):
    folder, _ = saved_figures
    for picture in pictures(curves, "convergence", tmp_path):
        assert (tmp_path / picture.file).read_bytes() == (folder / picture.file).read_bytes(), picture.file


def test_figure_without_rows_is_left_out(curves, tmp_path):
    some = curves[curves["figure"] != "convergence-preserving"]
    assert [p.file for p in pictures(some, "convergence", tmp_path)] == [
        "convergence-schemes-i-iii.png",
        "convergence-compositions.png",
    ]


def test_stored_curves_are_small(curves):
    assert curves["x"].str.len().max() < 32_000
    assert curves["y"].str.count(" ").max() < 2_500


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


def test_import_does_not_load_matplotlib():
    code = "import sys, phasebench.benchmarks.experiments.talks.gallery; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_no_curve_is_cut_off(drawings):
    for id, drawing in drawings.items():
        for axes in drawing.axes:
            low, high = axes.get_ylim()
            for line in axes.get_lines():
                y = line.get_ydata()
                assert y.min() >= low, id
                assert y.max() <= high, id


def test_font_size_is_at_least_8_points(drawings):
    from matplotlib.text import Text

    for id, drawing in drawings.items():
        assert min(t.get_fontsize() for t in drawing.findobj(Text)) >= 8, id


def test_user_settings_change_no_figure(curves):
    import matplotlib

    with matplotlib.rc_context({"font.size": 30, "axes.titlesize": 30}):
        drawing, _ = linear_map.parallelograms(curves[curves["figure"] == "linear-symplectic-map"])
    assert drawing.axes[0].title.get_fontsize() == style.RC["axes.titlesize"]


def test_area_in_phase_space_by_method(curves):
    rows = curves[curves["figure"] == "pendulum-area"].dropna(subset=["area"])
    changes = {}
    for title, id, substeps in pendulum.CARRIERS:
        areas = np.array([measure.enclosed_area(face) for face in pendulum.cat_images(id, substeps, 256)])
        changes[id] = np.abs(areas - areas[0]).max()
        assert rows[rows["panel"] == title]["area"].to_numpy() == pytest.approx(areas, abs=1e-12)
    assert changes["symplectic-euler-p"] < 1e-12
    assert changes["implicit-midpoint"] < 1e-12
    assert changes["rk4"] < 1e-10
    assert changes["explicit-euler"] > 0.1


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


def test_stored_energy_error_is_the_maximum(curves):
    rows = curves[curves["figure"] == "henon-heiles-scheme-i-energy"].set_index(["panel", "curve"])
    for orbit in henon_heiles.ORBITS:
        start = measure.start(f"henon-heiles:{orbit}")
        for lam in measure.LAMBDAS:
            error = measure.energy_error(start, measure.run(start, "scheme-i", henon_heiles.STEP, 100.0, lam=lam)).max()
            assert rows.loc[(orbit, f"λ = {lam}"), "energy_error"] == pytest.approx(error, rel=1e-12)


def test_angular_momentum_of_avf_and_schemes_iv_v(curves):
    kepler = measure.start("perturbed-kepler")
    errors = {}
    for id, _ in perturbed_kepler.PRESERVING.values():
        solution = measure.run(kepler, id, perturbed_kepler.STEP, 100.0)
        errors[id] = perturbed_kepler.invariant_error("angular-momentum", solution).max()
        assert perturbed_kepler.invariant_error("energy", solution).max() < 1e-13
    assert errors["scheme-iv"] < 1e-13
    assert errors["scheme-v"] < 1e-13
    assert errors["avf"] > 1e-6
    rows = curves[curves["figure"] == "perturbed-kepler-preserving-invariants"].set_index(["panel", "curve"])
    assert rows.loc[("angular-momentum", "AVF"), "largest"] == pytest.approx(errors["avf"], rel=1e-9)


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
