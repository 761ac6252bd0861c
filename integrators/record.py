"""The record of a method: its coefficients, its family and its declared properties."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from numbers import Rational, Real
from typing import TYPE_CHECKING, Any

from .errors import InvalidInput

if TYPE_CHECKING:
    from .keywords import Value
    from .systems.hamiltonian import PartitionedSystem

#: How well an invariant is kept.
EXACT, ROUND_OFF, BOUNDED, DRIFT, NONE = "exact", "round-off", "bounded", "drift", "none"
#: What records of a kind declare, unless they say otherwise.
SYMPLECTIC = {"symmetric": True, "symplectic": True, "energy": BOUNDED, "quadratic": ROUND_OFF}
CONSERVING = {"symmetric": True, "symplectic": False, "energy": ROUND_OFF, "quadratic": BOUNDED}
DRIFTING = {"symmetric": False, "symplectic": False, "energy": DRIFT, "quadratic": DRIFT}


class Deferred:
    """The attribute `Method.data`: if it is given as a function without arguments, that is called at the first access.

    So the numbers of a table are computed for the methods that run, and not for all that are listed.
    """

    def __get__(self, method: Method | None, kind: type[Method]) -> tuple[Any, ...]:
        if method is None:
            return ()
        found = vars(method)["data"]
        if callable(found):
            found = vars(method)["data"] = found()
        return found

    def __set__(self, method: Method, data: tuple[Any, ...] | Callable[[], tuple[Any, ...]]) -> None:
        vars(method)["data"] = data


@dataclass(frozen=True, kw_only=True)
class Method:
    """An integration method: its coefficients, its family (the kind of its kernel), and its declared properties.

    Attributes
    ----------
    id, name : its kebab-case name and its full one
    family : the module, in `families`, of its kernel (the compiled loop over steps)
    data : the coefficients for the family's kernel, exact numbers; may be given as a function that returns them
    order : of consistency, for smooth systems that meet ``requires``
    symmetric : equal to its own adjoint
    symplectic : its step map is symplectic on canonical systems
    volume : its step map, which is not symplectic, conserves the volume of phase space; False if nothing is declared
    energy, quadratic : how the energy and invariants of the form q.D p of canonical systems are kept, one of
        `ROUND_OFF`, `BOUNDED`, `DRIFT`, or `NONE` if it is not conserved and no more is declared
    tangent : on systems with constraints, its momenta fulfil the hidden ones, the time derivatives of the constraints
    source, cite : author, year, equation; and the keys of the works in ``bibliography.bib``
    requires : traits, keys of `TRAITS`, that a system must have
    parameters : names and values of its parameters
    with_parameters : function of the parameters that returns the fields which depend on them; None without parameters
    earlier : the number of states besides the last one that a step uses (multistep methods); the first steps are then
        another method's.  If it is not 0, a step is no map of phase space, and ``symmetric`` refers to the recursion
    """

    id: str
    name: str
    family: str
    order: int
    symmetric: bool
    symplectic: bool
    energy: str
    quadratic: str
    source: str
    cite: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()
    volume: bool = False
    tangent: bool = True
    earlier: int = 0
    parameters: Mapping[str, Any] = field(default_factory=dict)
    data: Deferred = Deferred()
    with_parameters: Callable[..., dict[str, Any]] | None = None

    def __hash__(self) -> int:
        return hash(self.id)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"data": self.data}

    def __call__(self, **parameters: Value) -> Method:
        """Return this method with other values of its parameters; raises InvalidInput for an unknown parameter."""
        for name in parameters:
            if name not in self.parameters:
                has = f"has {', '.join(self.parameters)}" if self.parameters else "has none"
                raise InvalidInput(f"method '{self.id}' has no parameter '{name}'; it {has}")
        values = dict(self.parameters) | {k: _number(k, v, self.parameters[k]) for k, v in parameters.items()}
        if self.with_parameters is None:
            return self
        return replace(self, parameters=values, **self.with_parameters(**values))

    @property
    def label(self) -> str:
        """The id with the values of the parameters, as in ``scheme-i(lam=1/3)``."""
        if not self.parameters:
            return self.id
        return f"{self.id}({', '.join(f'{k}={v}' for k, v in self.parameters.items())})"

    @property
    def one_step(self) -> bool:
        """True if a step is a map of phase space, as of one-step methods; False for multistep methods."""
        return self.earlier == 0

    @property
    def keeps_volume(self) -> bool:
        """True if the step map is declared to conserve the volume of phase space, as a symplectic one does."""
        return self.symplectic or self.volume

    def lacks(self, system: Any) -> str | None:
        """The reason why the method cannot run on ``system``, or None if it can."""
        return lacks(self.id, self.requires, system)


#: What gives a system a trait that methods require: trait -> what its H is, or what declares it.
TRAITS = {
    "canonical": "the equations of motion come from an H(q, p)",
    "separable": "H = T(p) + V(q)",
    "quadratic kinetic energy": "H = T(p) + V(q) with T quadratic in p",
    "constant mass matrix": "H = p . M^-1 p / 2 + V(q) with a constant M",
    "polynomial degree": "H is a polynomial in q and p",
    "linear fast part": "H = |p|^2 / 2 + sum of w_i^2 q_i^2 / 2 + U(q), the w_i declared as frequencies=",
    "Kepler part": "bodies that orbit a central one, declared as kepler= or by a table of planets",
    "Poisson structure": "y' = B(y) grad H(y) with a structure matrix B(y), as lotka-volterra has",
    "further invariants": "invariants besides the energy, declared as invariants=",
    "singular distances": "distances that vanish where H is singular, in its formula or declared as singular=",
    "elementary derivatives": "few coordinates, and derivatives made of powers, sin, cos, exp, sinh, cosh and tanh",
    "magnetic": "H = |p - A(x)|^2 / (2 m) + phi(x) in 2 or 3 dimensions, curl A not zero",
    "rigid body": "a body about a fixed point, declared as a RigidBody",
    "parts": "H as a sum of parts with exact flows, declared as a SplitHamiltonian or by --part",
    "constrained": "constraints g(q) = 0, declared as a ConstrainedHamiltonian or by --constraint",
}


def lacks(id: str, requires: Iterable[str], system: PartitionedSystem) -> str | None:
    """The reason why a method with this id and these required traits cannot run on ``system``, or None if it can."""
    for trait in requires:
        if not system.traits[trait]:
            why = f"which this one lacks: {TRAITS[trait]}"
            return f"method '{id}' requires a system with the trait '{trait}', {why}"
    return None


def _number(name: str, value: Value, default: str | float | Fraction) -> str | float | Fraction:
    """The value of the parameter ``name`` as an exact number: an integer if its default is one, else a fraction.

    A double becomes the fraction that it is, a NumPy scalar the number that it holds.
    """
    try:
        if isinstance(default, str):
            return str(value)
        exact = _exact(value)
        if isinstance(default, int) and exact.denominator != 1:
            raise ValueError
        if isinstance(default, int):
            return int(exact)
        float(exact)  # raises where it is too large for a double
        double = isinstance(value, Real) and not isinstance(value, Rational) and exact.denominator > 1
        return float(value) if double and float(value) == exact else exact
    except (AttributeError, ValueError, TypeError, ZeroDivisionError, OverflowError):
        pass
    kind = "an integer" if isinstance(default, int) else "a finite number, such as 0.3 or 1/3"
    raise InvalidInput(f"the parameter {name} is {value!r}; it must be {kind}") from None


def _exact(value: Value) -> Fraction:
    """Convert a number, a NumPy scalar or a text such as "1/3" to a Fraction, exactly."""
    if isinstance(value, bool) or not isinstance(value, (str, Real)):
        raise TypeError
    if isinstance(value, str):
        return Fraction(value)
    if isinstance(value, Rational):
        return Fraction(int(value.numerator), int(value.denominator))
    return Fraction(*value.as_integer_ratio())
