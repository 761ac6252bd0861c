"""Compile kernels and systems' functions with Numba, each optimized once as a whole, and store the machine code.

Plain Numba makes machine code of every function that is called, and optimizes it again in each of its callers: with ten
levels of calls most of the time goes into code that nothing calls.  Here only the outermost function, a kernel or a
function of a system, becomes machine code.  The functions that it calls are lowered to LLVM, linked into it, and
optimized there with it.
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


class MachineCodeCache(_Cache):
    """Numba's cache of machine code, stored in the entries of `cache` under the hash of a name and the signature.

    It replaces Numba's own cache, which stands beside the source file (or nowhere, where that folder is read-only),
    notices changes of that one file alone, and raises where an entry is damaged.
    """

    def __init__(self, name: str):
        self.name = name

    def entry(self, signature) -> str:
        """Return the name of the cache entry for a signature."""
        label = "".join(c if c.isalnum() else "-" for c in self.name.partition("|")[0])
        return f"{label}-{hashlib.sha256(f'{self.name}|{signature!r}'.encode()).hexdigest()[:24]}.machine"

    @property
    def cache_path(self) -> str:
        """The folder of the entries."""
        return str(cache.folder())

    def load_overload(self, sig, target_context):
        """Return the compiled function, or None if it is not stored; an entry that cannot be used is removed."""
        content = cache.read(self.entry(sig))
        if content is None:
            return None
        if b"NRT_" in content:  # it allocates, and loading does not set up Numba's allocator as compiling does
            rtsys.initialize(target_context)
        try:
            return CompileResult._rebuild(target_context, *pickle.loads(content))
        except Exception:  # whatever the damage, it is compiled again
            cache.forget(self.entry(sig))
            return None

    def save_overload(self, sig, data) -> None:
        """Store a compiled function, unless it holds addresses of this process."""
        if not data.lifted and not data.library.has_dynamic_globals:
            cache.write(self.entry(sig), serialize.dumps(data._reduce()))

    def enable(self) -> None:
        """Do nothing: this cache is always on."""

    def disable(self) -> None:
        """Do nothing: this cache cannot be turned off."""

    def flush(self) -> None:
        """Do nothing: no entry is held in memory."""


class _PartLibrary(JITCodeLibrary):
    """LLVM code of a function that other functions call, for linking only: no machine code is made of it."""

    def finalize(self):
        """Mark the code as complete; `_WholeLibrary` links what it calls, once for the whole."""
        self._finalized = True

    def _optimize_functions(self, ll_module):
        """Run Numba's passes on each function, by one pass manager for all functions."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def droppable_module(self):
        """Return this part's own functions, without those they call, marked so that the linker may drop unused ones."""
        if self._shared_module is None:
            self._shared_module = self._final_module
            for function in self._final_module.functions:
                if not function.is_declaration and function.linkage == Linkage.external:
                    function.linkage = "linkonce_odr"
        return self._shared_module

    def _get_module_for_linking(self):
        """Return the code together with all that it calls, for a library of another kind."""
        module = self.droppable_module().clone()
        _link(module, self)
        return module

    def get_pointer_to_function(self, name):
        """Return a stub that raises TypeError when called from Python; see `_CallableDispatcher`."""
        self._ensure_finalized()
        return ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value

    @property
    def codegen(self):
        """A stand-in that sets no environment: only exceptions with arguments need one, and parts raise none."""
        return SimpleNamespace(set_env=lambda name, env: None)


class _WholeLibrary(JITCodeLibrary):
    """The code of an outermost function, with that of all the functions that it calls."""

    def finalize(self):
        """Link each part once, then make machine code."""
        for other in _link(self._final_module, self):
            self._reload_init.update(other._reload_init)
        self._linking_libraries = []
        super().finalize()


def _link(module, library) -> list:
    """Link all libraries that a library needs into its module, callers before callees; return them in that order."""
    libraries: list = []
    _collect_callees(library, libraries)
    libraries.reverse()
    for other in libraries:
        module.link_in(
            other.droppable_module() if isinstance(other, _PartLibrary) else other._get_module_for_linking(),
            preserve=True,
        )
    return libraries


def _collect_callees(library, libraries: list) -> None:
    """Append the libraries that a library needs to ``libraries``, callees before their callers."""
    for other in library._linking_libraries:
        if other not in libraries:
            if isinstance(other, _PartLibrary):
                _collect_callees(other, libraries)
            libraries.append(other)


class _CallableDispatcher(CPUDispatcher):
    """A function that kernels call and Python may call too: the first call from Python compiles it on its own."""

    def __call__(self, *arguments):
        if not hasattr(self, "whole"):
            options = {name: option for name, option in self.targetoptions.items() if name != "nopython"}
            self.whole = numba.njit(**options)(self.py_func)
        return self.whole(*arguments)


def callable_from_python(dispatcher) -> None:
    """Let Python call a function that was compiled only as a part of another one."""
    dispatcher.__class__ = _CallableDispatcher


class _WholeCompiler(Compiler):
    """The compiler of an outermost function: its own library is linked to machine code, all others are parts."""

    def __init__(self, typing_context, target_context, library, *rest):
        library = _WholeLibrary(target_context.codegen(), "whole")
        library.enable_object_caching()
        super().__init__(typing_context, target_context, library, *rest)
        context = self.state.targetctx  # a copy for this compilation only
        context.create_cfunc_wrapper = _entry_emitter(context)

    def compile_extra(self, func):
        """Compile ``func``; hold Numba's lock, which excludes compilation in other threads."""
        collects = gc.isenabled()
        gc.disable()  # a compilation makes many objects and few cycles; collecting would take a tenth of its time
        try:
            with global_compiler_lock, _compile_as_parts(cpu_target.target_context):
                return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()


def in_registers(results, arguments) -> bool:
    """True if a function maps a tuple of one or two doubles to a tuple of the same size, as C returns in registers."""
    small = isinstance(results, types.UniTuple) and results.dtype == types.float64 and results.count <= 2
    return small and tuple(arguments) == (results,)


def _entry_emitter(context) -> Callable:
    """Return the function that emits a C entry: Numba's wrapper, or the code itself where C returns in registers.

    Functions of the second kind are arithmetic, which raises no exceptions, so that they need no wrapper.
    """
    emit_wrapper = context.create_cfunc_wrapper

    def emit_entry(library, fndesc, *rest):
        if not in_registers(fndesc.restype, fndesc.argtypes):
            return emit_wrapper(library, fndesc, *rest)
        module, result, arguments = context.create_module("entry"), fndesc.restype, fndesc.argtypes
        convention = context.call_conv
        function = ir.Function(module, convention.get_function_type(result, arguments), fndesc.llvm_func_name)
        kind = ir.FunctionType(context.get_value_type(result), [context.get_value_type(t) for t in arguments])
        entry = ir.Function(module, kind, fndesc.llvm_cfunc_wrapper_name)
        builder = ir.IRBuilder(entry.append_basic_block())
        inlined = convention.call_function(builder, function, result, arguments, entry.args, attrs=("alwaysinline",))
        builder.ret(inlined[1])
        library.add_ir_module(module)
        return None

    return emit_entry


@contextmanager
def _compile_as_parts(context) -> Iterator[None]:
    """While this context is open, compile every library as a `_PartLibrary`, without wrappers for Python or C.

    It also leaves out passes that have nothing to do, and Numba's timers: each function being compiled installs two,
    and each of them is notified of every event.
    """

    def skip_parts(emit_wrapper):
        def emit(library, *rest, **named):
            if not isinstance(library, _PartLibrary):
                emit_wrapper(library, *rest, **named)

        return emit

    wrappers = ("create_cpython_wrapper", "create_cfunc_wrapper")
    codegen, library_class = context.codegen(), context.codegen()._library_class
    timer, pipelines = event.install_timer, Compiler.define_pipelines
    try:
        codegen._library_class = _PartLibrary
        event.install_timer = lambda kind, callback: nullcontext()
        Compiler.define_pipelines = lambda compiler: [_without_idle_passes(compiler.state, *pipelines(compiler))]
        for name in wrappers:
            setattr(context, name, skip_parts(getattr(context, name)))
        yield
    finally:
        codegen._library_class = library_class
        event.install_timer, Compiler.define_pipelines = timer, pipelines
        for name in wrappers:
            vars(context).pop(name, None)


def _without_idle_passes(state, passes: PassManager) -> PassManager:
    """Return the pipeline without passes that cannot apply: inlining closures if there are none, rewriting array
    expressions where arrays cannot be allocated.
    """
    idle = set()
    if not any(isinstance(constant, CodeType) for constant in state.func_id.code.co_consts):
        idle.add(InlineClosureLikes)
    if not state.flags.nrt:
        idle.add(NopythonRewrites)
    shortened = PassManager(passes.pipeline_name)
    shortened.passes = [each for each in passes.passes if each[0] not in idle]
    shortened.finalize()
    return shortened


def compiled(f: Callable, signature, options: dict, name: str) -> Callable:
    """Return ``f`` compiled for one signature, from the cache if it is there.

    Parameters
    ----------
    f : the Python function
    signature : Numba signature of the arguments and the result
    options : keyword arguments of `numba.njit`
    name : a label, "|", and everything that the machine code depends on besides the signature, the options and the
        source of this package
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
        name = f"{name}|{sorted(options.items(), key=str)}"
        dispatcher = numba.njit(**options, pipeline_class=_WholeCompiler)(_rename_by_content(f, name))
        store = dispatcher._cache = MachineCodeCache(name)
        with typeinfer.register_dispatcher(dispatcher), cache.alone(store.entry(signature)):
            dispatcher.compile(signature)
    dispatcher.disable_compile()
    _remember_signature(dispatcher)
    return dispatcher


def _rename_by_content(f: Callable, name: str) -> Callable:
    """Return a copy of ``f`` whose qualified name contains a hash of ``name``, so that machine code never clashes.

    Machine code is linked by the function's name and a number that counts what a process has compiled.  Functions of
    the same name from two processes (loops that one line of source makes with different constants) may have the same
    number: if both are loaded, one would be called in place of the other.
    """
    renamed = FunctionType(f.__code__, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
    renamed.__qualname__ = f"{f.__qualname__}_{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    renamed.__module__, renamed.__kwdefaults__, renamed.__doc__ = f.__module__, f.__kwdefaults__, f.__doc__
    return renamed


def _remember_signature(dispatcher) -> None:
    """Remember a function's only signature and its address: Python asks for both whenever it passes it on."""
    look_up, only = dispatcher.get_compile_result, next(iter(dispatcher.overloads.values()))
    only.library.get_pointer_to_function = lru_cache(only.library.get_pointer_to_function)

    def get_compile_result(signature):
        return only if signature == only.signature else look_up(signature)

    dispatcher.get_compile_result = get_compile_result
