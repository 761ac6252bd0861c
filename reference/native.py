"""Write C and C++ code of a system's equations of motion, compile it by the user's compiler, and load it.

The statements are the same as in this project's own compiled kernels.  All code is compiled with the flags `FLAGS`.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from phasebench.integrators.compile import cache

if TYPE_CHECKING:
    import sympy as sp

FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")
#: Language -> (variable that names its compiler, usual names, ending of a source file).
LANGUAGES = {"C": ("CC", ("gcc", "cc"), "c"), "C++": ("CXX", ("g++", "c++"), "cpp")}


class Library(NamedTuple):
    """A C or C++ library whose integrators are called from programs that include its headers.

    Attributes
    ----------
    language : "C" or "C++"
    header, version : a header file, and the macro in it that holds the version as text
    install : the shell command that installs the library and a compiler
    """

    language: str
    header: str
    version: str
    install: str


LIBRARIES = {
    "boost": Library("C++", "boost/version.hpp", "BOOST_LIB_VERSION", "apt install g++ libboost-dev"),
    "gsl": Library("C", "gsl/gsl_version.h", "GSL_VERSION", "apt install gcc libgsl-dev"),
}


def compiler(language: str = "C") -> str | None:
    """The path of a compiler for "C" or "C++": $CC (or $CXX), else gcc or cc (g++ or c++); None if none is found."""
    variable, names, _ = LANGUAGES[language]
    for name in (os.environ.get(variable), *names):
        if name and shutil.which(name):
            return shutil.which(name)
    return None


@functools.cache
def _version(library: Library, path: str) -> str | None:
    """The version in a library's header, read by the preprocessor of the compiler at ``path``; None without header."""
    text = f"#include <{library.header}>\nversion {library.version}\n"
    language = library.language.lower()
    done = subprocess.run([path, "-E", "-P", "-x", language, "-"], input=text, capture_output=True, text=True)
    found = re.search(r'version "(\S+)"', done.stdout)
    return found[1].replace("_", ".") if done.returncode == 0 and found else None


def library_version(package: str) -> str | None:
    """The version of the library ``package``, a key of `LIBRARIES`; None without its headers or a compiler."""
    library = LIBRARIES[package]
    path = compiler(library.language)
    return _version(library, path) if path else None


def load_library(package: str) -> None:
    """Check that a library, a key of `LIBRARIES`, and its compiler are there; raise ImportError if one is missing."""
    library = LIBRARIES[package]
    if compiler(library.language) is None:
        raise ImportError(f"there is no {library.language} compiler")
    if library_version(package) is None:
        raise ImportError(f"the compiler finds no {library.header}")


def load_source(text: str, language: str = "C", libraries: Sequence[str] = ()) -> ctypes.CDLL:
    """Compile C or C++ source to a shared library and load it; the library is cached on disk for this machine.

    ``text`` is the source, ``libraries`` are the names of libraries to link.
    Raises RuntimeError without a compiler or if compilation fails.
    """
    path = compiler(language)
    if path is None:
        raise RuntimeError(f"no {language} compiler: install gcc or set {LANGUAGES[language][0]}")
    made_by = Path(path).resolve()
    known = {name: library_version(name) for name in LIBRARIES if LIBRARIES[name].language == language}
    facts = [text, language, *libraries, *FLAGS, str(made_by), made_by.stat().st_mtime_ns, known]
    name = f"c-{hashlib.sha256(repr(facts).encode()).hexdigest()}.so"
    with tempfile.TemporaryDirectory() as folder:
        library, kept = Path(folder) / "loop.so", cache.read(name)
        if kept is None:
            _compile(path, text, language, libraries, library)
            cache.write(name, library.read_bytes())
        else:
            library.write_bytes(kept)
        return ctypes.CDLL(str(library))


def _compile(path: str, text: str, language: str, libraries: Sequence[str], target: Path) -> None:
    """Compile source by the compiler at ``path`` into the shared library ``target``."""
    source = target.with_suffix(f".{LANGUAGES[language][2]}")
    source.write_text(text)
    command = [path, *FLAGS, str(source), "-o", str(target), *(f"-l{name}" for name in (*libraries, "m"))]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{path} failed: {done.stderr.strip()}")


def statements(expressions: Sequence[sp.Expr], *arguments: tuple[str, Sequence[sp.Symbol]]) -> tuple[str, list[str]]:
    """Write SymPy expressions in C: (statements that set common subexpressions, list of the expressions that use them).

    ``arguments`` are pairs (letter, variables); the i-th variable is named letter_i in C.
    """
    from phasebench.integrators.compile import printing
    from phasebench.integrators.compile.codegen import DOUBLE

    text = printing.source("f", list(arguments), [list(expressions)], DOUBLE)
    lines = [line.strip() for line in text.splitlines()[1:]]
    body = [f"double {line};" for line in lines[sum(len(v) for _, v in arguments) : -1]]
    inner = re.fullmatch(r"return value\(\((.*),\)\)", lines[-1])[1]
    parts, depth, start = [], 0, 0
    for i, c in enumerate(inner + ","):
        depth += (c == "(") - (c == ")")
        if c == "," and depth == 0:
            parts.append(inner[start:i].strip())
            start = i + 1
    return " ".join(body), parts
