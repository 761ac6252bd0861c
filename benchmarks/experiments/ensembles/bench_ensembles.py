"""Checks of ensembles of orbits: every orbit reaches its end, and SIMD lanes end where the scalar kernel ends."""

from __future__ import annotations

from phasebench.benchmarks.experiments.ensembles import against, lanes, maps

#: The largest distance allowed between ends: sines that differ in the last bit move a regular orbit by less.
APART = 1e-11


def cells(quick: bool = False) -> list:
    """List the measurements of `lanes`, `against` and `maps`."""
    return lanes.cells(quick) + against.cells(quick) + maps.cells(quick)


def off(rows) -> list[str]:
    """A line for each ensemble with an orbit that fails, or that ends elsewhere than with the scalar kernel."""
    out = []
    for r in rows:
        if r["method"] == lanes.CEILING:
            continue
        where = f"{r['method']} on {r['problem']}"
        if r["status"] != "ok":
            out.append(f"{where}: {r['status']}")
        elif not r["largest difference"] <= APART:
            out.append(f"{where}: {r['largest difference']:.1e} from the scalar kernel")
    return out


def bench_lanes(measured_rows):
    """Every lane ends where the scalar kernel ends."""
    wrong = off(measured_rows(lanes.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_against(measured_rows):
    """Both sides reach an error of 1e-6 on every problem, so that the comparison is one of working integrators."""
    rows = measured_rows(against.TABLE)
    for problem in {r["problem"] for r in rows}:
        for side in ("ours", "heyoka"):
            least = min(r["error"] for r in rows if (r["problem"], r["side"]) == (problem, side) and r["error"] >= 0)
            assert least < 1e-6, (problem, side, least)


def bench_maps(measured_rows):
    """The states on the Poincare section have the energy of the start."""
    wrong = [r["line"] for r in measured_rows(maps.TABLE) if r["map"] == maps.SECTION and not r["energy error"] < 1e-5]
    assert not wrong, wrong
