"""Compile kernels and systems' functions with Numba, once for one signature, and keep the machine code.

Numba's own cache stands beside a source file, and notices changes of that file alone.  So every function here gets a
source file of its own, an empty one, in a subfolder of `cache` whose name is the hash of all that the machine code is
made of.  A file with a hash of the subfolder's files (its *seal*) shows whether it is damaged; if so, it is removed and
made again.

Compiled loops over steps call a system's functions through pointers, by what Numba documents as its wrapper address
protocol.  Numba's own entry for such calls checks for exceptions and calls the function; generated functions are
arithmetic, which raises none, and a call would cost as much as a small gradient.  The entry of a `Function` has the
function's code inlined, or, of one that is rarely called, compiles the function at the first call.

References: Numba's documentation, "Notes on caching", "First-class function types", "Low-level extension API".
"""

from __future__ import annotations

import _thread
import ctypes
import gc
import hashlib
import inspect
import os
import time
import traceback
import warnings
from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path
from threading import Timer
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from . import cache
from .digest import digest as digest_of
from .options import UNCALLED

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Dispatcher, Signature


#: Seconds after which an interrupt that came while compiled code waited is raised.
LATER = 0.05


def load_or_compile(f: Callable, signature: Signature, options: dict, name: str) -> Dispatcher:
    """Return ``f`` compiled for one signature, from the cache if it is there.

    Parameters
    ----------
    f : the Python function
    signature : Numba signature of the arguments and the result
    options : keyword arguments of `numba.njit`
    name : a label, "|", and everything that the machine code depends on besides the signature, the options and the
        modules of this package in which ``f`` and the functions that it calls are defined
    """
    content = f"{name}|{sorted(options.items(), key=str)}|{signature!r}|{digest_of(modules_of(f) | {__name__})}"
    digest = hashlib.sha256(content.encode()).hexdigest()[:24]
    entry = f"{''.join(c if c.isalnum() else '-' for c in name.partition('|')[0])}-{digest}"
    f = _without_closure(f)
    with cache.hold_lock(cache.seal_of(entry)):
        source, sealed = cache.source_of(entry)
        try:
            made = _with_room(_compile, f, signature, options, digest, source)
        except Exception as error:
            unwritable = isinstance(error, (OSError, RuntimeError))  # a full disk, or no place that Numba may write to
            if not (sealed or unwritable):
                raise
            cache.forget(entry)
            if unwritable:
                cache.log_once(error)
            source = None if unwritable else cache.source_of(entry)[0]
            made = _with_room(_compile, f, signature, options, digest, source)
        if source is not None:
            cache.seal(entry)
    made.disable_compile()
    return made


def modules_of(f: Callable) -> set[str]:
    """Return the names of the modules that define ``f`` and the functions that it refers to, directly or not."""
    found: set[str] = set()
    seen: set[int] = set()
    waiting: list = [f]
    while waiting:
        part = waiting.pop()
        part = getattr(part, "py_func", part)
        found.add(getattr(part, "__module__", None) or "")
        if isinstance(part, FunctionType) and id(part) not in seen:
            seen.add(id(part))
            inside = inspect.getclosurevars(part)
            waiting += [x for x in (*inside.globals.values(), *inside.nonlocals.values()) if callable(x)]
    return found


def with_functions(f: Callable, functions: dict[str, Callable]) -> Callable:
    """A copy of ``f`` with compiled functions in its globals: of a closure Numba would never find the code again."""
    made = FunctionType(f.__code__, f.__globals__ | functions, f.__name__)
    made.__module__ = f.__module__
    return made


def _without_closure(f: Callable) -> Callable:
    if not f.__closure__:
        return f
    names = ", ".join(inspect.signature(f).parameters)
    body = numba.njit(inline="always")(f)
    namespace: dict = {"__name__": __name__, "body": body}
    exec(f"def whole({names}): return body({names})", namespace)
    return namespace["whole"]


def _with_room(f: Callable, *arguments: Any) -> Any:
    return f(*arguments)


# A frame that claims a megabyte gives what it calls the room behind it.  Python keeps the variables of nested calls in
# blocks of 16 kB else, and where a loop stands at the end of a block, each call in it asks the system for the next
# block and returns it: hundreds of thousands of times in a compilation.
_with_room.__code__ = _with_room.__code__.replace(co_stacksize=1 << 17)


def _compile(f: Callable, signature: Signature, options: dict, digest: str, source: Path | None) -> Dispatcher:
    """Compile ``f``, or load the machine code beside the file ``source``; without that nothing is stored."""
    collects = gc.isenabled()
    gc.disable()  # a compilation makes many objects and few cycles; collecting would take a tenth of its time
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
            dispatcher = numba.njit(**options, cache=source is not None)(_rename(f, digest, source))
            dispatcher.compile(signature)
            return dispatcher
    finally:
        if collects:
            gc.enable()


def _rename(f: Callable, digest: str, source: Path | None) -> Callable:
    """Return a copy of ``f`` whose qualified name contains the digest, defined in the file ``source`` if there is one.

    Machine code is linked by the function's name and a number that counts what a process has compiled.  Functions of
    the same name from two processes (loops that one line of source makes with different constants) may have the same
    number: if both are loaded, one would be called in place of the other.
    """
    code = f.__code__ if source is None else f.__code__.replace(co_filename=str(source))
    renamed = FunctionType(code, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
    renamed.__qualname__ = f"{f.__qualname__}_{digest[:16]}"
    renamed.__module__, renamed.__kwdefaults__, renamed.__doc__ = f.__module__, f.__kwdefaults__, f.__doc__
    return renamed


class Function(types.WrapperAddressProtocol):
    """A compiled function that raises no exception: kernels call it through a pointer, and Python may call it, too.

    The parameters are those of `load_or_compile`.  The pointer is compiled or loaded at once, or with ``rare`` when
    compiled code first calls it; what Python calls is compiled when it first does so.
    """

    def __init__(self, f: Callable, signature: Signature, options: dict, name: str, rare: bool = False) -> None:
        self._made = f, signature, options, name
        self._address = self._stub() if rare else self._compile()

    def _compile(self) -> int:
        """Compile or load the entry; returns its address."""
        f, signature, options, name = self._made
        address = with_functions(_address, {"entry_address": _entry_of(f, signature, options, name)})
        made_of = f"{sorted(options.items(), key=str)} {digest_of(modules_of(f))}"  # an intrinsic does not tell them
        entry = f"{name}|entry of {signature!r} {made_of}"
        return load_or_compile(address, types.intp(), {"no_cfunc_wrapper": True}, entry)()

    def _stub(self) -> int:
        """The address of an entry that at its first call compiles the function, which it then calls."""
        _, signature, _, name = self._made
        stub = with_functions(_address, {"entry_address": _stub_of(signature)})
        pair = types.UniTuple(types.intp, 2)
        address, place = load_or_compile(stub, pair(), {"no_cfunc_wrapper": True}, f"{name}|stub of {signature!r}")()
        places = (ctypes.c_ssize_t * 2).from_address(place)
        self._resolve = ctypes.CFUNCTYPE(None)(partial(self._fill, places))
        places[0] = ctypes.cast(self._resolve, ctypes.c_void_p).value
        return address

    def _fill(self, places: ctypes.Array) -> None:
        """Compile the function for its stub, which is being called and asks until it has the address."""
        began, interrupted = time.perf_counter(), False
        while not places[1]:
            try:
                places[1] = self._compile()
            except KeyboardInterrupt:
                interrupted = True
            except BaseException:
                traceback.print_exc()
                os.abort()
        _waited.append(time.perf_counter() - began)
        if interrupted:  # raised here, it would end in the compiled code that waits
            Timer(LATER, _thread.interrupt_main).start()

    @cached_property
    def dispatcher(self) -> Dispatcher:
        """The compiled function as Python calls it; loaded or compiled at the first access."""
        f, signature, options, name = self._made
        return load_or_compile(f, signature, options | {"no_cfunc_wrapper": True}, name)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function from Python."""
        return self.dispatcher(*arguments)

    def signature(self) -> Signature:
        """The Numba signature of the function's arguments and result."""
        return self._made[1]

    def __wrapper_address__(self) -> int:
        """The address of the entry through which compiled code calls the function."""
        return self._address


def _address():
    return entry_address()  # noqa: F821 (`Function` sets it)


#: Seconds that calls of stubs have taken to compile.
_waited: list[float] = []


def waited() -> float:
    """Seconds that this process has compiled so far while compiled code waited."""
    return sum(_waited)


def _stub_of(signature: Signature) -> Callable:
    """Return an intrinsic that yields two addresses: of a C function, and of two numbers that it reads.

    The numbers are the address of a function (none -> none) that sets the second, and that of the function with this
    signature to call, 0 as long as that is not known.
    """

    @intrinsic
    def stub_addresses(typing_context):
        def codegen(context, builder, made, arguments):
            word = context.get_value_type(types.intp)
            given = [context.get_value_type(t) for t in signature.args]
            kind = ir.FunctionType(context.get_value_type(signature.return_type), given)
            pair = ir.ArrayType(word, 2)
            places = ir.GlobalVariable(builder.module, pair, builder.module.get_unique_name("places"))
            places.linkage, places.initializer = "internal", ir.Constant(pair, None)
            stub = ir.Function(builder.module, kind, builder.module.get_unique_name("stub"))
            inside = ir.IRBuilder(stub.append_basic_block())
            index = [ir.Constant(ir.IntType(32), k) for k in (0, 1)]
            fill, found = (inside.gep(places, [index[0], k]) for k in index)
            look, ask, go = (stub.append_basic_block(name) for name in ("look", "ask", "go"))
            inside.branch(look)
            inside.position_at_end(look)
            unknown = inside.icmp_unsigned("==", inside.load(found), ir.Constant(word, 0))
            inside.cbranch(unknown, ask, go)
            inside.position_at_end(ask)
            nothing = ir.FunctionType(ir.VoidType(), [])
            inside.call(inside.inttoptr(inside.load(fill), nothing.as_pointer()), [])
            inside.branch(look)
            inside.position_at_end(go)
            inside.ret(inside.call(inside.inttoptr(inside.load(found), kind.as_pointer()), stub.args))
            both = [builder.ptrtoint(a, word) for a in (stub, places)]
            return context.make_tuple(builder, made.return_type, both)

        return types.UniTuple(types.intp, 2)(), codegen

    return stub_addresses


def _entry_of(f: Callable, signature: Signature, options: dict, name: str) -> Callable:
    """Return an intrinsic that yields the address of a C function with the code of ``f`` inlined into it."""

    @intrinsic
    def entry_address(typing_context):
        def codegen(context, builder, _, arguments):
            made = _compile(f, signature, options | UNCALLED, hashlib.sha256(name.encode()).hexdigest(), None)
            entry = entry_of(made, context, builder)
            return builder.ptrtoint(entry, context.get_value_type(types.intp))

        return types.intp(), codegen

    return entry_address


def entry_of(compiled: Dispatcher, context: Any, builder: Any) -> ir.Function:
    """Define a C function with the code of a compiled function, which raises no exception, inlined into it.

    It becomes part of the module that ``builder`` writes.
    """
    (whole,) = compiled.overloads.values()
    context.active_code_library.add_linking_library(whole.library)
    result, given, convention = whole.fndesc.restype, whole.fndesc.argtypes, context.call_conv
    kind = ir.FunctionType(context.get_value_type(result), [context.get_value_type(t) for t in given])
    entry = ir.Function(builder.module, kind, f"{whole.fndesc.mangled_name}.entry")
    inside = ir.IRBuilder(entry.append_basic_block())
    callee = context.declare_function(builder.module, whole.fndesc)
    _, value = convention.call_function(inside, callee, result, given, entry.args, attrs=("alwaysinline",))
    inside.ret(value)
    return entry
