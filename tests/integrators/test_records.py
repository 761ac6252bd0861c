"""Records of methods: declared properties against a list of the published ones, ids, requirements, citations."""

from __future__ import annotations

import re
from fractions import Fraction

import mpmath
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks import bibliography
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators.coefficients.table import value
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, NONE, ROUND_OFF
from phasebench.integrators.record import TRAITS as MEANINGS
from phasebench.integrators.records import (
    collocation,
    energy,
    parametric,
    projection,
    solvers,
    splittings,
)
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.reference.peers import PEERS

TRAITS = set(problem("pendulum").system.traits)

#: (symmetric, symplectic, energy, invariants q.D p) -> methods with order/n, where n is the number of stages, substeps
#: or values of a gradient's path of a step, or the nodes of its quadrature.
PUBLISHED = {
    (False, False, DRIFT, DRIFT): """
        explicit-euler 1/1, implicit-euler 1/1, rk4 4/4, radau-iia-2 3/2, radau-iia-3 5/3, dop853 8/12,
        extended-midpoint-4 4/7
    """,
    (False, True, BOUNDED, ROUND_OFF): """
        symplectic-euler-p 1/1, symplectic-euler-q 1/1, scheme-i 1/1, scheme-i-adjoint 1/1, scheme-ii 2/1,
        generating-function 3/1, mclachlan-atela-2 2/3, mclachlan-atela-3 3/5, ruth-3 3/5, mclachlan-atela-4
        4/4, mclachlan-atela-5 5/6, calvo-sanz-serna-4 4/5, wisdom-holman-corrector 2/1,
        blanes-p7-6 6/8, blanes-casas-murua-p11-6 6/12, blanes-casas-murua-p13-6 6/14,
        blanes-casas-murua-p13-8 8/14, blanes-casas-murua-p23-10 10/24, blanes-casas-ros-p2 4/2,
        blanes-casas-ros-p3 4/3, blanes-casas-ros-p4 6/5,
        abc-processed-6 6/22
    """,
    (True, True, BOUNDED, ROUND_OFF): """
        implicit-midpoint 2/1, stormer-verlet 2/2, stormer-verlet-dkd 2/2, scheme-iii 2/2, fcirk 16/8,
        abc-2 2/2, abc-4 4/12, abc-6 6/20, abc-yoshida-4 4/6,
        scheme-iii-yoshida-4 4/6, scheme-iii-yoshida-6 6/18, scheme-iii-suzuki-4 4/10, scheme-iii-suzuki-6
        6/50, blanes-moan-s6 4/12, blanes-moan-s10 6/20, mclachlan-s2 2/4, mclachlan-s4 4/8, mclachlan-s5
        4/10, pefrl 4/8, aba-864 4/14, aba-1064 4/16, saba-2 2/4, saba-3 2/6, saba-4 2/8, saba-5 2/10,
        saba-6 2/12, saba-7 2/14, saba-8 2/16, saba-9 2/18, saba-10 2/20, blanes-moan-srkn6b
        4/7, blanes-moan-srkn11b 6/12, blanes-moan-srkn14a 6/14, mclachlan-sb3a4 4/4, mclachlan-sb3a5 4/5,
        okunbor-skeel-6 6/7, blanes-casas-escorihuela-srkn17 8/17, yoshida-6a 6/14, kahan-li-6 6/18,
        suzuki-umeno-8 8/30, kahan-li-8 8/34, sofroniou-spaletta-6 6/26, sofroniou-spaletta-8 8/42,
        sofroniou-spaletta-10 10/70, hlw-10 10/66, forest-ruth 4/6, mclachlan-ss5 4/10, mclachlan-ss9 6/18,
        mclachlan-ss17 8/34, suzuki-4 4/10, yoshida-6b 6/14, yoshida-6c 6/14, yoshida-8a 8/30, yoshida-8b
        8/30, yoshida-8c 8/30, yoshida-8d 8/30, yoshida-8e 8/30, implicit-midpoint-yoshida-4 4/3,
        implicit-midpoint-suzuki-4 4/5, implicit-midpoint-yoshida-6a 6/7, implicit-midpoint-kahan-li-6 6/9,
        implicit-midpoint-sofroniou-spaletta-6 6/13, implicit-midpoint-kahan-li-8 8/17,
        implicit-midpoint-suzuki-umeno-8 8/15, implicit-midpoint-sofroniou-spaletta-8 8/21,
        implicit-midpoint-sofroniou-spaletta-10 10/35, implicit-midpoint-hlw-10 10/33, scheme-iii-yoshida-6a
        6/14, scheme-iii-kahan-li-6 6/18, scheme-iii-sofroniou-spaletta-6 6/26, scheme-iii-kahan-li-8 8/34,
        scheme-iii-suzuki-umeno-8 8/30, scheme-iii-sofroniou-spaletta-8 8/42, scheme-iii-sofroniou-spaletta-10
        10/70, scheme-iii-hlw-10 10/66, gauss-1 2/1, gauss-2 4/2, gauss-3 6/3, gauss-4 8/4, gauss-5 10/5,
        gauss-6 12/6, gauss-7 14/7, gauss-8 16/8, lobatto-iiia-iiib-2 2/2, lobatto-iiia-iiib-3 4/3,
        lobatto-iiia-iiib-4 6/4, variational-midpoint 2/1, variational-trapezoidal 2/2, variational-gauss-2
        4/2, variational-gauss-3 6/3, variational-lobatto-3 4/3, variational-lobatto-4 6/4, variational-2-3
        4/3, wisdom-holman 2/1, wisdom-holman-saba-2 2/2, wisdom-holman-saba-4 2/4, wisdom-holman-aba-8-6-4
        4/7, wisdom-holman-aba-10-6-4 4/8,
        blanes-casas-sanz-serna-2 2/4, blanes-casas-sanz-serna-3 2/6, blanes-casas-sanz-serna-4 2/8,
        predescu-3 2/6, omelyan-2 2/4, takahashi-imada 2/1, chin-4a 4/2, chin-4b 4/2, chin-4c 4/3,
        chin-4d 4/3, omelyan-4-2f2g-v 4/2, omelyan-4-3f3g-v 4/3, omelyan-4-3f2g-v 4/3,
        omelyan-4-3f1g-v 4/3, omelyan-4-3f3g-p 4/3, omelyan-4-3f2g-p 4/3, omelyan-4-3f1g-p 4/3,
        omelyan-4-4f2g-vg 4/4, omelyan-4-4f2g-v 4/4, omelyan-4-5f2g-v 4/5, omelyan-4-5f2g-p 4/5,
        omelyan-4-5f1g-v 4/5, omelyan-4-5f1g-p 4/5, omelyan-6-4f3g-v 6/4, omelyan-6-5f5g-v 6/5,
        omelyan-6-5f4g-v 6/5, omelyan-6-5f5g-p 6/5, omelyan-6-5f3g-p 6/5, sabac-2 4/3, sabac-3 4/4,
        sabac-4 4/5, sbabc-2 4/2,
        jayawardana-ohsawa-2 2, jayawardana-ohsawa-4 4,
        kahan-li-6b 6/18, kahan-li-8b 8/34, kahan-li-10-31 10/62, kahan-li-10-33 10/66,
        sofroniou-spaletta-6-11 6/22, sofroniou-spaletta-8-19 8/38, sofroniou-spaletta-10-31 10/62,
        sofroniou-spaletta-10-33 10/66, tsitouras-10 10/66, efrl 4/8, vefrl 4/8, sbab-2 2/4, sbab-3 2/6,
        sbab-4 2/8, sbab-5 2/10, sbab-6 2/12, sbab-7 2/14, sbab-8 2/16, sbab-9 2/18, sbab-10 2/20,
        mclachlan-aba-84 4/10, mclachlan-bab-84 4/10, aba-104 4/14, abah-844 4/12, abah-864 4/16,
        abah-1064 4/18, babh-844 4/12, babh-864 4/16, blanes-casas-escorihuela-srkn18a 8/18,
        blanes-casas-escorihuela-srkn19a 8/19, blanes-casas-escorihuela-srkn17b 8/18,
        blanes-casas-escorihuela-srkn18b 8/19, blanes-casas-escorihuela-srkn19b 8/20
    """,
    (True, False, ROUND_OFF, ROUND_OFF): """
        scheme-iv 2/1, scheme-v 2/2, scheme-iv-v 2/3, scheme-v-iv 2/3, scheme-iv-yoshida-4 4/3,
        scheme-v-yoshida-4 4/6, scheme-v-suzuki-4 4/10, scheme-v-kahan-li-6 6/18,
        scheme-v-sofroniou-spaletta-6 6/26, scheme-v-kahan-li-8 8/34, scheme-v-suzuki-umeno-8 8/30,
        scheme-v-sofroniou-spaletta-8 8/42, gauss-equip-2 4/2, gauss-equip-3 6/3, gauss-equip-4 8/4,
        implicit-midpoint-symmetric-projection-invariants 2
    """,
    (True, False, ROUND_OFF, BOUNDED): """
        hbvm-2-1 2/1, hbvm-4-2 4/2, hbvm-6-3 6/3, hbvm-8-4 8/4, cpg-1 2/1, cpg-2 4/2, cpg-3 6/3, cpg-4 8/4,
        avf 2/1, avf-yoshida-4 4/3, avf-suzuki-4 4/5, pavf-c 2/2, pavf-p 2/1, pavf-c-yoshida-4 4/6,
        itoh-abe-symmetrized 2/1, itoh-abe-c 2/2, gonzalez 2/1, gonzalez-yoshida-4 4/3,
        stormer-verlet-symmetric-projection 2, implicit-midpoint-symmetric-projection 2,
        scheme-iii-symmetric-projection 2, suzuki-4-symmetric-projection 4, cohen-hairer-1 2/1, cohen-hairer-2
        4/2, cohen-hairer-3 6/3
    """,
    (False, False, BOUNDED, ROUND_OFF): """
        stormer-verlet-adaptive 2, sofroniou-spaletta-10-adaptive 10, gauss-4-adaptive 8, gauss-6-adaptive 12,
        gauss-8-adaptive 16
    """,
    (False, False, BOUNDED, BOUNDED): """
        tao-2 2, tao-4 4, tao-6 6
    """,
    (True, False, NONE, NONE): """
        boris 2, higuera-cary 2, he-splitting-2 2, he-splitting-4 4
    """,
    (False, False, NONE, NONE): """
        pihajoki-2 2
    """,
    (False, False, DRIFT, ROUND_OFF): """
        gauss-4-field 8, gauss-6-field 12, gauss-8-field 16
    """,
    (False, False, ROUND_OFF, BOUNDED): """
        pavf 1/1, pavf-adjoint 1/1
    """,
    (False, False, ROUND_OFF, NONE): """
        itoh-abe 1/1
    """,
    (False, False, ROUND_OFF, DRIFT): """
        rk4-projected-energy 4, stormer-verlet-projected-energy 2, rk4-relaxation 4, kutta-3-relaxation 3,
        dop853-relaxation 8
    """,
    (False, False, ROUND_OFF, ROUND_OFF): """
        rk4-projected-invariants 4
    """,
    (True, False, BOUNDED, BOUNDED): """
        gautschi 2, hochbruck-lubich 2, hairer-lubich 2, grimm-hochbruck 2,
        hessian-free-badab 4/2, hessian-free-adada 4/2, hessian-free-abadaba 4/3,
        hessian-free-adadada 4/3, hessian-free-abadabadaba 4/5, hessian-free-badadadab 6/4,
        hessian-free-badadadadab 6/5,
        lie-midpoint 2,
        quinlan-tremaine-8 8/8, quinlan-tremaine-10 10/10, quinlan-tremaine-12 12/12, quinlan-tremaine-14 14/14
    """,
    (True, True, BOUNDED, NONE): """
        rattle 2, rattle-yoshida-4 4, lobatto-iiia-iiib-constrained-2 2, lobatto-iiia-iiib-constrained-4 4,
        lobatto-iiia-iiib-constrained-6 6
    """,
    (False, True, BOUNDED, NONE): "shake 2",
    (True, True, BOUNDED, BOUNDED): """
        deuflhard 2, mollified-impulse 2, r-respa 2, imex 2, rigid-dlm 2, rigid-reich 2, moser-veselov 2,
        rigid-dlm-suzuki-4 4, rigid-reich-suzuki-4 4, rigid-reich-kahan-li-6 6
    """,
}


def parts(m) -> int | None:
    by_family = {
        "parametric": lambda: len(m.data[1]),
        "runge_kutta": lambda: len(m.data[-1]),
        "splitting": lambda: sum(b != 0 for b in m.data[1]),
        "wisdom_holman": lambda: len(m.data[1]),
        "collocation": lambda: m.data[1],
        "equip": lambda: m.data[0],
        "multistep": lambda: m.earlier + 1,
        "fcirk": lambda: m.data[0],
        "parts": lambda: len(m.data[0]),
        "poisson": lambda: m.data[0],
        "variational": lambda: m.data[2],
        "processed": lambda: sum(b != 0 for b in m.data[0][1]),
        "force_gradient": lambda: sum(any(row[1:]) for row in m.data[0][1:]),
    }
    by_family |= dict.fromkeys(("schemes_iv_v", "averaged", "discrete_gradient"), lambda: len(m.data))
    return by_family[m.family]() if m.family in by_family else None


def declarations(m) -> tuple:
    return m.symmetric, m.symplectic, m.energy, m.quadratic, m.order, parts(m)


def read(text: str) -> dict[str, tuple[int, int | None]]:
    """{id: (order, n)} from text such as "rk4 4/4, gautschi 2"."""
    found = {}
    for entry in " ".join(text.split()).split(", "):
        id, numbers = entry.split()
        order, _, n = numbers.partition("/")
        found[id] = int(order), int(n) if n else None
    return found


def test_every_record_declares_what_is_published():
    published = {id: (*kind, *of) for kind, text in PUBLISHED.items() for id, of in read(text).items()}
    assert {m.id: declarations(m) for m in METHODS} == published
    suzuki, kutta = projection.SUZUKI, projection.KUTTA_3  # which are not registered
    assert declarations(suzuki) == declarations(method(suzuki.id))
    assert declarations(kutta) == (False, False, DRIFT, DRIFT, 3, 3)


#: Family -> the fractions of the step that a method consists of; rounded to doubles they would cause a clock error.
PARTS = {
    "splitting": lambda data: data,
    "wisdom_holman": lambda data: data[:2],
    "averaged": lambda data: [[row[0] for row in data]],
    "discrete_gradient": lambda data: [data],
    "extended": lambda data: data[:1],
    "semiexplicit": lambda data: data,
    "parametric": lambda data: [[row[0] for row in data[1]]],
    "schemes_iv_v": lambda data: [[c for c, _, _, alternative in data if alternative == 0]],
}


@pytest.mark.parametrize("family", PARTS)
def test_fractions_of_a_step_add_up_to_one(family):
    with mpmath.workdps(50):
        for m in METHODS:
            for parts in PARTS[family](m.data) if m.family == family else ():
                total = mpmath.fsum(value(str(x)) if isinstance(x, Fraction) else x for x in parts)
                assert abs(total - 1) < 1e-40, m.id


def test_default_parameters():
    third = Fraction(1, 3)
    others = {m.id: dict(m.parameters) for m in METHODS if m.parameters and m.parameters != {"lam": third}}
    assert others == {
        "generating-function": {"order": 3, "lam": third},
        "r-respa": {"substeps": 10},
        "wisdom-holman-corrector": {"corrector": 17},
        "fcirk": {"stages": 8},
        **{f"tao-{order}": {"omega": 20} for order in (2, 4, 6)},
    }
    assert all(m(**m.parameters) == m for m in METHODS if m.parameters)


@pytest.mark.parametrize(
    ("id", "name", "good", "bad"),
    [
        ("r-respa", "substeps", (1, 10_000), (0, 10_001, 1.5)),
        ("generating-function", "order", (1, 6), (0, 7)),
        ("wisdom-holman-corrector", "corrector", (3, 17), (0, 4, 9, 19, -3)),
        ("fcirk", "stages", (1, 12), (0, 13, -1)),
        ("tao-2", "omega", (0, 2.5, "1/3"), (-1,)),
    ],
)
def test_values_of_parameters(id, name, good, bad):
    made = [method(id, **{name: x}) for x in good]
    assert len({repr(m.data) for m in made}) == len({m.label for m in made}) == len(good)
    for x in bad:
        with pytest.raises(InvalidInput):
            method(id, **{name: x})


def test_names_say_what_is_generalized_or_conserved():
    generalized = {m.id: m.name.partition(" of generalised order ")[2] for m in splittings.METHODS}
    assert {id: order for id, order in generalized.items() if order} == {
        "saba-2": "(4,2)",
        "saba-3": "(6,2)",
        "saba-4": "(8,2)",
        "aba-864": "(8,6,4)",
        "aba-1064": "(10,6,4)",
    }
    # Brugnano, Iavernaro & Trigiante 2010: polynomials H of degree up to 2 k / s
    for of, degree in {(2, 1): 4, (6, 3): 4, (6, 4): 3, (7, 2): 7}.items():
        assert collocation.hbvm(*of).name.endswith(f" {degree}")


def test_a_method_with_a_solver_keeps_its_parameters():
    half = Fraction(1, 2)
    plain, banded = method("scheme-i", lam=half), method("scheme-i", solver="banded")(lam=half)
    assert (banded.data, banded.order, banded.symmetric) == (plain.data, 2, True)
    assert dict(banded.parameters) == {"lam": half, "solver": "banded"}
    assert solvers.with_solver(banded, "banded") is banded
    assert banded.family == "banded"


# -- ids and citations ------------------------------------------------------------------------------------------------


def test_records_are_complete():
    assert len(BY_ID) == len(METHODS) == len({(m.family, repr(m.data), m.requires) for m in METHODS})
    for m in METHODS:
        assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", m.id)
        assert m.name, m.id
        assert m.source, m.id
        assert m.order >= 1, m.id
        assert {m.energy, m.quadratic} <= {EXACT, ROUND_OFF, BOUNDED, DRIFT, NONE}, m.id
        assert set(m.requires) <= TRAITS, m.id
    for m in (*parametric.METHODS, *energy.METHODS):
        assert all((f"{name}1990" in m.cite) == (f"-{name}-" in m.id) for name in ("yoshida", "suzuki")), m.id
    assert set(MEANINGS) == TRAITS, "what gives a system a trait is said of every trait"


def test_every_citation_is_in_the_bibliography_and_every_work_is_cited():
    cited = {m.id: m.cite for m in METHODS} | {name: problem(name).cite for name in PROBLEMS}
    assert all(cited.values())
    assert set(bibliography.entries()) == {key for keys in cited.values() for key in keys}
    for key, text in bibliography.entries().items():
        assert text.count("{") == text.count("}"), key
        fields = dict(re.findall(r"^  (\w+) = \{(.*)\},?$", text, re.MULTILINE))
        assert {"title", "author"} <= set(fields), key
        assert fields.get("year", "2000").isdigit(), key
        assert not re.search(r"\}\n  \w+ =", text), f"{key}: a comma is missing"


def test_methods_peers_and_problems_are_keys_of_dicts():
    names = {x: x.id for x in (*METHODS, *PEERS, *map(problem, PROBLEMS))}
    assert len(names) == len({*names.values()})
    assert {method("scheme-i", lam=0.5): 1}[method("scheme-i", lam="1/2")] == 1
    assert method("scheme-i", lam=0.5) != method("scheme-i", lam=0.25)


def cite(*arguments):
    return CliRunner().invoke(app, ["cite", *arguments])


def test_cite(tmp_path):
    text = cite("scheme-v", "scheme-iv", "avf").stdout
    assert text.count("@misc{wang-talk,") == 1
    assert "@article{quispel2008," in text
    assert "verlet" not in text
    unknown = cite("scheme-vi")
    assert unknown.exit_code == 2
    assert "scheme-v" in unknown.stderr
    empty = cite("--reports", str(tmp_path))
    assert empty.exit_code == 2
    assert "pytest benchmarks" in " ".join(empty.stderr.split())
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "rows.csv").write_text("id,h\navf,0.1\nstormer-verlet,0.1\nheyoka,0.1\n")
    text = cite("--reports", str(tmp_path)).stdout
    assert {"quispel2008", "verlet1967"} <= set(re.findall(r"^@\w+\{([^,]+),", text, re.MULTILINE))
    assert "kutta1901" not in text
