"""Ensembles: every time is of orbits that arrived, and lanes end where the scalar kernel ends."""

from __future__ import annotations

from phasebench.benchmarks.experiments.ensembles import against, lanes, maps

#: Of a regular motion over these steps: a sine that rounds otherwise in the last bit moves the end by no more.
APART = 1e-11


def cells(quick: bool = False) -> list:
    """The steps' costs, the costs beside heyoka's batches, the maps."""
    return lanes.cells(quick) + against.cells(quick) + maps.cells(quick)


def off(rows) -> list[str]:
    """Ensembles that do not arrive, or end elsewhere than the scalar kernel."""
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


def bench_lanes(measured):
    """Every lane arrives where the scalar kernel does."""
    wrong = off(measured(lanes.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_against(measured):
    """Both sides reach small errors: the comparison is one of working integrators."""
    rows = measured(against.TABLE)
    for problem in {r["problem"] for r in rows}:
        for side in ("ours", "heyoka"):
            least = min(r["error"] for r in rows if (r["problem"], r["side"]) == (problem, side) and r["error"] >= 0)
            assert least < 1e-6, (problem, side, least)


def bench_maps(measured):
    """The section keeps the energy."""
    wrong = [r["line"] for r in measured(maps.TABLE) if r["map"] == maps.SECTION and not r["energy error"] < 1e-5]
    assert not wrong, wrong
