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
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from types import CodeType, FunctionType, SimpleNamespace

import numba
from llvmlite import ir
from llvmlite.binding import Linkage
from numba import types
from numba.core import event, serialize, typeinfer
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.runtime import rtsys
from numba.core.typed_passes import NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

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
    """The code of a function that others call: for linking alone, neither linked nor optimized as a whole."""

    def finalize(self):
        """What it calls is linked into the whole, once, with it (`_Linked`)."""
        self._finalized = True

    def _optimize_functions(self, ll_module):
        """As in other libraries, with what optimizes made once for all functions."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def alone(self):
        """The functions, to be left out where nothing calls them any more, without those that they call."""
        if self._shared_module is None:
            self._shared_module = self._final_module
            for function in self._final_module.functions:
                if not function.is_declaration and function.linkage == Linkage.external:
                    function.linkage = "linkonce_odr"
        return self._shared_module

    def _get_module_for_linking(self):
        """For a library of another kind: with all that they call."""
        module = self.alone().clone()
        _link(module, self)
        return module

    def get_pointer_to_function(self, name):
        """What raises a TypeError, should Python call it after all: see `_Callable`."""
        self._ensure_finalized()
        return ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value

    @property
    def codegen(self):
        """Nobody needs its environment, which is for exceptions with arguments."""
        return SimpleNamespace(set_env=lambda name, env: None)


class _Linked(JITCodeLibrary):
    """The code of an outermost function, with that of all parts."""

    def finalize(self):
        """Link each part once."""
        for other in _link(self._final_module, self):
            self._reload_init.update(other._reload_init)
        self._linking_libraries = []
        super().finalize()


def _link(module, library) -> list:
    """Link all libraries that a library needs into its module, each after all that call it; returns them."""
    found: list = []
    _enter_callees(library, found)
    found.reverse()
    for other in found:
        module.link_in(other.alone() if isinstance(other, _Part) else other._get_module_for_linking(), preserve=True)
    return found


def _enter_callees(library, found: list) -> None:
    """Enter the libraries that a library needs, each after those that it needs itself."""
    for other in library._linking_libraries:
        if other not in found:
            if isinstance(other, _Part):
                _enter_callees(other, found)
            found.append(other)


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
        library = _Linked(target_context.codegen(), "whole")
        library.enable_object_caching()
        super().__init__(typing_context, target_context, library, *rest)
        context = self.state.targetctx  # a copy, of this compilation alone
        context.create_cfunc_wrapper = _entry(context)

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


def in_registers(results, arguments) -> bool:
    """Whether a function takes a value of one or two numbers and returns another: C returns it in registers."""
    small = isinstance(results, types.UniTuple) and results.dtype == types.float64 and results.count <= 2
    return small and tuple(arguments) == (results,)


def _entry(context) -> Callable:
    """What makes functions' entries for C: Numba's call the function; where C returns in registers, they are it.

    Such a function is arithmetic, which raises nothing.
    """
    usual = context.create_cfunc_wrapper

    def made(library, fndesc, *rest):
        if not in_registers(fndesc.restype, fndesc.argtypes):
            return usual(library, fndesc, *rest)
        module, returned, given = context.create_module("entry"), fndesc.restype, fndesc.argtypes
        convention = context.call_conv
        function = ir.Function(module, convention.get_function_type(returned, given), fndesc.llvm_func_name)
        kind = ir.FunctionType(context.get_value_type(returned), [context.get_value_type(t) for t in given])
        entry = ir.Function(module, kind, fndesc.llvm_cfunc_wrapper_name)
        builder = ir.IRBuilder(entry.append_basic_block())
        inlined = convention.call_function(builder, function, returned, given, entry.args, attrs=("alwaysinline",))
        builder.ret(inlined[1])
        library.add_ir_module(module)
        return None

    return made


@contextmanager
def _parts(context) -> Iterator[None]:
    """Libraries made here are parts, without wrappers for a call from Python or C.

    Left out are passes that have nothing to do, and Numba's timers: each function being compiled has two, which are
    told of every event.
    """

    def unless_part(make):
        def made(library, *rest, **named):
            if not isinstance(library, _Part):
                make(library, *rest, **named)

        return made

    wrappers = ("create_cpython_wrapper", "create_cfunc_wrapper")
    codegen, usual = context.codegen(), context.codegen()._library_class
    timer, pipelines = event.install_timer, Compiler.define_pipelines
    try:
        codegen._library_class = _Part
        event.install_timer = lambda kind, callback: nullcontext()
        Compiler.define_pipelines = lambda compiler: [_needed(compiler.state, *pipelines(compiler))]
        for name in wrappers:
            setattr(context, name, unless_part(getattr(context, name)))
        yield
    finally:
        codegen._library_class = usual
        event.install_timer, Compiler.define_pipelines = timer, pipelines
        for name in wrappers:
            vars(context).pop(name, None)


def _needed(state, passes: PassManager) -> PassManager:
    """The passes without those that look for functions inside of one without, and for new arrays where none can be."""
    idle = set()
    if not any(isinstance(constant, CodeType) for constant in state.func_id.code.co_consts):
        idle.add(InlineClosureLikes)
    if not state.flags.nrt:
        idle.add(NopythonRewrites)
    needed = PassManager(passes.pipeline_name)
    needed.passes = [each for each in passes.passes if each[0] not in idle]
    needed.finalize()
    return needed


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
