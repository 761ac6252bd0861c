"""C and C++ by the user's compiler: missing compilers and headers, kept libraries, the source for Boost and GSL."""

from __future__ import annotations

import re

import numpy as np
import pytest

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput
from phasebench.reference import installed, native
from phasebench.reference.peers import PEERS, gsl, integrate_peer
from phasebench.reference.peers.prepared import prepare_peer

MADE = problem("pendulum")
needs_compiler = pytest.mark.skipif(native.compiler() is None, reason="there is no C compiler")


@pytest.mark.parametrize("id", ["boost-rk4", "gsl-rk2imp"])
def test_without_compiler_or_headers_a_run_is_skipped_and_says_what_to_install(monkeypatch, id):
    peer = PEERS[id]
    library = native.LIBRARIES[peer.package]

    def told(why: str) -> None:
        s = integrate_peer(MADE, id, h=0.1, steps=3)
        assert s.status == "skipped"
        assert why in s.reason
        assert library.install in s.reason
        with pytest.raises(InvalidInput, match=re.escape(library.install)):
            prepare_peer(MADE, peer)
        assert not integrator(peer).installed
        assert installed.version_of.__wrapped__(peer.package) is None

    monkeypatch.setattr(native, "compiler", lambda language="C": None)
    told(f"there is no {library.language} compiler")
    monkeypatch.setattr(native, "compiler", lambda language="C": "/some/compiler")
    monkeypatch.setattr(native, "_version", lambda library, path: None)
    told(f"finds no {library.header}")


def test_the_users_compiler_comes_first(monkeypatch):
    monkeypatch.setattr(native.shutil, "which", lambda name: {"mine": "/mine", "cc": "/cc", "c++": "/c++"}.get(name))
    for language, variable, usual in (("C", "CC", "/cc"), ("C++", "CXX", "/c++")):
        for named, found in (("mine", "/mine"), ("gone", usual), ("", usual)):
            monkeypatch.setenv(variable, named)
            assert native.compiler(language) == found


@needs_compiler
def test_source_is_compiled_once_and_a_damaged_library_is_compiled_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    made, compile_it = [], native._compile
    monkeypatch.setattr(native, "_compile", lambda *all: made.append(1) or compile_it(*all))
    text = "double three(void) { return 3; }"

    def answer(source: str) -> float:
        function = native.load_source(source).three
        function.restype = native.ctypes.c_double
        return function()

    assert [answer(text), answer(text), len(made)] == [3.0, 3.0, 1]
    assert [answer(text.replace("3;", "4;")), len(made)] == [4.0, 2]
    for kept in tmp_path.glob("*/c-*.so"):
        kept.write_bytes(kept.read_bytes()[:-1] + b"x")
    assert [answer(text), len(made)] == [3.0, 3]


@needs_compiler
def test_gsl_gets_the_jacobian_of_the_equations(tmp_path):
    """Compiled without GSL: the field's derivatives by differences, in a system whose Jacobian is not symmetric."""
    made = problem("double-pendulum")
    text = gsl.program("rk2imp", made.system)
    macros = "\n".join(line for line in text.splitlines() if line.startswith("#define"))
    parts = re.search(r"(static int field.*?)static void \*no_control", text, re.DOTALL)[1].replace("static int", "int")
    head = f"#include <math.h>\n#define GSL_SUCCESS 0\n{macros}\nstatic long evaluations;\n"
    library = native.load_source(head + parts)
    y, slope, jacobian, of_t = np.array([0.3, -0.7, 0.2, 0.5]), np.empty(4), np.empty((4, 4)), np.empty(4)

    def call(name, y, *out):
        pointers = [native.ctypes.c_void_p(x.ctypes.data) for x in (y, *out)]
        getattr(library, name)(native.ctypes.c_double(0.0), *pointers, None)
        return out[0].copy()

    found = call("jacobian", y, jacobian, of_t)
    for j, e in enumerate(np.eye(4) * 1e-6):
        difference = (call("field", y + e, slope) - call("field", y - e, slope)) / 2e-6
        np.testing.assert_allclose(found[:, j], difference, atol=1e-8)
    assert np.abs(found - found.T).max() > 0.1
    np.testing.assert_allclose(call("field", y, slope), made.system.vector_field()(0.0, y), atol=1e-14)
