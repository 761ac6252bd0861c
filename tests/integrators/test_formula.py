"""Formulas: a text is never evaluated as Python, unusable ones are refused, generated functions keep all digits."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import mpmath
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.compile import codegen, printing
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.formula import FUNCTIONS, TERMS, names, parse

ROOT = Path(__file__).resolve().parents[2]
Q, P = sp.symbols("q p", real=True)
VARIABLES = {"q": Q, "p": P}

#: Python expressions, those first that would act or reveal something if evaluated; and texts without a meaning.
PYTHON = """\
__import__('os').system('touch X')
__import__(chr(111)+chr(115)).system(chr(97))
(lambda:0)()
q.__class__.__mro__[1].__subclasses__()
f'{open(1)}'
q[0]
sin(x=q)
sin(q, p)
q if p else q
q < p
q, p
q # p
q__
oo
q = p
sin()
~q
(2**100)**100
q**p
q/0
log(0)""".splitlines()
#: Texts with misleading numbers and letters, and what the error message names.
NUMBERS = [
    ("1_000", "1_000"),
    ("0x10", "0x10"),
    ("2q", "2q"),
    ("010*q", "leading zeros"),
    ("1" * 31, "30 digits"),
    ("1e999", "too large"),
    ("0.1**30*q", "bits"),
    ("\uff51", r"\uff51"),  # a full-width q, which Python reads as q
    ("\u0440**2", r"\u0440"),  # a Cyrillic r
    ("q\u200b", r"\u200b"),
    ("q^2", "**"),
    ("q(p + 1)", "*"),
    ("sin", "function"),
    ("", "empty"),
    ("x + q", "'x'"),
]
#: Formulas on which SymPy would work for hours or exhaust the memory.
LARGE = [
    "9**9**9**9",
    "((1e-300*q)**100)**100",
    "q**100*q**100",
    "10**-99999",
    "exp(99999999999*log(q))",
    "exp(q + 99999999999*log(3))",
    "sin(exp(exp(exp(9))))",
    "q**0.123456789",
    "q**(1/999)*p**(1/998)*q**(1/997)",
    "(q + p + 1)**100",
    "*".join(["(q + p)"] * 90) + "*(q**2 + p**3 + 1)**40",
    "((q + p)**30 + sin(q))**30",
    "tan(asin(" * 12 + "q" + "))" * 12,
    "sin(" * 3000 + "q" + ")" * 3000,
    "q+" * 5000 + "q",
]


def shorter(text):
    """A formula's text, shortened for use as the id of a test."""
    return ascii(text)[:40] if isinstance(text, str) else ""


@pytest.mark.timeout(20)
@pytest.mark.parametrize("text", [*PYTHON, *LARGE], ids=shorter)
def test_an_unusable_text_is_refused_at_once(text):
    with pytest.raises(InvalidInput) as caught:
        parse(text, VARIABLES)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(("text", "named"), NUMBERS, ids=shorter)
def test_misleading_numbers_and_letters_are_named(text, named):
    with pytest.raises(InvalidInput) as caught:
        parse(text, VARIABLES)
    assert named in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("(q + p + 1)**90", marks=pytest.mark.lowest),
        "p**2/2 + " + "sin(" * 24 + "q" + ")" * 24,
        pytest.param("p**2/2 + " + "q/(1 + " * 24 + "q" + ")" * 24, marks=pytest.mark.lowest),
        "+".join(f"cos({n}*q)" for n in range(300)),
    ],
    ids=shorter,
)
@pytest.mark.timeout(60)
def test_the_largest_formulas_can_be_used(text):
    system = Hamiltonian(q="q", p="p", H=text)
    assert system.traits["canonical"]
    assert system.hessian().shape == (2, 2)


#: Script that records the interpreter's audit events while texts are read, except those of SymPy's first use.
AUDITED = """
import json, sys
import sympy as sp
from phasebench.integrators.systems import formula
from phasebench.integrators.errors import InvalidInput

texts = json.loads(sys.stdin.read())
read = {read}
variables = {{"q": sp.Symbol("q", real=True), "p": sp.Symbol("p", real=True)}}
warm = ["exp(q) + abs(p)**1.5 - tan(pi/7)*log(q)/3", "asin(2)", "q.real", "q or p", "8**9**9"]
events, seen = [], False

def hook(event, arguments):
    if seen:
        source = arguments[0] if event == "compile" else None
        if isinstance(source, bytes):
            source = source.decode()
        events.append([event, source if isinstance(source, str) else repr(arguments)[:80]])

sys.addaudithook(hook)
for text in [*warm, *texts]:
    try:
        seen = text not in warm
        formula.parse(text, variables) if text in warm else read(text)
        ended = "read"
    except InvalidInput:
        ended = "refused"
    except BaseException as error:
        ended = type(error).__name__
    finally:
        seen = False
    if text not in warm:
        events.append(["end", ended])
print("\\n" + json.dumps(events))
"""


def audit_events(texts, read, folder):
    """Audit events while ``read`` reads texts in a fresh process; for each text the last is "end" with its outcome."""
    environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
    command = [sys.executable, "-c", AUDITED.format(read=read)]
    done = subprocess.run(
        command, cwd=folder, env=environment, input=json.dumps(texts), capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.lowest
def test_nothing_is_evaluated(tmp_path):
    """The only event is the compilation of the text to a syntax tree: no import, no file, no exec."""
    texts = [*PYTHON, *(t for t, _ in NUMBERS), *LARGE]
    events = audit_events(texts, "lambda text: formula.parse(text, variables)", tmp_path)
    assert [e for event, e in events if event == "end"] == ["refused"] * len(texts)
    assert {event for event, _ in events} <= {"end", "compile"}
    assert {source for event, source in events if event == "compile"} <= {" ".join(t.split()) for t in texts}
    assert not list(tmp_path.iterdir())


def test_control_an_evaluation_is_seen(tmp_path):
    texts = ["__import__('os').system('touch X')", "open('/etc/passwd')", "__import__('no_module')", "(lambda:0)()"]
    assert {"os.system", "open", "import", "exec"} <= {e for e, _ in audit_events(texts, "eval", tmp_path)}


PIECES = ["q", "p", "1", "2", "0.5", "1e9", "pi", "e", "x", "(", ")", "+", "-", "*", "/", "**", " ", ",", ".", "_", "^"]
PIECES += [f"{name}(" for name in FUNCTIONS]
APPLIED = tuple(f for f in (getattr(sp, name) for name in FUNCTIONS.values()) if isinstance(f, type))


def is_allowed(e):
    """Whether an expression contains only the variables, real numbers and the allowed functions."""
    real = not e.has(sp.I, sp.nan, sp.zoo, sp.oo, -sp.oo)
    return e.free_symbols <= {Q, P} and real and all(isinstance(f, APPLIED) for f in e.atoms(sp.Function))


@settings(max_examples=300, deadline=None)
@given(st.one_of(st.text(max_size=30), st.lists(st.sampled_from(PIECES), max_size=14).map("".join)))
def test_any_text_is_read_or_refused(text):
    try:
        found = parse(text, VARIABLES)
    except InvalidInput:
        return
    assert is_allowed(found)
    assert set(names(text)) <= {"q", "p", "pi", "e"}


def test_control_a_foreign_expression_is_seen():
    assert not any(map(is_allowed, (sp.Symbol("z") + Q, sp.gamma(Q), sp.I * Q)))


TENTH = sp.Rational(1, 10)
MEANINGS = [
    ("q**0.1", Q**TENTH),
    ("(354294*q)**0.1", 3 * 6**TENTH * Q**TENTH),
    ("exp(0.5*log(q))", sp.sqrt(Q)),
    ("exp(2*ln(q) + p)", Q**2 * sp.exp(P)),
    ("e**(q*p)*pi", sp.exp(Q * P) * sp.pi),
    ("-q**2 - -q", -(Q**2) + Q),
    ("q - p - 1 + 2", Q - P + 1),
    ("q/p/2*3", 3 * Q / (2 * P)),
    ("1.*q + .5*p + 1e2", Q + P / 2 + 100),
    ("0.1*k", sp.Rational(0.1) * 3),
    ("q**k", Q**3),
    ("  q +\n abs(p)", Q + sp.Abs(P)),
    ("+".join(f"{n}*q" for n in range(300)), 44850 * Q),
    ("*".join(["q"] * 90) + "/q/q", Q**88),
]


@pytest.mark.parametrize(("text", "expression"), MEANINGS, ids=shorter)
def test_a_text_is_read_as_its_expression(text, expression):
    assert parse(text, VARIABLES | {"k": sp.Integer(3)}) == expression


def test_names_found_in_a_text():
    assert names("p1**2/2 - k*cos(q1) + e") == ["e", "k", "p1", "q1"]
    assert parse("e", {"e": Q}) == Q, "a variable hides a constant of the same name"


def test_the_limit_on_terms():
    assert parse("(q + p + 1)**98", VARIABLES) == (Q + P + 1) ** 98  # 99 * 100 / 2 = 4950 terms
    assert TERMS == 5000
    with pytest.raises(InvalidInput, match="5000 terms"):
        parse("(q + p + 1)**99", VARIABLES)


def test_a_fraction_of_huge_numbers_can_be_used():
    """(the double 0.1)**30 is a fraction whose numerator and denominator exceed a double's range."""
    tiny = Hamiltonian(q=[Q], p=[P], H=P**2 / 2 + sp.Rational(0.1) ** 30 * 10**30 * Q**2 / 2)
    unit = Hamiltonian(q=[Q], p=[P], H=P**2 / 2 + Q**2 / 2)
    ends = [integrate(s, "rk4", h=0.1, steps=10, q0=[0.5], p0=[0.1]).q[-1] for s in (tiny, unit)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-14)


# -- numbers and generated functions of many digits --------------------------------------------------------------------


DIGITS = 40


def many(x) -> Fraction:
    """A multiprecision number as a fraction."""
    return Fraction(*map(int, x.as_integer_ratio()))


@given(st.fractions(), st.integers(-200, 200))
def test_fractions_are_rounded_as_by_mpmath(x, shift):
    x *= Fraction(2) ** shift
    with precision(DIGITS):
        other = mpmath.mpf(x.numerator) / x.denominator
        assert many(to_number(x, MULTIPRECISION)) == Fraction(*map(int, mpmath.libmp.to_rational(other._mpf_)))
        assert to_number(other, MULTIPRECISION) == to_number(x, MULTIPRECISION)


def test_text_and_constants_have_all_digits():
    with precision(DIGITS):
        assert abs(to_number("0.1", MULTIPRECISION) - to_number(Fraction(1, 10), MULTIPRECISION)) < 1e-40
        assert to_number(0.1, MULTIPRECISION) != to_number("0.1", MULTIPRECISION), "the control: the double is another"
        assert mpmath.mpf(str(to_number(mpmath.mp.pi, MULTIPRECISION))) == +mpmath.mp.pi


def test_precision_set_in_mpmath_only_is_refused():
    with mpmath.workdps(DIGITS), pytest.raises(InvalidInput, match="precision"):
        codegen.vector([1])
    with precision(DIGITS):
        assert codegen.vector([1]) == [1]


x, y = sp.symbols("x y", positive=True)
EXPRESSIONS = [
    sp.sqrt(x + y) * sp.pi,
    (x + 2 * y) ** sp.Rational(-3, 2),
    (x + y) ** sp.Rational(1, 3) + x**15,
    (x + y) ** sp.Rational(-1, 3) - x**-3 * y**2,
    (x + y) ** (x * y),
    sp.sin(x) * sp.cos(y) + sp.tan(x) - sp.exp(-y) + sp.log(x + y),
    sp.sinh(x) * sp.cosh(y) / sp.tanh(x) + sp.E,
    sp.asin(x / 2) + sp.acos(y / 3) - sp.atan(x * y) + abs(x - y),
    x / 3 - sp.Rational(2, 7) * y + sp.Rational(0.1),
]


#: Import of functions for lanes in place of the library's; their arguments select the arithmetic.
OF_LANES = "from phasebench.integrators.values.elementary import cos, cosh, exp, sin, sinh, sqrt, tanh\n"


@pytest.mark.parametrize("header", ["", OF_LANES], ids=["alone", "in-lanes"])
@pytest.mark.parametrize("expression", [*EXPRESSIONS, sp.sqrt(2) * x + sp.exp(3) * sp.sin(2) / y], ids=str)
def test_generated_functions_keep_all_digits(expression, header):
    def build(arithmetic):
        return header + printing.source("f", [("q", [x]), ("p", [y])], [expression], arithmetic)

    f = codegen.function(header + str(expression), build, None, MULTIPRECISION)
    with precision(DIGITS):
        value = f(codegen.vector([Fraction(2, 3)]), codegen.vector([Fraction(5, 7)]))
        expected = sp.N(expression.subs({x: sp.Rational(2, 3), y: sp.Rational(5, 7)}), DIGITS + 10)
        error = abs(value - to_number(mpmath.mpf(str(expected)), MULTIPRECISION))
    assert error < 1e-37
    assert abs(float(value) - value) > 1e-20, "the control: a double has not these digits"


def test_unknown_and_doubled_symbols_are_reported():
    for arguments, words in (([], r"neither coordinates nor momenta.*z"), ([("t", x)], "have the same symbol")):
        with pytest.raises(ValueError, match=words):
            printing.source("f", [("q", [x]), *arguments], [[x * sp.Symbol("z")]], DOUBLE)


@pytest.mark.parametrize("n", [2, 7, 37, 48, 49, -1, -2, -13, -49])
def test_integer_powers_up_to_a_bound_are_products(n):
    """Products round in the same way everywhere; higher powers use the library."""
    text = printing.source("f", [("q", [x])], [x**n], DOUBLE)
    assert ("**" in text) == (abs(n) > codegen.MAX_POWER)
    namespace = {"number": float}
    exec(text, namespace)
    assert namespace["f"]((2.0,)) == 2.0**n


def test_numbers_in_formulas_are_rounded_once():
    numbers = [sp.Rational(0.1), sp.Rational(1, 3), sp.pi, sp.Integer(2) ** 70, sp.Rational(3**50, 7**40)]
    text = printing.source("f", [("q", [x])], [[n * x for n in numbers]], DOUBLE)
    assert str(2**70) not in text, "integers beyond Numba's are doubles"
    namespace = {"value": tuple, "number": float}
    exec(text, namespace)
    wanted = [0.1, 1 / 3, math.pi, 2.0**70, 3**50 / 7**40]
    assert list(namespace["f"]((2.0,))) == [2 * n for n in wanted]
