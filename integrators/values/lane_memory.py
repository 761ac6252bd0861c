"""Memory of lanes: arrays of doubles whose last axis runs over the lanes, which a kernel sees as arrays of lanes.

Orbits are integrated in blocks, each of as many orbits as there are lanes.  A kernel takes the tables of one block,
with two axes; outside the kernel every array has an axis of blocks before these two, and one of lanes after them.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np import arrayobj

from .lanes import offset_address
from .masks import LANES


def table_type(ndim: int = 2) -> types.Array:
    """Return the Numba type of an array whose entries are vectors of SIMD lanes, without assuming an alignment."""
    return types.Array(LANES, ndim, "C", aligned=False)


def block_type(array: types.Array) -> types.Type:
    """Return the type of one block of an array (blocks, ..., lanes): an array of lanes, or a single value of lanes."""
    return table_type(array.ndim - 2) if array.ndim > 2 else LANES


def type_with_block(record: Any, arrays: Any) -> Any:
    """Return the Numba type of the result of `with_block`, for the types of its arguments ``record`` and ``arrays``."""
    kinds = dict(zip(record.fields, record.types, strict=True))
    kinds |= {name: block_type(t) for name, t in zip(arrays.fields, arrays.types, strict=True)}
    return types.BaseTuple.from_types(tuple(kinds.values()), record.instance_class)


def _view(context: Any, builder: Any, array_type: Any, array: Any, block: Any) -> Any:
    """Emit the LLVM code of a view of block number ``block`` of an array (blocks, ..., lanes), as an array of lanes."""
    source = arrayobj.make_array(array_type)(context, builder, array)
    shape, strides = (cgutils.unpack_tuple(builder, x) for x in (source.shape, source.strides))
    pointer = ir.VectorType(ir.DoubleType(), LANES.n).as_pointer()
    address = offset_address(builder, source.data, builder.mul(block, strides[0]), pointer)
    kind = block_type(array_type)
    if kind is LANES:
        return builder.load(address, align=8)
    out = arrayobj.make_array(kind)(context, builder)
    arrayobj.populate_array(
        out,
        data=address,
        shape=shape[1:-1],
        strides=strides[1:-1],
        itemsize=context.get_constant(types.intp, 8 * LANES.n),
        meminfo=None,
    )
    return out._getvalue()


@intrinsic
def block_of(typingctx: Any, array: types.Type, block: types.Type) -> tuple:
    """View block number ``block`` of an array of doubles (blocks, ..., lanes) as an array of lanes (...)."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _view(context, builder, array, *args)

    return block_type(array)(array, types.intp), codegen


@intrinsic
def with_block(typingctx: Any, record: types.Type, arrays: types.Type, block: types.Type) -> tuple:
    """Copy the NamedTuple ``record``, with one block of an array in place of each field that ``arrays`` has too.

    ``arrays`` is a NamedTuple of arrays (blocks, ..., lanes), whose fields are some of those of ``record``; ``block``
    is the number of the block, as in `block_of`.
    """
    result = type_with_block(record, arrays)

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        old, given, number = args
        out = cgutils.get_null_value(context.get_value_type(result))
        for i, name in enumerate(record.fields):
            part = builder.extract_value(old, i)
            if name in arrays.fields:
                k = arrays.fields.index(name)
                part = _view(context, builder, arrays.types[k], builder.extract_value(given, k), number)
            out = builder.insert_value(out, part, i)
        return out

    return result(record, arrays, types.intp), codegen


@intrinsic
def zeros_of(typingctx: Any, like: types.Type) -> tuple:
    """Return a tuple with as many items as the tuple ``like``, each of which is SIMD lanes of zeros."""
    kind = types.UniTuple(LANES, len(like))

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return cgutils.get_null_value(context.get_value_type(kind))

    return kind(like), codegen
