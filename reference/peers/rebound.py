"""REBOUND's integrators as peers, through its public Python interface.

`particles` describes how a system is represented in REBOUND.  SEI is left out: it is for the shearing sheet only, whose
forces depend on velocities.  Fixed-step integrators run with safe_mode = 0 if they have it: neighbouring drifts are
merged, and a corrector is applied at rows only.  Wisdom-Holman splittings use Jacobi coordinates (REBOUND's default);
for planets of relative mass eps their error is a sum of terms eps h^a + eps^2 h^b + ...; a peer's ``order`` is the
smallest exponent, measured, and ``about`` lists all of them.

Source: H. Rein, S.-F. Liu, Astron. Astrophys. 537 (2012) A128.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from phasebench.integrators.record import ROUND_OFF
from phasebench.reference.files import entries

from . import particles
from .forms import CENTRAL, GRAVITY, POTENTIAL, Setting, settings
from .record import Claims, NotHere, Peer, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

DOCUMENTATION = "https://rebound.readthedocs.io/en/latest/integrators/ and sim.integrator.__doc__ of version 5.2"
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


def _setting(kinds: tuple[str, ...], forces: bool, system: PartitionedSystem) -> Setting | None:
    """The first representation of a system among ``kinds``, without extra force if not ``forces``; else None."""
    found = settings(system)
    return next((found[k] for k in kinds if k in found and (forces or found[k].gradient is None)), None)


def _lacks(integrator: str, kinds: tuple[str, ...], forces: bool) -> Callable[[Any, PartitionedSystem], str | None]:
    def lacks(problem: Any, system: PartitionedSystem) -> str | None:
        from phasebench.integrators.compile.codegen import compiled

        if not settings(system):
            return "REBOUND integrates H = sum p_i^2 / (2 m_i) + V(q) alone"
        setting = _setting(kinds, forces, system)
        if setting is None and CENTRAL in settings(system):
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


def _peer(
    id: str,
    integrator: str,
    keplerian: bool = False,
    forces: bool = True,
    tolerances: tuple[str, ...] = (),
    claims: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
    **facts: Any,
) -> Peer:
    """Make the record of a REBOUND integrator; if it is ``keplerian``, for motion about a central body alone.

    ``integrator`` is its name in REBOUND; ``forces`` is False if it takes no extra force.  ``tolerances`` are the names
    of its fields that are set to tol, none for fixed steps; ``options`` are its fields with fixed values, name ->
    value.  ``facts`` are further fields of the record.
    """
    kinds, adaptive, options = KEPLERIAN if keplerian else ANY, bool(tolerances), dict(options or {})

    def given(task: Task) -> tuple[Setting, str, dict]:
        """The setting of the task's system, the integrator, and its fields to set, name -> value."""
        setting = _setting(kinds, forces, task.system)
        fields = options | task.tolerances(*tolerances)
        if fields.get("kernel") == "lazy" and setting.kind == CENTRAL and setting.gradient is None:
            fields = {"safe_mode": 0}  # a pure Kepler problem needs no corrector
        return setting, integrator, fields

    return Peer(
        f"rebound-{id}",
        package="rebound",
        adaptive=adaptive,
        license="GPL-3.0",
        run=lambda task: particles.run(task, *given(task), adaptive),
        prepare=lambda task: particles.prepare(task, *given(task), adaptive),
        scope=SCOPES[kinds] if forces else NEWTON,
        lacks=_lacks(integrator, kinds, forces),
        rows_end_steps=adaptive,
        claims=Claims(source=DOCUMENTATION, **(claims or {})),
        settings={"integrator": integrator} | options,
        **facts,
    )


#: IAS15's rules for the step size; the first is the default.
ADAPTIVE_MODES = ("prs23", "individual", "global", "aarseth85")


def ias15(mode: str = ADAPTIVE_MODES[0]) -> Peer:
    """The record of IAS15 with one of its rules for the step size, `ADAPTIVE_MODES`; the registry has the first."""
    options = {} if mode == ADAPTIVE_MODES[0] else {"adaptive_mode": mode}
    return _peer(
        "ias15" if not options else f"ias15(adaptive_mode={mode})",
        "ias15",
        name="IAS15, adaptive Gauss-Radau of order 15",
        about="tol is REBOUND's epsilon, which is no error bound; the default 1e-9 reaches round-off; no step is "
        f"shorter than {particles.SHORTEST:g} of the time span",
        source="Rein & Spiegel 2015, Mon. Not. R. Astron. Soc. 446, 1424-1437",
        order=15,
        tolerances=("epsilon",),
        least=1e-11 if options else 1e-16,  # below it the steps of "individual" shrink without end
        claims={"order": 15, "symplectic": False, "energy": ROUND_OFF},
        options=options,
    )


#: Further settings of WHFast, measured for comparison but not in the registry.
TRIED = tuple(_peer(**entry) for entry in entries(__file__, "tried"))
PEERS = (ias15(), *(_peer(**entry) for entry in entries(__file__)))
