"""Vectors as Numba values: eight doubles or thirty-two singles, one lane for each of as many frames.

Small matrices leave most of a vector unit idle. Eight frames that advance together, each in its own lane, fill it,
and every line of an algorithm stays what it is for one frame. LLVM splits the vectors where the machine has
narrower ones.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import extending, njit, types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, type_callable

WIDTH = 8  # frames that advance together in double precision
PAIR = 2 * WIDTH  # and where they only share the numbers of one matrix
WIDE = 32  # and in single precision
intrinsic: Any = extending.intrinsic  # callers do not pass the typing context, the first argument
FUSE = ("contract",)  # lets LLVM fuse products and sums


class Lanes(types.Type):
    """The type of a vector of `count` scalars."""

    def __init__(self, scalar, count: int):
        super().__init__(name=f"Lanes({scalar}, {count})")
        self.scalar, self.count = scalar, count


DOUBLES, SINGLES, PAIRS = Lanes(types.float64, WIDTH), Lanes(types.float32, WIDE), Lanes(types.float64, PAIR)
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


def _read(builder, vector, address, align):
    value = builder.load(builder.bitcast(address, vector.as_pointer()))
    value.align = align
    return value


def _write(builder, value, address, align):
    builder.store(value, builder.bitcast(address, value.type.as_pointer())).align = align


def _splat(builder, vector, scalar):
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


def _loading(lanes, array):
    def generate(context, builder, signature, args):
        address = _address(context, builder, array, args[0], args[1])
        return _read(builder, _vector(lanes), address, array.dtype.bitwidth // 8)

    return lanes(array, types.int64), generate


def _spreading(lanes, array):
    def generate(context, builder, signature, args):
        return _splat(builder, _vector(lanes), builder.load(_address(context, builder, array, args[0], args[1])))

    return lanes(array, types.int64), generate


@intrinsic
def load(_, array, offset):
    """The vector at an offset of a flat array."""
    return _loading(KINDS[array.dtype], array)


@intrinsic
def load_pair(_, array, offset):
    """The sixteen doubles at an offset of a flat array."""
    return _loading(PAIRS, array)


@intrinsic
def spread(_, array, offset):
    """A number of a flat array in all lanes."""
    return _spreading(KINDS[array.dtype], array)


@intrinsic
def spread_pair(_, array, offset):
    """A double of a flat array in sixteen lanes."""
    return _spreading(PAIRS, array)


@intrinsic
def store(_, array, offset, value):
    """Write a vector at an offset of a flat array."""

    def generate(context, builder, signature, args):
        address = _address(context, builder, array, args[0], args[1])
        _write(builder, args[2], address, array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.int64, value), generate


@intrinsic
def store_singles(_, array, offset, value):
    """Write doubles as singles at an offset of a flat array."""

    def generate(context, builder, signature, args):
        narrow = builder.fptrunc(args[2], ir.VectorType(ir.FloatType(), value.count))
        _write(builder, narrow, _address(context, builder, array, args[0], args[1]), 4)
        return context.get_dummy_value()

    return types.void(array, types.int64, value), generate


@intrinsic
def gather(_, array, rows, row, columns, column):
    """`array[rows[row + k] + columns[column + k]]` in every lane k."""
    lanes = KINDS[array.dtype]

    def generate(context, builder, signature, args):
        offsets = ir.VectorType(ir.IntType(64), lanes.count)
        at = []
        for index, first in ((rows, args[1:3]), (columns, args[3:5])):
            at.append(_read(builder, offsets, _address(context, builder, index, *first), 8))
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
def fill_pair(_, number):
    """A double in sixteen lanes."""
    return PAIRS(number), lambda context, builder, signature, args: _splat(builder, _vector(PAIRS), args[0])


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
def rough_root(_, value):
    """The square root of eight doubles, computed in single precision."""

    def generate(context, builder, signature, args):
        singles = ir.VectorType(ir.FloatType(), WIDTH)
        kind, name = ir.FunctionType(singles, [singles]), f"llvm.sqrt.v{WIDTH}f32"
        square = cgutils.get_or_insert_function(builder.module, kind, name)
        result = builder.call(square, [builder.fptrunc(args[0], singles)])
        return builder.fpext(result, args[0].type)

    return value(value), generate


@intrinsic
def turn(_, source, froms, first, target, tos, second):
    """Read eight vectors, the k-th at froms[k] + first, and write them, turned, the k-th at tos[k] + second."""

    def generate(context, builder, signature, args):
        eights = ir.VectorType(ir.DoubleType(), WIDTH)

        def place(kinds, array, index, offset, k):
            number = builder.load(_address(context, builder, kinds[1], index, ir.Constant(ir.IntType(64), k)))
            return _address(context, builder, kinds[0], array, builder.add(number, offset))

        values = [_read(builder, eights, place((source, froms), args[0], args[1], args[2], k), 8) for k in range(WIDTH)]
        for step in (1, 2, 4):  # exchange halves of pairs that lie `step` apart
            values = _exchange(builder, values, step)
        for k, value in enumerate(values):
            _write(builder, value, place((target, tos), args[3], args[4], args[5], k), 8)
        return context.get_dummy_value()

    return types.void(source, froms, types.int64, target, tos, types.int64), generate


def _exchange(builder, values, step):
    result = list(values)
    for k in range(WIDTH):
        if not k & step:
            low, high = values[k], values[k + step]
            for to, shift in ((k, 0), (k + step, step)):
                lanes = [(i & ~step) + shift + (WIDTH if i & step else 0) for i in range(WIDTH)]
                result[to] = builder.shuffle_vector(low, high, ir.Constant(ir.VectorType(ir.IntType(32), 8), lanes))
    return result


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
def bring(values, first, steps, out):
    """Bring rows of a matrix into the lanes: lane k gets the one that begins at first[k], or the only one there is.

    There are eight lanes, or some eights; `steps` tells where in `out` eight successive vectors begin.
    """
    rows, columns = values.shape
    flat, lanes, whole = values.ravel(), first.size, columns & -8
    if rows == 1:
        for i in range(columns):
            for k in range(lanes):
                out[lanes * i + k] = flat[i]
        return
    for s in range(0, lanes, WIDTH):
        each = first[s : s + WIDTH]
        for i in range(0, whole, WIDTH):
            turn(flat, each, i, out, steps, lanes * i + s)
        for i in range(whole, columns):
            for k in range(WIDTH):
                out[lanes * i + s + k] = flat[each[k] + i]


@njit(error_model="numpy", cache=True)
def put(lanes, steps, values, first):
    """Write what is in lane k to the row of a matrix that begins at first[k]."""
    columns, flat = values.shape[1], values.ravel()
    whole = columns & -8
    for i in range(0, whole, WIDTH):
        turn(lanes, steps, WIDTH * i, flat, first, i)
    for i in range(whole, columns):
        for k in range(WIDTH):
            flat[first[k] + i] = lanes[WIDTH * i + k]
