"""The style of figures: curves are told apart, rare colours survive, no labels overlap, no legend is cut off."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from phasebench.benchmarks import style


def test_curves_of_one_panel_differ_in_two_of_three():
    looks = [style.curve(k) for k in range(len(style.CURVES) * 3)]
    parts = [(x["color"], str(x["linestyle"]), x["marker"]) for x in looks]
    assert len(set(parts)) == len(parts)
    for k, a in enumerate(parts):
        for b in parts[:k]:
            assert sum(x != y for x, y in zip(a, b, strict=True)) >= 2


def test_a_few_pixels_of_a_colour_keep_it(tmp_path):
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.0)
        x = np.linspace(0, 60, 5000)
        for k, colour in enumerate((style.BLUE, style.VERMILION, style.PURPLE, style.ORANGE)):
            axes.plot(x, np.sin(x + k), color=colour)
        axes.plot([30], [1.2], "s", color=style.GREEN, markersize=4)
        style.write(figure, tmp_path / "x.png")
    with Image.open(tmp_path / "x.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    green = [int(style.GREEN[i : i + 2], 16) for i in (1, 3, 5)]
    assert np.abs(pixels - green).max(axis=1).min() <= 4


def boxes(figure, axis):
    """The boxes of an axis's visible tick labels, in pixels, from the left to the right."""
    low, high = sorted(axis.get_view_interval())
    ticks = [t for t in (*axis.get_major_ticks(), *axis.get_minor_ticks()) if low <= t.get_loc() <= high]
    labels = [t.label1 for t in ticks if t.label1.get_text()]
    return sorted((label.get_window_extent() for label in labels), key=lambda box: box.x0)


@pytest.mark.parametrize(
    ("columns", "span", "inverted"),
    [
        (1, (2e-5, 1.1e-4), False),
        (4, (1.7e-6, 5.5e-5), False),
        (4, (1.7e-6, 5.5e-5), True),
        (3, (130, 4800), False),
        (4, (60, 200), False),
        (4, (1e-8, 1.0), True),
    ],
)
def test_labels_of_a_logarithmic_axis_do_not_overlap(columns, span, inverted, tmp_path):
    with style.settings():
        figure, (panels,) = style.panels(1, columns, 3.0)
        for axes in panels:
            axes.loglog(span, (1e-9, 1.0))
            if inverted:
                axes.invert_xaxis()
        style.write(figure, tmp_path / "x.png")
        for axes in panels:
            found = boxes(figure, axes.xaxis)
            assert len(found) >= 2
            assert all(a.x1 < b.x0 for a, b in pairwise(found))


def test_control_matplotlibs_own_labels_overlap():
    with style.settings():
        figure, (panels,) = style.panels(1, 4, 3.0)
        panels[0].loglog((1.7e-6, 5.5e-5), (1e-9, 1.0))
        figure.draw_without_rendering()
        assert any(a.x1 >= b.x0 for a, b in pairwise(boxes(figure, panels[0].xaxis)))
