"""List the integrators and options that the packages offer and the audit does not cover.

The lists are made by inspecting the installed packages, so that they grow with them.
"""

from __future__ import annotations

import inspect
import re
import subprocess
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks.store.cells import Cell, Package, Rows, content
from phasebench.reference.installed import version_of
from phasebench.reference.native import LIBRARIES, compiler, load_library
from phasebench.reference.peers import PACKAGES

if TYPE_CHECKING:
    from types import ModuleType

    from phasebench.reference.peers import Peer

#: REBOUND's integrators that are not for general Hamiltonian systems, with the reason.
OTHERWISE = {"sei": "of the shearing sheet alone", "none": "it moves nothing"}
#: Options of REBOUND that select a method, and the values of those whose documentation does not list them.
METHODS = ("corrector", "corrector2", "kernel", "coordinates", "type", "phi0", "phi1", "adaptive_mode", "peri_mode")
FLAGS = {
    ("whfast", "corrector"): ("3", "5", "7", "11", "17"),
    ("whfast", "corrector2"): ("1",),
    ("whfast512", "corrector"): ("17",),
}

#: A header of Boost.odeint's steppers that defines no integrator of its own, and what ends a simulation of JAX-MD.
PART = re.compile("base|categories|controlled|controller|dense_out|generation|generic|result|extrapolation")
PAIR = re.compile(r"return init_fn, (step|apply|block)_fn\s*$")


def _classes(namespace: ModuleType, base: type, without: Iterable[str] = ()) -> set[str]:
    """Return the names of the concrete subclasses of ``base`` in a namespace, except those in ``without``."""
    found = {n for n, c in vars(namespace).items() if inspect.isclass(c) and issubclass(c, base) and c is not base}
    return {n for n in found if not inspect.isabstract(getattr(namespace, n))} - set(without)


def _peers(package: str) -> tuple[Peer, ...]:
    """The registered peers (integrators of other packages) that belong to ``package``."""
    return next(m for m in PACKAGES if m.PEERS[0].package == package).PEERS


def _missing_names(
    package: str, names: Iterable[str], of: Callable[[Peer], str] = lambda peer: peer.claims.source
) -> list[str]:
    """Return the names that no registered peer of a package uses, sorted.

    A peer is an integrator of another package.  A name counts as used if it is a word of ``of(peer)``, by default the
    source of the peer's claims, for any peer of the package.
    """
    said = {word for p in _peers(package) for word in re.findall(r"\w+", of(p))}
    return sorted(n for n in names if n not in said)


def _scipy() -> list[str]:
    """List SciPy's solvers that no audited integrator uses."""
    import scipy.integrate

    return _missing_names("scipy", _classes(scipy.integrate, scipy.integrate.OdeSolver))


def _gala() -> list[str]:
    """List gala's integrators that no audited integrator uses."""
    import gala.integrate
    from gala.integrate.core import Integrator

    return _missing_names("gala", _classes(gala.integrate, Integrator))


def _galpy() -> list[str]:
    """List galpy's integrators that no audited integrator uses."""
    from phasebench.reference.peers.galpy import load

    listed = re.findall(r"-\s+'(\w+)' for", load().orbit.Orbit.integrate.__doc__)
    ids = {p.id for p in _peers("galpy")}
    return [n for n in listed if f"galpy-{n.replace('_', '-')}" not in ids]


def _desolver() -> list[str]:
    """List desolver's integrators that no audited integrator uses."""
    from phasebench.reference.peers.desolver import load

    integrators = load().integrators
    found = {n for n, c in vars(integrators).items() if inspect.isclass(c) and getattr(c, "__order__", None)}
    return _missing_names("desolver", found)


def _pyhamsys() -> list[str]:
    """List pyhamsys's methods that no audited integrator uses."""
    from pyhamsys import METHODS as known

    return _missing_names("pyhamsys", (m for m in known if "#" not in m), lambda peer: peer.name)


def _pynamicalsys() -> list[str]:
    """List pynamicalsys's integrators of Hamiltonian systems that no audited integrator uses."""
    from pynamicalsys import HamiltonianSystem

    return _missing_names(
        "pynamicalsys", HamiltonianSystem.available_integrators(), lambda peer: peer.settings["integrator"]
    )


def _blackjax() -> list[str]:
    """List BlackJAX's integrators that no audited integrator uses."""
    from blackjax.mcmc import integrators

    names = (n for n in integrators.__all__ if "isokinetic" not in n)
    return [
        *_missing_names("blackjax", names),
        *(f"{n} (its flow is not Hamiltonian)" for n in integrators.__all__ if "isokinetic" in n),
    ]


def _openmm() -> list[str]:
    """List OpenMM's integrators that are not audited: they have heat baths or combine other integrators."""
    import openmm

    from phasebench.reference.peers.openmm import CUSTOM, VARIABLE, VERLET

    found = {n for n in _classes(openmm, openmm.Integrator) if n not in (VERLET, VARIABLE, CUSTOM, "Integrator")}
    return sorted(found)


def _preprocessed(package: str, header: str) -> str:
    """Return the preprocessor's output for a header of a library, with the path of each file that it includes."""
    load_library(package)
    command = [compiler(LIBRARIES[package].language), "-E", "-x", LIBRARIES[package].language.lower(), "-"]
    return subprocess.run(command, input=f"#include <{header}>\n", capture_output=True, text=True, check=True).stdout


def _boost() -> list[str]:
    """List Boost.odeint's steppers that no audited integrator uses, by the names of their headers.

    Steppers that only wrap another one, to control its steps or for dense output, are left out.
    """
    text = _preprocessed("boost", "boost/numeric/odeint/stepper/euler.hpp")
    folder = Path(re.search(r'"(\S*/odeint/stepper/)euler.hpp"', text)[1])
    used = tuple(p.id.removeprefix("boost-").removesuffix("-adaptive").replace("-", "_") for p in _peers("boost"))
    used = (*used, "runge_kutta4")  # of boost-rk4
    found = (f.stem for f in folder.glob("*.hpp") if not PART.search(f.stem))
    return sorted(n for n in found if not n.endswith(used))


def _gsl() -> list[str]:
    """List GSL's steppers that no audited integrator uses."""
    text = _preprocessed("gsl", "gsl/gsl_odeiv2.h")
    found = set(re.findall(r"gsl_odeiv2_step_type\s*\*\s*gsl_odeiv2_step_(\w+);", text))
    return sorted(found - {p.id.removeprefix("gsl-").removesuffix("-adaptive") for p in _peers("gsl")})


def _ase() -> list[str]:
    """List ASE's integrators of molecular dynamics that are not audited: they have heat baths or barostats."""
    import ase.md
    from ase.md.md import MolecularDynamics

    modules = [import_module(f"ase.md.{m.name}") for m in iter_modules(ase.md.__path__)]
    base = ("MolecularDynamics", "VelocityVerlet")
    return sorted({n for m in modules for n in _classes(m, MolecularDynamics, base)})


def _jax_md() -> list[str]:
    """List JAX-MD's kinds of simulation that are not audited: they have heat baths or barostats."""
    from jax_md import simulate

    found = (n for n, f in vars(simulate).items() if inspect.isfunction(f) and PAIR.search(inspect.getsource(f)))
    return sorted(n for n in found if n != "nve")


def _mujoco() -> list[str]:
    """List MuJoCo's integrators that no audited integrator uses."""
    from mujoco import mjtIntegrator

    names = {n.removeprefix("mjINT_").lower() for n in mjtIntegrator.__members__}
    return sorted(names - {p.id.removeprefix("mujoco-") for p in _peers("mujoco")})


def _diffrax() -> list[str]:
    """List diffrax's deterministic solvers that no audited integrator uses."""
    import diffrax as package

    stochastic = (package.AbstractItoSolver, package.AbstractStratonovichSolver, package.AbstractSRK)
    stochastic = (*stochastic, package.AbstractFosterLangevinSRK)
    found = {n for n in _classes(package, package.AbstractSolver) if "Abstract" not in n}
    found = {n for n in found if not issubclass(getattr(package, n), stochastic)}
    return [
        f"{n} (adds an error estimate to another)" if n == "HalfSolver" else n for n in _missing_names("diffrax", found)
    ]


def _sundials4py() -> list[str]:
    """List the symplectic methods of SUNDIALS's SPRKStep that no audited integrator uses.

    The other integrators of SUNDIALS claim no structure.
    """
    from phasebench.reference.peers.sundials4py import load

    found = [n for n in dir(load().arkode) if re.fullmatch(r"ARKODE_SPRK_\w+_\d+_\d+", n)]
    return _missing_names("sundials4py", found, lambda peer: peer.name)


def _heyoka() -> list[str]:
    """List heyoka's integrators in precisions other than double."""
    import heyoka as hy

    kinds = sorted(n for n in dir(hy) if re.fullmatch(r"taylor_adaptive_\w+", n))
    return [n for n in kinds if n not in ("taylor_adaptive_dbl", "taylor_adaptive_batch", "taylor_adaptive_batch_dbl")]


def _rebound() -> list[str]:
    """List what no audited integrator uses: integrators of REBOUND, and values of its options that select a method."""
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
    """List the names of the integrators in REBOUND's library, found by the names of their structures in the binary."""
    import rebound as package

    with open(package.__libpath__, "rb") as library:
        found = re.findall(rb"\0reb_integrator_([a-z0-9]+)(?=\0)", library.read())
    return sorted({n.decode() for n in found})


def _options(name: str, integrator: Any) -> dict[str, list[str]]:
    """Find options that select a method in an integrator's documentation: option -> values other than the default.

    ``integrator`` is an object of REBOUND, ``name`` its name there.
    """
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
    f.__name__.removeprefix("_"): f
    for f in (
        _heyoka,
        _rebound,
        _scipy,
        _gala,
        _galpy,
        _desolver,
        _pyhamsys,
        _diffrax,
        _sundials4py,
        _pynamicalsys,
        _blackjax,
        _openmm,
        _mujoco,
        _boost,
        _gsl,
        _ase,
        _jax_md,
    )
}


def measure_rows(package: str) -> Rows:
    """List the integrators and options of a package that the audit leaves out: a row for each, by table name.

    If there is none, a single row has an empty name.
    """
    about = {"package": package, "version": version_of(package) or "absent"}
    try:
        names, reason = LOOKS[package](), ""
    except ImportError as error:
        names, reason = [], f"{package} cannot be imported ({error})"
    return {"audit_unregistered": [about | {"name": n, "reason": reason} for n in names or [""]]}


def cells() -> list[Cell]:
    """List the measurements (`Cell`), one for each package."""
    return [_cell(p) for p in LOOKS]


def _cell(package: str) -> Cell:
    peers = [p for m in PACKAGES for p in m.PEERS if p.package == package]
    return Cell(
        "audit",
        ("audit_unregistered",),
        {"package": package},
        measure_rows,
        (package,),
        content("audit_unregistered", Package(package), *[p.id for p in peers], code=[__name__]),
        frozenset({package}),
    )
