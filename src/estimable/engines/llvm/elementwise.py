"""What is done to arrays entry by entry."""

from ..program.arrays import Operation
from ..program.straight_line import UnsupportedError
from .blocks import Blocks, Value, number
from .moves import stretched
from .scalars import ARITHMETIC, COMPARE, INTRINSICS, LOGIC

INTEGER = {"add", "sub", "mul"}
INTEGER_COMPARE = {"eq": "eq", "ne": "ne", "lt": "slt", "le": "sle", "gt": "sgt", "ge": "sge"}
CONVERT = {
    ("i1", "double"): "uitofp i1 {} to double", ("i1", "i64"): "zext i1 {} to i64", ("i64", "i1"): "icmp ne i64 {}, 0",
    ("i64", "double"): "sitofp i64 {} to double", ("double", "i64"): "call i64 @llvm.fptosi.sat.i64.f64(double {})",
    ("double", "i1"): "fcmp une double {}, 0.0",
}  # fmt: skip
TRUTHS = {"lt": "icmp ult", "le": "icmp ule", "gt": "icmp ugt", "ge": "icmp uge", "max": "or", "min": "and"}
COMPOSED = {"select_n", "convert_element_type", "integer_pow", "square", "rsqrt", "sign"}
ENTRIES = (
    {*ARITHMETIC, *LOGIC, *COMPARE, *INTRINSICS, "neg", "not", "is_finite", "max", "min"} - {"truncate"}
) | COMPOSED


def each(blocks: Blocks, operation: Operation, values: list[Value]) -> Value:
    """The operation entry by entry, computed where an entry is read; axes of length one, and scalars, are stretched."""
    kinds, shape = [value.kind for value in values], operation.shape
    alike = [stretched(blocks, v, shape, range(len(shape) - len(v.shape), len(shape))) for v in values]
    entry = _composed if operation.name in COMPOSED else _simple
    return Value(
        shape, operation.kind, lambda index: entry(blocks, operation, kinds, [v.at(index) for v in alike]), work=True
    )


def scalar(blocks: Blocks, name: str, kinds: list[str], names: list[str]) -> str:
    """One operation on scalars, of numbers or truths or whole numbers."""
    if name in TRUTHS and set(kinds) == {"i1"}:
        return blocks.assign(f"{TRUTHS[name]} i1 {names[0]}, {names[1]}")
    if "i64" not in kinds:
        return blocks.scalars.operation(name, names, ["truth" if k == "i1" else "number" for k in kinds], blocks.lines)
    if name in INTEGER:
        return blocks.assign(f"{name} i64 {names[0]}, {names[1]}")
    if name in INTEGER_COMPARE:
        return blocks.assign(f"icmp {INTEGER_COMPARE[name]} i64 {names[0]}, {names[1]}")
    if name in ("max", "min"):
        first = blocks.assign(f"icmp {'sgt' if name == 'max' else 'slt'} i64 {names[0]}, {names[1]}")
        return blocks.assign(f"select i1 {first}, i64 {names[0]}, i64 {names[1]}")
    if name == "neg":
        return blocks.assign(f"sub i64 0, {names[0]}")
    raise UnsupportedError(f"the primitive {name} of whole numbers")


def _simple(blocks: Blocks, operation: Operation, kinds: list[str], names: list[str]) -> str:
    return scalar(blocks, operation.name, kinds, names)


def _composed(blocks: Blocks, operation: Operation, kinds: list[str], names: list[str]) -> str:
    """An entry of what LLVM has no single word for."""
    name, kind = operation.name, operation.kind
    if name == "select_n":
        return _chosen(blocks, kinds, names)
    if name == "convert_element_type":
        blocks.scalars.declared.add("declare i64 @llvm.fptosi.sat.i64.f64(double)")
        return blocks.assign(CONVERT[kinds[0], kind].format(names[0]))
    if name == "sign":
        return _sign(blocks, kind, names[0])
    one = number(kind, 1)
    if name == "rsqrt":
        return scalar(blocks, "div", [kind] * 2, [one, scalar(blocks, "sqrt", [kind], names)])
    return _power(blocks, kind, names[0], 2 if name == "square" else operation.value["y"])


def _chosen(blocks: Blocks, kinds: list[str], names: list[str]) -> str:
    """JAX's choice: the first for false, the second for true."""
    if len(names) != 3 or kinds[0] != "i1":
        raise UnsupportedError("a selection among more than two")
    which, no, yes = names
    return blocks.assign(f"select i1 {which}, {kinds[2]} {yes}, {kinds[1]} {no}")


def _power(blocks: Blocks, kind: str, base: str, exponent: int) -> str:
    power = base if exponent else number(kind, 1)
    for _ in range(abs(exponent) - 1):
        power = scalar(blocks, "mul", [kind] * 2, [power, base])
    return power if exponent >= 0 else scalar(blocks, "div", [kind] * 2, [number(kind, 1), power])


def _sign(blocks: Blocks, kind: str, value: str) -> str:
    if kind != "double":
        raise UnsupportedError("the sign of whole numbers")
    sides = [blocks.assign(f"fcmp {side} double {value}, 0.0") for side in ("ogt", "olt")]
    sign = scalar(blocks, "sub", [kind] * 2, [blocks.assign(f"uitofp i1 {side} to double") for side in sides])
    undefined = blocks.assign(f"fcmp uno double {value}, {value}")
    return blocks.assign(f"select i1 {undefined}, double {value}, double {sign}")
