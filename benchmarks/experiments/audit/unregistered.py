"""What a package has and the audit has not: integrators and options that can be imported and are no peer here.

The lists are made by looking into the installed packages, so that they grow with them.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable

from phasebench.benchmarks.rows.cells import Cell, Rows, content
from phasebench.reference.peers import PACKAGES
from phasebench.reference.tables import version_of

#: REBOUND's integrators that are none of Hamiltonian systems in general: the shearing sheet's, and that of no motion.
OTHERWISE = {"sei": "of the shearing sheet alone", "none": "it moves nothing"}
#: Options of REBOUND that name a method rather than a detail, and the values of those whose documentation lists none.
METHODS = ("corrector", "corrector2", "kernel", "coordinates", "type", "phi0", "phi1", "adaptive_mode", "peri_mode")
FLAGS = {
    ("whfast", "corrector"): ("3", "5", "7", "11", "17"),
    ("whfast", "corrector2"): ("1",),
    ("whfast512", "corrector"): ("17",),
}


def _classes(namespace, base, without: Iterable[str] = ()) -> set[str]:
    """The names of the subclasses of ``base`` in a namespace that are not abstract."""
    found = {n for n, c in vars(namespace).items() if inspect.isclass(c) and issubclass(c, base) and c is not base}
    return {n for n in found if not inspect.isabstract(getattr(namespace, n))} - set(without)


def _peers(package: str):
    return next(m for m in PACKAGES if m.PEERS[0].package == package).PEERS


def _named(package: str, names: Iterable[str], of=lambda peer: peer.claims.source) -> list[str]:
    """Those of the names that no peer's source of its claims (or what ``of`` says) has as a word."""
    said = {word for p in _peers(package) for word in re.findall(r"\w+", of(p))}
    return sorted(n for n in names if n not in said)


def _scipy() -> list[str]:
    import scipy.integrate

    return _named("scipy", _classes(scipy.integrate, scipy.integrate.OdeSolver))


def _gala() -> list[str]:
    import gala.integrate
    from gala.integrate.core import Integrator

    return _named("gala", _classes(gala.integrate, Integrator))


def _galpy() -> list[str]:
    from phasebench.reference.peers.galpy import load

    listed = re.findall(r"-\s+'(\w+)' for", load().orbit.Orbit.integrate.__doc__)
    ids = {p.id for p in _peers("galpy")}
    return [n for n in listed if f"galpy-{n.replace('_', '-')}" not in ids]


def _desolver() -> list[str]:
    from phasebench.reference.peers.desolver import load

    integrators = load().integrators
    found = {n for n, c in vars(integrators).items() if inspect.isclass(c) and getattr(c, "__order__", None)}
    return _named("desolver", found)


def _pyhamsys() -> list[str]:
    from pyhamsys import METHODS as known

    return _named("pyhamsys", (m for m in known if "#" not in m), lambda peer: peer.name)


def _diffrax() -> list[str]:
    import diffrax as package

    stochastic = (package.AbstractItoSolver, package.AbstractStratonovichSolver, package.AbstractSRK)
    stochastic = (*stochastic, package.AbstractFosterLangevinSRK)
    found = {n for n in _classes(package, package.AbstractSolver) if "Abstract" not in n}
    found = {n for n in found if not issubclass(getattr(package, n), stochastic)}
    return [f"{n} (adds an error estimate to another)" if n == "HalfSolver" else n for n in _named("diffrax", found)]


def _heyoka() -> list[str]:
    import heyoka as hy

    kinds = sorted(n for n in dir(hy) if re.fullmatch(r"taylor_adaptive_\w+", n))
    return [n for n in kinds if n not in ("taylor_adaptive_dbl", "taylor_adaptive_batch", "taylor_adaptive_batch_dbl")]


def _rebound() -> list[str]:
    """Its integrators, and the values of the options that name methods, that no peer sets."""
    import rebound as package

    from phasebench.reference.peers.rebound import PEERS

    used = {(p.settings["integrator"], k, str(v).upper()) for p in PEERS for k, v in p.settings.items()}
    sim, out = package.Simulation(), []
    for name in _rebounds():
        try:
            sim.integrator = name
        except RuntimeError:  # a name of something else
            continue
        if name not in {i for i, _, _ in used}:
            out.append(f"{name} ({OTHERWISE[name]})" if name in OTHERWISE else name)
            continue
        for option, values in _options(name, sim.integrator).items():
            left = [v for v in values if (name, option, v) not in used]
            if left:
                out.append(f"{name} {option} {', '.join(left)}")
    return out


def _rebounds() -> list[str]:
    """The integrators that REBOUND's library has, by the names of their structures in it."""
    import rebound as package

    with open(package.__libpath__, "rb") as library:
        found = re.findall(rb"\0reb_integrator_([a-z0-9]+)(?=\0)", library.read())
    return sorted({n.decode() for n in found})


def _options(name: str, integrator) -> dict[str, list[str]]:
    """option -> its values besides the default, of those of `METHODS`, as an integrator's documentation has them."""
    out = {}
    for part in re.split(r"\n(?=\w+ : c_)", integrator.__doc__.partition("Attributes")[2]):
        option, _, text = part.strip("-\n ").partition(" : ")
        values = re.findall(r"^\s+(\d+) = '(\w+)'", text, re.MULTILINE)
        if option in METHODS and values:
            default = str(getattr(integrator, option)).upper()
            out[option] = [value for number, value in values if default not in (number, value) and value != "DEFAULT"]
        elif (name, option) in FLAGS:
            out[option] = list(FLAGS[name, option])
    return out


LOOKS: dict[str, Callable[[], list[str]]] = {
    f.__name__.removeprefix("_"): f for f in (_heyoka, _rebound, _scipy, _gala, _galpy, _desolver, _pyhamsys, _diffrax)
}


def measured(package: str) -> Rows:
    """What a package has and the audit has not: a row each; one row without a name where there is nothing."""
    about = {"package": package, "version": version_of(package) or "absent"}
    try:
        names, reason = LOOKS[package](), ""
    except ImportError as error:
        names, reason = [], f"{package} cannot be imported ({error})"
    return {"audit_unregistered": [about | {"name": n, "reason": reason} for n in names or [""]]}


def cells() -> list[Cell]:
    """A cell for each package."""
    return [_cell(p) for p in LOOKS]


def _cell(package: str) -> Cell:
    peers = [p for m in PACKAGES for p in m.PEERS if p.package == package]
    return Cell(
        "audit",
        ("audit_unregistered",),
        {"package": package},
        measured,
        (package,),
        content("audit_unregistered", version_of(package) or "absent", *[p.id for p in peers], code=[__name__]),
        frozenset({package}),
    )
