"""Vectors as Numba values: eight doubles or thirty-two singles, one lane for each of as many frames.

Small matrices leave most of a vector unit idle. Eight frames that advance together, each in its own lane, fill it,
and every line of an algorithm stays what it is for one frame. LLVM splits the vectors where the machine has
narrower ones.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending, njit, types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, type_callable

WIDTH = 8  # frames that advance together in double precision
WIDE = 32  # and in single precision
intrinsic: Any = extending.intrinsic  # callers do not pass the typing context, the first argument
FUSE = ("contract",)  # lets LLVM fuse products and sums


class Lanes(types.Type):
    """The type of a vector of `count` scalars."""

    def __init__(self, scalar, count: int):
        super().__init__(name=f"Lanes({scalar}, {count})")
        self.scalar, self.count = scalar, count


DOUBLES, SINGLES = Lanes(types.float64, WIDTH), Lanes(types.float32, WIDE)
KINDS = {types.float64: DOUBLES, types.float32: SINGLES}


def _vector(lanes):
    scalar = ir.DoubleType() if lanes.scalar == types.float64 else ir.FloatType()
    return ir.VectorType(scalar, lanes.count)


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """In LLVM it is a vector."""

    def __init__(self, manager, lanes):
        super().__init__(manager, lanes, _vector(lanes))


def _address(context, builder, kind, array, offset):
    return builder.gep(context.make_array(kind)(context, builder, array).data, [offset])


def _splat(builder, vector, scalar):
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


@intrinsic
def load(_, array, offset):
    """The vector at an offset of a flat array."""
    lanes = KINDS[array.dtype]

    def generate(context, builder, signature, args):
        address = _address(context, builder, array, args[0], args[1])
        value = builder.load(builder.bitcast(address, _vector(lanes).as_pointer()))
        value.align = array.dtype.bitwidth // 8
        return value

    return lanes(array, types.int64), generate


@intrinsic
def store(_, array, offset, value):
    """Write a vector at an offset of a flat array."""
    lanes = KINDS[array.dtype]

    def generate(context, builder, signature, args):
        address = _address(context, builder, array, args[0], args[1])
        written = builder.store(args[2], builder.bitcast(address, _vector(lanes).as_pointer()))
        written.align = array.dtype.bitwidth // 8
        return context.get_dummy_value()

    return types.void(array, types.int64, lanes), generate


@intrinsic
def spread(_, array, offset):
    """A number of a flat array in all lanes."""
    lanes = KINDS[array.dtype]

    def generate(context, builder, signature, args):
        return _splat(builder, _vector(lanes), builder.load(_address(context, builder, array, args[0], args[1])))

    return lanes(array, types.int64), generate


@intrinsic
def gather(_, array, rows, row, columns, column):
    """`array[rows[row + k] + columns[column + k]]` in every lane k."""
    lanes = KINDS[array.dtype]

    def generate(context, builder, signature, args):
        offsets = ir.VectorType(ir.IntType(64), lanes.count)
        at = []
        for index, first in ((rows, args[1:3]), (columns, args[3:5])):
            at.append(builder.load(builder.bitcast(_address(context, builder, index, *first), offsets.as_pointer())))
            at[-1].align = 8
        size = ir.Constant(offsets, [array.dtype.bitwidth // 8] * lanes.count)
        data = context.make_array(array)(context, builder, args[0]).data
        start = _splat(builder, offsets, builder.ptrtoint(data, offsets.element))
        places = builder.add(start, builder.mul(size, builder.add(*at)))
        pointers = builder.inttoptr(places, ir.VectorType(data.type, lanes.count))
        every = ir.Constant(ir.VectorType(ir.IntType(1), lanes.count), [1] * lanes.count)
        vector = _vector(lanes)
        given = [pointers, ir.Constant(ir.IntType(32), 8), every, ir.Constant(vector, ir.Undefined)]
        name = f"llvm.masked.gather.v{lanes.count}f{lanes.scalar.bitwidth}.v{lanes.count}p0"
        kind = ir.FunctionType(vector, [value.type for value in given])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), given)

    return lanes(array, rows, types.int64, columns, types.int64), generate


@intrinsic
def fill(_, number):
    """A number in all lanes."""
    lanes = KINDS[number]
    return lanes(number), lambda context, builder, signature, args: _splat(builder, _vector(lanes), args[0])


@intrinsic
def where_less(_, a, b, yes, no):
    """`yes` in the lanes where a < b, else `no`."""

    def generate(context, builder, signature, args):
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return a(a, a, a, a), generate


@intrinsic
def some(_, value):
    """Whether any lane is not zero."""

    def generate(context, builder, signature, args):
        mask = builder.fcmp_unordered("!=", args[0], ir.Constant(_vector(value), [0.0] * value.count))
        bits = builder.bitcast(mask, ir.IntType(value.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(value), generate


@intrinsic
def root(_, value):
    """The square root of every lane."""

    def generate(context, builder, signature, args):
        vector = _vector(value)
        name = f"llvm.sqrt.v{value.count}f{value.scalar.bitwidth}"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(vector, [vector]), name)
        return builder.call(function, args)

    return value(value), generate


def _arithmetic(python, build):
    @type_callable(python)
    def _(context):
        return lambda a, b: a if isinstance(a, Lanes) and a == b else None

    @lower_builtin(python, Lanes, Lanes)
    def _(context, builder, signature, args):
        return getattr(builder, build)(*args, flags=FUSE)


for _python, _build in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _arithmetic(getattr(operator, _python), _build)


@njit(error_model="numpy", cache=True)
def bring(values, first, each, out):
    """Bring rows of a matrix into the lanes: lane k gets the one that begins at first[k], or the only one there is."""
    rows, columns = values.shape
    flat = values.ravel()
    if rows > 1:
        for i in range(columns):
            store(out, WIDTH * i, gather(flat, first, 0, each, WIDTH * i))
    else:
        for i in range(columns):
            store(out, WIDTH * i, spread(flat, i))


@njit(error_model="numpy", cache=True)
def lane_columns(count):
    """The number of every column in all lanes: the index that `bring` needs."""
    each = np.empty(WIDTH * count, np.int64)
    for o in range(each.size):
        each[o] = o // WIDTH
    return each
