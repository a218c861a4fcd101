"""Eight samples of a row against one small triangle, written in vector instructions.

Left to itself the compiler unrolls a loop over eight samples into scalar code, 1.5 times slower than no vectors at
all; so the vectors are spelt out, in LLVM's own terms: any processor runs them, in as many pieces as it needs.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8

_I32, _I64, _F32 = ir.IntType(32), ir.IntType(64), ir.FloatType()


def _vector(kind: Any) -> Any:
    return ir.VectorType(kind, LANES)


def _every(builder: Any, value: Any) -> Any:
    """A vector with the same value in all lanes."""
    kind = _vector(value.type)
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, empty, ir.Constant(_vector(_I32), [0] * LANES))


def _constant(kind: Any, value: Any) -> Any:
    return ir.Constant(_vector(kind), [value] * LANES)


def _ordered_keys(builder: Any, z: Any, tag: Any) -> Any:
    """`rasterise_key.key_of` of eight depths."""
    bits = builder.bitcast(builder.fadd(z, _constant(_F32, 0.0)), _vector(_I32))
    mirror = builder.and_(builder.ashr(bits, _constant(_I32, 31)), _constant(_I32, 0x7FFFFFFF))
    high = builder.shl(builder.sext(builder.xor(bits, mirror), _vector(_I64)), _constant(_I64, 32))
    return builder.or_(high, _every(builder, tag))


def _generate(context: Any, builder: Any, signature: Any, arguments: Any, limited: bool) -> Any:
    keys, behind, row, column, tag = arguments[:5]
    eb, ec, area, right_b, right_c, bias_a, bias_b, bias_c, az, zb, zc = (_every(builder, a) for a in arguments[5:])

    def place(number: int, kind: Any) -> Any:
        array = context.make_array(signature.args[number])(context, builder, (keys, behind)[number])
        item = cgutils.get_item_pointer(
            context, builder, signature.args[number], array, [row, column], wraparound=False
        )
        return builder.bitcast(item, _vector(kind).as_pointer())

    steps = ir.Constant(_vector(_F32), [float(k) for k in range(LANES)])
    eb = builder.fadd(eb, builder.fmul(right_b, steps))
    ec = builder.fadd(ec, builder.fmul(right_c, steps))
    ea = builder.fsub(builder.fsub(area, eb), ec)
    zero = _constant(_F32, 0.0)
    chosen = builder.fcmp_ordered(">=", builder.fadd(ea, bias_a), zero)
    chosen = builder.and_(chosen, builder.fcmp_ordered(">=", builder.fadd(eb, bias_b), zero))
    chosen = builder.and_(chosen, builder.fcmp_ordered(">=", builder.fadd(ec, bias_c), zero))
    z = builder.fadd(az, builder.fadd(builder.fmul(eb, zb), builder.fmul(ec, zc)))
    if limited:
        limits = builder.load(place(1, _F32), align=4)
        chosen = builder.and_(chosen, builder.fcmp_ordered(">", z, limits))
    target = place(0, _I64)
    old = builder.load(target, align=8)
    new = _ordered_keys(builder, z, tag)
    chosen = builder.and_(chosen, builder.icmp_signed("<", new, old))
    builder.store(builder.select(chosen, new, old), target, align=8)
    return context.get_dummy_value()


_ARGUMENTS = """keys, behind, row, column: (h, w) int64, (h, w) float32 and where the eight samples begin.
tag: int64 triangle. eb, ec: float32 edge functions at the first sample, exact; area: ea + eb + ec; right_b, right_c:
their steps; bias_a, bias_b, bias_c: what makes samples on edges that are not owned negative.
az, zb, zc: z = az + (eb zb + ec zc)."""


@intrinsic
def draw_lanes(  # type: ignore[no-untyped-def]
    context, keys, behind, row, column, tag, eb, ec, area, right_b, right_c, bias_a, bias_b, bias_c, az, zb, zc
):
    """Puts the triangle's key where it is inside and nearer."""
    given = (keys, behind, row, column, tag, eb, ec, area, right_b, right_c, bias_a, bias_b, bias_c, az, zb, zc)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _generate(context, builder, signature, arguments, limited=False)

    return types.void(*given), generate


@intrinsic
def draw_lanes_behind(  # type: ignore[no-untyped-def]
    context, keys, behind, row, column, tag, eb, ec, area, right_b, right_c, bias_a, bias_b, bias_c, az, zb, zc
):
    """As `draw_lanes`, only where z is more than `behind`."""
    given = (keys, behind, row, column, tag, eb, ec, area, right_b, right_c, bias_a, bias_b, bias_c, az, zb, zc)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _generate(context, builder, signature, arguments, limited=True)

    return types.void(*given), generate
