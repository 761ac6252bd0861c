"""REBOUND's integrators as peers, through its public Python interface.

`particles` describes how a system is represented in REBOUND.  SEI is left out: it is for the shearing sheet only, whose
forces depend on velocities.  Fixed-step integrators run with safe_mode = 0 if they have it: neighbouring drifts are
merged, and a corrector is applied at rows only.  Wisdom-Holman splittings use Jacobi coordinates (REBOUND's default);
for planets of relative mass eps their error is a sum of terms eps h^a + eps^2 h^b + ...; a peer's ``order`` is the
smallest exponent, measured, and ``about`` lists all of them.

Source: H. Rein, S.-F. Liu, Astron. Astrophys. 537 (2012) A128.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from phasebench.integrators.record import ROUND_OFF
from phasebench.reference.files import entries

from . import particles
from .particles import CENTRAL, GRAVITY, POTENTIAL
from .record import Claims, NotHere, Peer, Run, Start, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

    from .prepared import Calls

DOCUMENTATION = "https://rebound.readthedocs.io/en/latest/integrators/ and sim.integrator.__doc__ of version 5.2"
#: Unit (the default) in which JANUS rounds coordinates and velocities to 64-bit integers.
UNIT = 1e-16
#: Least step of IAS15 as a share of the time span: if the acceleration of a body passes through 0, steps would shrink
#: in proportion to the time left, and the run would never end (figure eight).
SHORTEST = 1e-13
#: Largest number of bodies for WHFast512.
MOST = 9

#: Kinds of settings that an integrator accepts, most special first, and their description.
ANY = (CENTRAL, GRAVITY, POTENTIAL)
KEPLERIAN = (CENTRAL, GRAVITY)
SCOPES = {
    ANY: "H = sum p_i^2 / (2 m_i) + V(q)",
    KEPLERIAN: "a Kepler part with a perturbation of positions; gravity between bodies, the first in the middle",
}
NEWTON = "a Kepler problem; gravity between bodies, the first in the middle"


def _setting(kinds: Iterable[str], forces: bool, system: PartitionedSystem) -> particles.Setting | None:
    """The first representation of a system among ``kinds``, without extra force if not ``forces``; else None."""
    settings = particles.settings(system)
    for kind in kinds:
        if kind in settings and (forces or settings[kind].gradient is None):
            return settings[kind]
    return None


def _lacks(integrator: str, kinds: tuple[str, ...], forces: bool) -> Callable[[Any, PartitionedSystem], str | None]:
    def lacks(problem: Any, system: PartitionedSystem) -> str | None:
        from phasebench.integrators.compile.codegen import compiled

        settings = particles.settings(system)
        if not settings:
            return "REBOUND integrates H = sum p_i^2 / (2 m_i) + V(q) alone"
        setting = _setting(kinds, forces, system)
        if setting is None and CENTRAL in settings:
            return "no extra force reaches it, or not all of its stages: it knows Newtonian gravity alone"
        if setting is None:
            return "it needs a body to revolve around: a declared Kepler part, or gravity between bodies"
        if setting.gradient is not None and not compiled():
            return "the extra force is compiled by Numba, which NUMBA_DISABLE_JIT switches off"
        if integrator == "whfast512":
            if len(setting.masses) > MOST:
                return f"it takes at most {MOST} bodies, not {len(setting.masses)}"
            if not _avx512():
                why = "REBOUND finds no AVX512 here (rebound.avx512_available): the processor or the build lacks it"
                return NotHere(why)
        q = getattr(problem, "q0", None)
        if setting.kind == GRAVITY and integrator in ("whfast", "whfast512", "saba") and q is not None:
            body = particles.jacobi_vanishes(setting, q)
            if body is not None:
                return (
                    f"body {body + 1} starts in the centre of mass of those before it: Jacobi coordinates are singular"
                )
        return None

    return lacks


def _avx512() -> bool:
    """True if REBOUND can run WHFast512 on this machine, or is not installed."""
    try:
        import rebound
    except ImportError:
        return True
    return getattr(rebound, "avx512_available", False)


def _fields(
    integrator: str, setting: particles.Setting, options: dict, tolerances: Iterable[str], tol: float | None
) -> dict:
    """The fields of a REBOUND integrator to set, name -> value, for a setting and a tolerance.

    They are ``options`` and, unless ``tol`` is None, ``tol`` for each name in ``tolerances``.  On a pure Kepler problem
    an integrator with the option "lazy" for its kernel gets the single field safe_mode = 0, as no corrector is needed.
    """
    fields = options | ({} if tol is None else dict.fromkeys(tolerances, tol))
    if fields.get("kernel") == "lazy" and setting.kind == CENTRAL and setting.gradient is None:
        fields = {"safe_mode": 0}  # a pure Kepler problem needs no corrector
    return fields


def _build_run(
    integrator: str, kinds: tuple[str, ...], forces: bool, options: dict, tolerances: tuple[str, ...]
) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        setting = _setting(kinds, forces, task.system)
        fields = _fields(integrator, setting, options, tolerances, task.tol)
        if integrator == "ias15":
            fields["min_dt"] = SHORTEST * task.h * task.steps
        limit = 2.0**62 * UNIT if integrator == "janus" else float("inf")
        return particles.run(task, setting, integrator, fields, adaptive=bool(tolerances), limit=limit)

    return run


def _prepare(
    integrator: str, kinds: tuple[str, ...], forces: bool, options: dict, tolerances: tuple[str, ...]
) -> Callable[[Start], Calls]:
    def prepare(start: Start) -> Calls:
        setting = _setting(kinds, forces, start.system)
        fields = _fields(integrator, setting, options, tolerances, start.tol)
        return particles.prepare(start, setting, integrator, fields, adaptive=bool(tolerances), shortest=SHORTEST)

    return prepare


def _peer(
    id: str,
    integrator: str,
    name: str,
    about: str,
    source: str,
    order: int | None = None,
    *,
    keplerian: bool = False,
    forces: bool = True,
    tolerances: tuple[str, ...] = (),
    least: float = 0.0,
    ahead: bool = False,
    claims: dict | None = None,
    options: dict | None = None,
) -> Peer:
    """Make the record of a REBOUND integrator; if it is ``keplerian``, for motion about a central body alone.

    ``integrator`` is its name in REBOUND; ``forces`` is False if it takes no extra force.  ``tolerances`` are the names
    of its fields that are set to tol, none for fixed steps; ``options`` are its fields with fixed values, name ->
    value.  The other arguments are fields of the record.
    """
    kinds = KEPLERIAN if keplerian else ANY
    return Peer(
        f"rebound-{id}",
        name,
        package="rebound",
        adaptive=bool(tolerances),
        order=order,
        license="GPL-3.0",
        about=about,
        source=source,
        run=_build_run(integrator, kinds, forces, options or {}, tolerances),
        prepare=_prepare(integrator, kinds, forces, options or {}, tolerances),
        scope=SCOPES[kinds] if forces else NEWTON,
        lacks=_lacks(integrator, kinds, forces),
        least=least,
        ahead=ahead,
        rows_end_steps=bool(tolerances),
        claims=Claims(source=DOCUMENTATION, **(claims or {})),
        settings={"integrator": integrator} | (options or {}),
    )


#: IAS15's rules for the step size; the first is the default.
ADAPTIVE_MODES = ("prs23", "individual", "global", "aarseth85")


def ias15(mode: str = ADAPTIVE_MODES[0]) -> Peer:
    """Make the record of IAS15 with one of its rules for the step size, `ADAPTIVE_MODES`; the first is the default.

    Only the record with the default rule is in the registry.
    """
    options = {} if mode == ADAPTIVE_MODES[0] else {"adaptive_mode": mode}
    return _peer(
        "ias15" if not options else f"ias15(adaptive_mode={mode})",
        "ias15",
        "IAS15, adaptive Gauss-Radau of order 15",
        "tol is REBOUND's epsilon, which is no error bound; the default 1e-9 reaches round-off; no step is shorter "
        f"than {SHORTEST:g} of the time span",
        "Rein & Spiegel 2015, Mon. Not. R. Astron. Soc. 446, 1424-1437",
        15,
        tolerances=("epsilon",),
        least=1e-11 if options else 1e-16,  # below it the steps of "individual" shrink without end
        claims={"order": 15, "symplectic": False, "energy": ROUND_OFF},
        options=options,
    )


#: Further settings of WHFast, measured for comparison but not in the registry.
TRIED = tuple(_peer(**entry) for entry in entries(__file__, "tried"))
PEERS = (ias15(), *(_peer(**entry) for entry in entries(__file__)))
