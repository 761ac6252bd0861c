"""Compilation: Numba's, with each function optimized once, as a whole, and its machine code kept in `cache`.

Numba makes machine code of every function that a function calls, and optimizes what is called again in each of its
callers: at ten levels most of the time went into code that nothing calls.  Here only the outermost function, a kernel
or a system's function, becomes machine code.  What it calls is lowered, linked into it, and optimized there, with it.
"""

from __future__ import annotations

import ctypes
import gc
import hashlib
import pickle
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import FunctionType, SimpleNamespace

import numba
from numba.core import serialize, typeinfer
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.runtime import rtsys

from . import cache


class Kept(_Cache):
    """What Numba asks for compiled code: the entries of `cache` under the hash of a name and the signature.

    Numba's own stands beside the source (or nowhere, where that cannot be written), watches the function's own file
    alone, and raises where it is damaged.
    """

    def __init__(self, name: str):
        self.name = name

    def entry(self, signature) -> str:
        """The name of the entry of a signature."""
        label = "".join(c if c.isalnum() else "-" for c in self.name.partition("|")[0])
        return f"{label}-{hashlib.sha256(f'{self.name}|{signature!r}'.encode()).hexdigest()[:24]}.machine"

    @property
    def cache_path(self) -> str:
        """Where the entries are."""
        return str(cache.folder())

    def load_overload(self, sig, target_context):
        """The compiled function, or None; an entry that cannot be used is removed."""
        content = cache.read(self.entry(sig))
        if content is None:
            return None
        if b"NRT_" in content:  # it allocates: of all that a compilation makes ready, compiled code calls this alone
            rtsys.initialize(target_context)
        try:
            return CompileResult._rebuild(target_context, *pickle.loads(content))
        except Exception:  # whatever it is, compiling anew is the cure
            cache.forget(self.entry(sig))
            return None

    def save_overload(self, sig, data) -> None:
        """Keep a compiled function, unless it holds addresses of this process."""
        if not data.lifted and not data.library.has_dynamic_globals:
            cache.write(self.entry(sig), serialize.dumps(data._reduce()))

    def enable(self) -> None:
        """Always."""

    def disable(self) -> None:
        """Never."""

    def flush(self) -> None:
        """Nothing is held back."""


class _Part(JITCodeLibrary):
    """The code of a function that others call: for linking alone, neither optimized nor executable."""

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name):
        """What raises a TypeError, should Python call it after all: see `_Callable`."""
        self._ensure_finalized()
        return ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value

    @property
    def codegen(self):
        """Nobody needs its environment, which is for exceptions with arguments."""
        return SimpleNamespace(set_env=lambda name, env: None)


class _Callable(CPUDispatcher):
    """A function that kernels call and Python may call: for that it is compiled once more, as a whole."""

    def __call__(self, *arguments):
        if not hasattr(self, "whole"):
            options = {name: option for name, option in self.targetoptions.items() if name != "nopython"}
            self.whole = numba.njit(**options)(self.py_func)
        return self.whole(*arguments)


def callable_from_python(dispatcher) -> None:
    """Let Python call a function that may have been compiled as a part of another."""
    dispatcher.__class__ = _Callable


class _Whole(Compiler):
    """The compiler of an outermost function: its library is of the usual kind, all others made meanwhile are parts."""

    def __init__(self, typing_context, target_context, library, *rest):
        library = JITCodeLibrary(target_context.codegen(), "whole")
        library.enable_object_caching()
        super().__init__(typing_context, target_context, library, *rest)

    def compile_extra(self, func):
        """Compile ``func``; Numba's lock keeps other threads from compiling meanwhile."""
        collects = gc.isenabled()
        gc.disable()  # a compilation makes few cycles and many objects: looking through them takes a tenth of it
        try:
            with global_compiler_lock, _parts(cpu_target.target_context):
                return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()


@contextmanager
def _parts(context) -> Iterator[None]:
    """Libraries made here are parts, without wrappers for a call from Python or C."""

    def unless_part(make):
        def made(library, *rest, **named):
            if not isinstance(library, _Part):
                make(library, *rest, **named)

        return made

    wrappers = ("create_cpython_wrapper", "create_cfunc_wrapper")
    codegen, usual = context.codegen(), context.codegen()._library_class
    try:
        codegen._library_class = _Part
        for name in wrappers:
            setattr(context, name, unless_part(getattr(context, name)))
        yield
    finally:
        codegen._library_class = usual
        for name in wrappers:
            vars(context).pop(name, None)


def compiled(f: Callable, signature, options: dict, name: str) -> Callable:
    """``f`` compiled for one signature, or loaded.

    ``name`` says, after a label and "|", what its code depends on besides the signature, the options and the source of
    this package.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
        name = f"{name}|{sorted(options.items(), key=str)}"
        dispatcher = numba.njit(**options, pipeline_class=_Whole)(_told_apart(f, name))
        kept = dispatcher._cache = Kept(name)
        with typeinfer.register_dispatcher(dispatcher), cache.alone(kept.entry(signature)):
            dispatcher.compile(signature)
    dispatcher.disable_compile()
    _of_one(dispatcher)
    return dispatcher


def _told_apart(f: Callable, name: str) -> Callable:
    """``f``, by another name for each content.

    Machine code is linked by the function's name with a number that counts what a process has compiled.  Functions of
    one name from two processes (the loops that one line of source makes of other constants) may have one number: when
    both are loaded, one is called in the place of the other.
    """
    other = FunctionType(f.__code__, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
    other.__qualname__ = f"{f.__qualname__}_{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    other.__module__, other.__kwdefaults__, other.__doc__ = f.__module__, f.__kwdefaults__, f.__doc__
    return other


def _of_one(dispatcher) -> None:
    """Let a function of one signature know it, and where its code is: Python asks for both whenever it hands it on."""
    general, only = dispatcher.get_compile_result, next(iter(dispatcher.overloads.values()))
    only.library.get_pointer_to_function = lru_cache(only.library.get_pointer_to_function)

    def get_compile_result(signature):
        return only if signature == only.signature else general(signature)

    dispatcher.get_compile_result = get_compile_result
