"""Checks of ensembles of orbits: every orbit reaches its end, and SIMD lanes end where the scalar kernel ends.

SIMD lanes carry several orbits side by side in a vector register, the scalar kernel one orbit at a time.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.ensembles import against, lanes, maps

#: The largest distance allowed between ends: sines that differ in the last bit move a regular orbit by less.
APART = 1e-11


def cells(quick: bool = False) -> list:
    """List the measurements (`Cell`) of the modules `lanes`, `against` and `maps`, also if ``quick``."""
    return lanes.cells(quick) + against.cells(quick) + maps.cells(quick)


def off(rows: list[dict]) -> list[str]:
    """Return a message for each ensemble of which an orbit fails, or ends elsewhere than with the scalar kernel.

    ``rows`` are those of the table `lanes.TABLE`, one for each ensemble.
    """
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


def bench_lanes(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every orbit of an ensemble in SIMD lanes ends where the scalar kernel ends.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows(lanes.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_against(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that both this project and heyoka reach an error of 1e-6 on every problem.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(against.TABLE)
    for problem in {r["problem"] for r in rows}:
        for side in ("ours", "heyoka"):
            least = min(r["error"] for r in rows if (r["problem"], r["side"]) == (problem, side) and r["error"] >= 0)
            assert least < 1e-6, (problem, side, least)


def bench_maps(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the states on the Poincare section of Henon-Heiles have the energy of the start.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [r["line"] for r in measured_rows(maps.TABLE) if r["map"] == maps.SECTION and not r["energy error"] < 1e-5]
    assert not wrong, wrong
