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
from types import ModuleType
from typing import Any

from phasebench.reference.installed import version_of
from phasebench.reference.native import LIBRARIES, compiler, load_library
from phasebench.reference.peers import PACKAGES, Peer

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
    """The names of the concrete subclasses of ``base`` in a namespace, except those in ``without``."""
    found = {n for n, c in vars(namespace).items() if inspect.isclass(c) and issubclass(c, base) and c is not base}
    return {n for n in found if not inspect.isabstract(getattr(namespace, n))} - set(without)


def _peers(package: str) -> tuple[Peer, ...]:
    return next(m for m in PACKAGES if m.PEERS[0].package == package).PEERS


def _ids(package: str) -> set[str]:
    """The ids of a package's peers, without the package and "-adaptive"."""
    return {p.id.removeprefix(f"{package}-").removesuffix("-adaptive") for p in _peers(package)}


def _unused(
    package: str, names: Iterable[str], of: Callable[[Peer], str] = lambda peer: peer.claims.source
) -> list[str]:
    """The names that are no word of ``of(peer)``, by default the source of its claims, for any peer of a package."""
    said = {word for p in _peers(package) for word in re.findall(r"\w+", of(p))}
    return sorted(n for n in names if n not in said)


def _scipy() -> list[str]:
    import scipy.integrate

    return _unused("scipy", _classes(scipy.integrate, scipy.integrate.OdeSolver))


def _gala() -> list[str]:
    import gala.integrate
    from gala.integrate.core import Integrator

    return _unused("gala", _classes(gala.integrate, Integrator))


def _galpy() -> list[str]:
    from phasebench.reference.peers.galpy import load

    listed = re.findall(r"-\s+'(\w+)' for", load().orbit.Orbit.integrate.__doc__)
    return [n for n in listed if n.replace("_", "-") not in {p.id.removeprefix("galpy-") for p in _peers("galpy")}]


def _desolver() -> list[str]:
    from phasebench.reference.peers.desolver import load

    classes = {n: c for n, c in vars(load().integrators).items() if inspect.isclass(c)}
    return _unused("desolver", (n for n, c in classes.items() if getattr(c, "__order__", None)))


def _pyhamsys() -> list[str]:
    from pyhamsys import METHODS as known

    return _unused("pyhamsys", (m for m in known if "#" not in m), lambda peer: peer.name)


def _pynamicalsys() -> list[str]:
    from pynamicalsys import HamiltonianSystem

    known = HamiltonianSystem.available_integrators()
    return _unused("pynamicalsys", known, lambda peer: peer.settings["integrator"])


def _blackjax() -> list[str]:
    from blackjax.mcmc import integrators

    others = [n for n in integrators.__all__ if "isokinetic" in n]
    named = _unused("blackjax", (n for n in integrators.__all__ if n not in others))
    return [*named, *(f"{n} (its flow is not Hamiltonian)" for n in others)]


def _openmm() -> list[str]:
    """Those with heat baths, or that combine other integrators."""
    import openmm

    from phasebench.reference.peers.openmm import CUSTOM, VARIABLE, VERLET

    return sorted(_classes(openmm, openmm.Integrator, (VERLET, VARIABLE, CUSTOM, "Integrator")))


def _preprocessed(package: str, header: str) -> str:
    """The preprocessor's output for a header of a library, with the path of each file that it includes."""
    load_library(package)
    command = [compiler(LIBRARIES[package].language), "-E", "-x", LIBRARIES[package].language.lower(), "-"]
    return subprocess.run(command, input=f"#include <{header}>\n", capture_output=True, text=True, check=True).stdout


def _boost() -> list[str]:
    """Headers of steppers; those that only control another one's steps, or give dense output, are left out."""
    text = _preprocessed("boost", "boost/numeric/odeint/stepper/euler.hpp")
    folder = Path(re.search(r'"(\S*/odeint/stepper/)euler.hpp"', text)[1])
    used = (*(id.replace("-", "_") for id in _ids("boost")), "runge_kutta4")  # of boost-rk4
    return sorted(f.stem for f in folder.glob("*.hpp") if not PART.search(f.stem) and not f.stem.endswith(used))


def _gsl() -> list[str]:
    text = _preprocessed("gsl", "gsl/gsl_odeiv2.h")
    return sorted({*re.findall(r"gsl_odeiv2_step_type\s*\*\s*gsl_odeiv2_step_(\w+);", text)} - _ids("gsl"))


def _ase() -> list[str]:
    """Those of molecular dynamics with heat baths or barostats."""
    import ase.md
    from ase.md.md import MolecularDynamics

    modules = [import_module(f"ase.md.{m.name}") for m in iter_modules(ase.md.__path__)]
    base = ("MolecularDynamics", "VelocityVerlet")
    return sorted({n for m in modules for n in _classes(m, MolecularDynamics, base)})


def _jax_md() -> list[str]:
    """Kinds of simulation with heat baths or barostats."""
    from jax_md import simulate

    found = (n for n, f in vars(simulate).items() if inspect.isfunction(f) and PAIR.search(inspect.getsource(f)))
    return sorted(n for n in found if n != "nve")


def _mujoco() -> list[str]:
    from mujoco import mjtIntegrator

    return sorted({n.removeprefix("mjINT_").lower() for n in mjtIntegrator.__members__} - _ids("mujoco"))


def _diffrax() -> list[str]:
    """Deterministic solvers."""
    import diffrax as package

    stochastic = (package.AbstractItoSolver, package.AbstractStratonovichSolver, package.AbstractSRK)
    stochastic = (*stochastic, package.AbstractFosterLangevinSRK)
    found = {n for n in _classes(package, package.AbstractSolver) if "Abstract" not in n}
    named = _unused("diffrax", (n for n in found if not issubclass(getattr(package, n), stochastic)))
    return [f"{n} (adds an error estimate to another)" if n == "HalfSolver" else n for n in named]


def _sundials4py() -> list[str]:
    """Symplectic methods of SPRKStep; the other integrators claim no structure."""
    from phasebench.reference.peers.sundials4py import load

    found = [n for n in dir(load().arkode) if re.fullmatch(r"ARKODE_SPRK_\w+_\d+_\d+", n)]
    return _unused("sundials4py", found, lambda peer: peer.name)


def _heyoka() -> list[str]:
    """Those in precisions other than double."""
    import heyoka

    double = {f"taylor_adaptive_{kind}" for kind in ("dbl", "batch", "batch_dbl")}
    return sorted(n for n in dir(heyoka) if re.fullmatch(r"taylor_adaptive_\w+", n) and n not in double)


def _rebound() -> list[str]:
    """Integrators, by the names of their structures in the binary, and values of options that select a method."""
    import rebound as package

    used = {(p.settings["integrator"], k, str(v).upper()) for p in _peers("rebound") for k, v in p.settings.items()}
    names = re.findall(rb"\0reb_integrator_([a-z0-9]+)(?=\0)", Path(package.__libpath__).read_bytes())
    sim, out = package.Simulation(), []
    for name in sorted({n.decode() for n in names}):
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


def _options(name: str, integrator: Any) -> dict[str, list[str]]:
    """Options that select a method -> values other than the default, by the documentation of REBOUND's integrator."""
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


#: Package -> function that lists what no audited integrator uses.
LOOKS = {
    f.__name__.removeprefix("_"): f
    for f in (_heyoka, _rebound, _scipy, _gala, _galpy, _desolver, _pyhamsys, _diffrax, _sundials4py, _pynamicalsys,
              _blackjax, _openmm, _mujoco, _boost, _gsl, _ase, _jax_md)
}  # fmt: skip


def measure(package: str) -> list[dict]:
    """A row for each integrator and option that is left out; if there is none, a single row with an empty name."""
    about = {"package": package, "version": version_of(package) or "absent"}
    try:
        names, reason = LOOKS[package](), ""
    except ImportError as error:
        names, reason = [], f"{package} cannot be imported ({error})"
    return [about | {"name": n, "reason": reason} for n in names or [""]]
