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

from phasebench.integrators.record import DRIFT, ROUND_OFF

from . import particles
from .particles import CENTRAL, GRAVITY, POTENTIAL
from .record import Claims, NotHere, Peer, Run, Start, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

    from .prepared import Calls

DOCUMENTATION = "https://rebound.readthedocs.io/en/latest/integrators/ and sim.integrator.__doc__ of version 5.2"
HIGH_ORDER = "Rein, Tamayo & Brown 2019, Mon. Not. R. Astron. Soc. 489, 4632-4640"
WISDOM_HOLMAN = "Rein & Tamayo 2015, Mon. Not. R. Astron. Soc. 452, 376-388"
EMBEDDED = "Rein 2020, Mon. Not. R. Astron. Soc. 492, 5413"
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
    order: int | None,
    about: str,
    source: str,
    *,
    kinds: tuple[str, ...] = ANY,
    forces: bool = True,
    tolerances: tuple[str, ...] = (),
    least: float = 0.0,
    claims: dict | None = None,
    options: dict | None = None,
) -> Peer:
    """Make the record of a REBOUND integrator for systems with a `particles.Setting` of these ``kinds``.

    ``integrator`` is its name in REBOUND; ``forces`` is False if it takes no extra force.  ``tolerances`` are the names
    of its fields that are set to tol, none for fixed steps; ``options`` are its fields with fixed values, name ->
    value.  The other arguments are fields of the record.
    """
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
        15,
        "tol is REBOUND's epsilon, which is no error bound; the default 1e-9 reaches round-off; no step is shorter "
        f"than {SHORTEST:g} of the time span",
        "Rein & Spiegel 2015, Mon. Not. R. Astron. Soc. 446, 1424-1437",
        tolerances=("epsilon",),
        least=1e-11 if options else 1e-16,  # below it the steps of "individual" shrink without end
        claims={"order": 15, "symplectic": False, "energy": ROUND_OFF},
        options=options,
    )


ADAPTIVE = (
    ias15(),
    _peer(
        "bs",
        "bs",
        "Gragg-Bulirsch-Stoer extrapolation of adaptive step and order",
        None,
        "tol is eps_abs = eps_rel, the local error of coordinates and velocities; the default is 1e-8; below the least "
        "one its steps shrink without end",
        "Hairer, Norsett & Wanner 1993, II.9",
        tolerances=("eps_abs", "eps_rel"),
        least=1e-14,
        claims={"symplectic": False, "energy": DRIFT},
    ),
)


def _whfast(
    id: str,
    name: str,
    order: int,
    about: str,
    source: str = HIGH_ORDER,
    *,
    forces: bool = True,
    claims: dict | None = None,
    **options: Any,
) -> Peer:
    claims = {"symplectic": True} | (claims or {})
    options = {"safe_mode": 0} | options
    return _peer(
        id, "whfast", name, order, about, source, kinds=KEPLERIAN, forces=forces, claims=claims, options=options
    )


CORRECTED = "eps h^{} + eps^2 h^2: the corrector of order {}, the default kernel"
WHFAST = (
    _whfast(
        "whfast",
        "WHFast, Wisdom-Holman splitting, with corrector and lazy kernel",
        4,
        "eps h^18 + eps^2 h^4: corrector 17 and the lazy kernel, except on a pure Kepler problem, where it is exact up "
        "to round-off; with gravity between bodies eps^3 h^2 is measured besides, so its order is 2 there",
        f"{WISDOM_HOLMAN}; {HIGH_ORDER}",
        corrector=17,
        kernel="lazy",
    ),
    _whfast("whfast-plain", "WHFast without corrector", 2, "eps h^2", WISDOM_HOLMAN, claims={"order": 2}),
    *(
        _whfast(
            f"whfast-corrector-{n}",
            f"WHFast with the corrector of order {n}",
            2,
            CORRECTED.format(n + 1, n),
            WISDOM_HOLMAN,
            claims={"order": 2},
            corrector=n,
        )
        for n in (3, 5, 7, 11, 17)
    ),
    _whfast(
        "whfast-modifiedkick",
        "WHFast with corrector and modified kick",
        4,
        "eps h^18 + eps^2 h^4: corrector 17 and the exact modified kick, which is of Newtonian gravity alone",
        forces=False,
        corrector=17,
        kernel="modifiedkick",
    ),
    _whfast(
        "whfast-composition",
        "WHFast with corrector and composition kernel",
        4,
        "eps h^18 + eps^2 h^4: corrector 17 and a kernel of several kicks",
        corrector=17,
        kernel="composition",
    ),
    *(
        _peer(
            "whfast512" if not corrector else f"whfast512-corrector-{corrector}",
            "whfast512",
            f"WHFast512, Wisdom-Holman splitting in AVX512 instructions{with_}",
            2,
            f"{terms}; at most {MOST} bodies, in units of G = 1; it ignores extra forces; the steps between two rows "
            "are one call",
            "Javaheri, Rein & Tamayo 2023, Open J. Astrophys. 6",
            kinds=KEPLERIAN,
            forces=False,
            claims={"symplectic": True},
            options={"corrector": corrector} if corrector else {},
        )
        for corrector, with_, terms in (
            (0, "", "eps h^2, without corrector"),
            (17, ", with corrector", "eps h^18 + eps^2 h^2: the corrector of order 17"),
        )
    ),
)


#: Further settings of WHFast, measured for comparison but not in the registry.
TRIED = (
    *(
        _whfast(f"whfast(coordinates={c})", f"WHFast in {c} coordinates", 2, "eps h^2", WISDOM_HOLMAN, coordinates=c)
        for c in ("democraticheliocentric", "whds", "barycentric")
    ),
    *(
        _whfast(
            f"whfast({kernel}, corrector2)",
            f"WHFast with both correctors and the {kernel} kernel",
            2 if kernel == "default" else 4,
            "corrector 17 and the second corrector",
            forces=kernel != "modifiedkick",
            corrector=17,
            corrector2=1,
            kernel=kernel,
        )
        for kernel in ("default", "lazy", "modifiedkick", "composition")
    ),
)


def _saba(type: str, order: int, about: str, source: str, forces: bool = True, claim: int | None = None) -> Peer:
    id = type.lower().replace("_", "-")
    kind = {"c": "SABAC", "h": "SABAH"}.get(id[0], "SABA")
    numbers = id.lstrip("cmhl-").replace("-", ",")
    how = {"cm": ", modified kick", "cl": ", lazy corrector"}.get(id[:2], "")
    return _peer(
        f"saba-{id}",
        "saba",
        f"{kind}({numbers}){how}" if "," in numbers else f"{kind}{numbers}{how}",
        order,
        about,
        source,
        kinds=KEPLERIAN,
        forces=forces,
        claims={"symplectic": True, "order": claim},
        options={"safe_mode": 0, "type": type},
    )


LASKAR = "Laskar & Robutel 2001, Celest. Mech. Dyn. Astron. 80, 39-62"
BLANES = "Blanes et al. 2013, Appl. Numer. Math. 68, 58-72"
SABA = (
    *(_saba(str(n), 2, f"eps h^{2 * n} + eps^2 h^2", LASKAR) for n in (1, 2, 3, 4)),
    *(
        _saba(f"CM_{n}", 2 if n == 1 else 4, f"eps h^{2 * n} + eps^2 h^4; of Newtonian gravity alone", LASKAR, False)
        for n in (1, 2, 3, 4)
    ),
    *(_saba(f"CL_{n}", 2 if n == 1 else 4, f"eps h^{2 * n} + eps^2 h^4", LASKAR) for n in (1, 2, 3, 4)),
    _saba("10_4", 4, "eps h^10 + eps^2 h^4", BLANES, claim=4),
    *(_saba(f"{a}_6_4", 4, f"eps h^{a} + eps^2 h^6 + eps^3 h^4", BLANES, claim=4) for a in (8, 10)),
    _saba("H_8_4_4", 4, "eps h^8 + eps^2 h^4 + eps^3 h^4", BLANES, claim=4),
    *(_saba(f"H_{a}_6_4", 4, f"eps h^{a} + eps^2 h^6 + eps^3 h^4", BLANES, claim=4) for a in (8, 10)),
)

LEAPFROG = tuple(
    _peer(
        "leapfrog" if n == 2 else f"leapfrog-{n}",
        "leapfrog",
        "REBOUND's leapfrog, drift-kick-drift" if n == 2 else f"composition of leapfrogs of order {n}",
        n,
        f"{kicks} force evaluation{'s' if kicks > 1 else ''} a step",
        "Rein & Liu 2012, Astron. Astrophys. 537, A128" if n == 2 else "Yoshida 1990; Blanes & Casas 2016, p. 91",
        claims={"order": n, "symplectic": True},
        options={"order": n},
    )
    for n, kicks in ((2, 1), (4, 3), (6, 9), (8, 17))
)

JANUS = tuple(
    _peer(
        f"janus-{n}",
        "janus",
        f"JANUS of order {n}, bitwise reversible",
        n,
        f"coordinates and velocities are integers of 64 bits in units of {UNIT:g} (scale_pos, scale_vel), hence up to "
        f"{2.0**63 * UNIT:.0f}; the run ends at half of that",
        "Rein & Tamayo 2018, Mon. Not. R. Astron. Soc. 473, 3351-3357",
        claims={"order": n, "symplectic": True, "reversible": True},
        options={"order": n, "scale_pos": UNIT, "scale_vel": UNIT},
    )
    for n in (2, 4, 6, 8, 10)
)


def _eos(id: str, outer: str, inner: str, order: int, forces: bool = True) -> Peer:
    return _peer(
        id,
        "eos",
        f"embedded operator splitting, {outer} around {inner}",
        order,
        f"phi0 = {outer} for the kicks between planets and extra forces, phi1 = {inner}, n = 2, for the centre's",
        EMBEDDED,
        forces=forces,
        kinds=ANY if forces else KEPLERIAN,
        claims={"order": order},
        options={"safe_mode": 0, "n": 2, "phi0": outer, "phi1": inner},
    )


EOS = (
    _eos("eos", "LF", "LF", 2),
    _eos("eos-lf4", "LF4", "LF4", 4),
    _eos("eos-lf8", "LF8", "LF8", 8),
    _eos("eos-pmlf6", "PMLF6", "LF8", 6, forces=False),
)

HYBRID = (
    _peer(
        "mercurius",
        "mercurius",
        "MERCURIUS, Wisdom-Holman splitting, IAS15 in close encounters",
        2,
        "eps h^2 in heliocentric coordinates; within 3 Hill radii the force is handed over to IAS15 smoothly",
        "Rein et al. 2019, Mon. Not. R. Astron. Soc. 485, 5490-5497",
        kinds=KEPLERIAN,
        claims={"symplectic": True},
        options={"safe_mode": 0},
    ),
    _peer(
        "trace",
        "trace",
        "TRACE, Wisdom-Holman splitting, Bulirsch-Stoer in close encounters",
        2,
        "eps h^2 in heliocentric coordinates; steps with a close encounter or a pericentre that h does not resolve are "
        "Bulirsch-Stoer's; REBOUND calls it almost time-reversible",
        "Lu, Hernandez & Rein 2024, Mon. Not. R. Astron. Soc. 533, 3708",
        kinds=KEPLERIAN,
    ),
)

PEERS = (*ADAPTIVE, *WHFAST, *SABA, *LEAPFROG, *JANUS, *EOS, *HYBRID)
