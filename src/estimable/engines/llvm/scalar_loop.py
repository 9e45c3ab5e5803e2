"""The loop over time around a straight line of scalars, as LLVM assembly.

Values that are the same in every row are computed before the loop. Values that have become constant (`steady_state`) are not
computed again until something they depend on changes: meanwhile a second loop runs the rest of each row.
"""

from collections.abc import Iterable
from typing import NamedTuple

from ..program.primitives import BOOL, FLOAT
from ..program.steady_state import SteadyPart, same_in_every_row, steady_part
from ..program.straight_line import Program
from .lanes_apart import Apart
from .scalars import Scalars


class RowArray(NamedTuple):
    """An array in memory, row after row: the scalars of a row (-1: not read), `lanes` items each.

    `kind`: "double", words of eight bytes (see `Scalars`); with one lane, or lanes in separate arrays, also "i64" for integers,
    and "i8" for bools.
    """

    names: tuple[int, ...]
    kind: str = "double"


class ScalarLoop(NamedTuple):
    """A program run row by row: its inputs are fixed, carried from row to row, or read from the row.

    Its outputs are the next carry, then those written for each row, then those written for the last row only. `fixed`,
    `carry` and `last` are words in memory. `seek_steady`: whether to detect values that have become constant; if not, nothing
    counts as settled (`kernels/small.settled`). `apart`: the rows of each lane have their own arrays. `counts`: the number of
    entries at the end of the carry that count rows or sum over them, and so never repeat.
    """

    program: Program
    fixed: tuple[int, ...]
    carry: tuple[int, ...]
    row: tuple[RowArray, ...]
    next_carry: tuple[int, ...]
    each: tuple[RowArray, ...]
    last: tuple[int, ...]
    seek_steady: bool = True
    apart: bool = False
    counts: int = 0

    @property
    def has_loops(self) -> bool:
        """Whether there are loops inside a row."""
        return False

    @property
    def bytes(self) -> int:
        """The memory that the function needs in addition to its arrays."""
        return 0

    @property
    def pointers(self) -> int:
        """The number of arrays that the function takes."""
        return 3 + len(self.row) + len(self.each) + self.apart

    @property
    def integers(self) -> int:
        """The number of integers that it takes before them."""
        return 4 if self.apart else 1

    def assembly(self, lanes: int) -> str:
        """The function `run(rows, fixed, carry, last, an array of each of row .., of each ..)`.

        With `apart`: `run(rows, first group, end, last run of all, steps, fixed, carry, ..)`; `steps`: the bytes from run to run
        in each array of rows. `fixed`, `carry` and `last` hold one group after another.
        """
        return _ScalarLoopText(self, lanes).write()


class _ScalarLoopText:
    """The blocks: `entry`; `whole`, row by row; `rest` and `commit` instead of it while a part is steady; `exit`.

    A row of `rest` in which the part changes again returns to `whole` before it writes anything. The carry `i` of a block is
    called `now<i>` before its row and `after<i>` after it, both words. Where a single bool decides whether the part is constant,
    `other<i>` is its value if not, so that a row need not wait for that bool.
    """

    def __init__(self, loop: ScalarLoop, lanes: int):
        self.loop, self.same = loop, same_in_every_row(loop)
        self.scalars = (Apart if loop.apart else Scalars)(loop.program, lanes)
        self.rows = [f"%row{i}" for i in range(len(loop.row))] + [f"%each{i}" for i in range(len(loop.each))]
        part = steady_part(loop, self.same) if loop.seek_steady else None
        self.part = part or SteadyPart(frozenset(), (), ())
        self.carried = range(len(loop.carry))
        self.moving = [i for i in self.carried if i not in self.part.carry]
        self.held = sorted(self.part.carry) if lanes == 1 and self.part.stays is not None else []
        self.places = {name: (i, entry, array.kind) for i, array in enumerate(loop.row)
                       for entry, name in enumerate(array.names) if name >= 0}  # fmt: skip
        self.lines: list[str] = []

    def write(self) -> str:
        names = self._entry()
        names = self._whole(names)
        if self.part.carry:
            self._rest(names)
        self._exit()
        body = "\n".join(line if line.endswith(":") else f"  {line}" for line in self.lines)
        sizes = [len(names) for names in (self.loop.fixed, self.loop.carry, self.loop.last)]
        return "\n".join([*sorted(self.scalars.declared), self.scalars.function(self.rows, sizes, body)])

    def _entry(self) -> dict[int, str]:
        """The values that are the same in every row, and the first carry."""
        self.lines.append("entry:")
        self.scalars.begin(self.rows, self.lines)
        names = {
            name: self.scalars.load(name, "%fixed", i, "double", self.lines) for i, name in enumerate(self.loop.fixed)
        }
        names = self._compute(names, [name for name, same in enumerate(self.same) if same], "")
        for i in self.carried:
            self._name(f"%entry.after{i}", self.scalars.read("%carry", i, self.lines))
        self.lines.append("br label %whole")
        return names

    def _whole(self, names: dict[int, str]) -> dict[int, str]:
        """A whole row; the names of its scalars."""
        word = self.scalars.float
        back = [(f"%whole.now{i}" if i in self.part.carry else f"%rest.now{i}", "%rest") for i in self.carried]
        back = back if self.part.carry else []
        self.lines.append("whole:")
        came = ("0", "%entry"), ("%whole.next", "%again"), *([("%rest.row", "%rest")] if back else [])
        self._phi("%whole.row", "i64", *came)
        for i in self.carried:
            again = f"%whole.{'other' if i in self.held else 'after'}{i}"
            came = (f"%entry.after{i}", "%entry"), (again, "%again"), *back[i : i + 1]
            self._phi(f"%whole.now{i}", word, *came)
        names = self._carry(names, "whole", list(self.carried))
        names = self._compute(names, range(len(self.same)), "whole")
        self._put(names, "whole", [i for i in self.carried if i not in self.held])
        for i in self.held:
            other = self.loop.program.operations[self.loop.next_carry[i]].arguments[2]
            self._name(f"%whole.other{i}", self.scalars.in_memory(other, names[other], self.lines))
        self.lines += ["br i1 %whole.more, label %again, label %done", "again:"]
        self.lines.append(f"br i1 {self._is_steady(names)}, label %rest, label %whole" if back else "br label %whole")
        self.lines.append("done:")
        for i in self.held:
            after = self.loop.next_carry[i]
            self._name(f"%whole.after{i}", self.scalars.in_memory(after, names[after], self.lines))
        self.lines.append("br label %exit")
        return names

    def _is_steady(self, names: dict[int, str]) -> str:
        """Whether the part that can become steady is steady."""
        if self.part.stays is not None and self.held:
            return names[self.part.stays]
        pairs = [(f"%whole.now{i}", f"%whole.after{i}") for i in sorted(self.part.carry)]
        return self.scalars.all_equal(pairs, FLOAT, self.lines)

    def _rest(self, whole: dict[int, str]) -> None:
        """A row without its steady part, while the choices that this part depends on are unchanged."""
        self.lines.append("rest:")
        self._phi("%rest.row", "i64", ("%whole.next", "%again"), ("%rest.next", "%commit"))
        for i in self.moving:
            self._phi(
                f"%rest.now{i}", self.scalars.float, (f"%whole.after{i}", "%again"), (f"%rest.after{i}", "%commit")
            )
        names = {name: whole[name] for name, slow in enumerate(self.part.slow) if slow or self.same[name]}
        names = self._carry(names, "rest", self.moving)
        names = self._compute(names, range(len(self.same)), "rest")
        holds = self.scalars.all_equal([(whole[c], names[c]) for c in self.part.choices], BOOL, self.lines)
        self.lines += [f"br i1 {holds}, label %commit, label %whole", "commit:"]
        self._put(names, "rest", self.moving)
        self.lines.append("br i1 %rest.more, label %rest, label %exit")

    def _exit(self) -> None:
        self.lines.append("exit:")
        for i in self.carried:
            rest = (f"%rest.after{i}" if i in self.moving else f"%whole.now{i}", "%commit")
            came = (f"%whole.after{i}", "%done"), *([rest] if self.part.carry else [])
            self._phi(f"%end{i}", self.scalars.float, *came)
        for i in self.carried:
            self.scalars.write(f"%end{i}", "%carry", i, self.lines)
        self.lines.append("ret void")

    def _phi(self, name: str, kind: str, *came: tuple[str, str]) -> None:
        """A value that depends on the block that came before: (value, block) of each."""
        self.lines.append(f"{name} = phi {kind} " + ", ".join(f"[{value}, {block}]" for value, block in came))

    def _name(self, name: str, value: str) -> None:
        """Give a word a predefined name."""
        self.lines.append(f"{name} = bitcast {self.scalars.float} {value} to {self.scalars.float}")

    def _carry(self, names: dict[int, str], block: str, carried: list[int]) -> dict[int, str]:
        """The names, extended by the scalars carried into this block, and pointers to its row in each array."""
        names = dict(names)
        for i in carried:
            names[self.loop.carry[i]] = self.scalars.from_memory(self.loop.carry[i], f"%{block}.now{i}", self.lines)
        for i, array in enumerate(self.loop.row):
            self.scalars.row_of(
                f"%{block}.row{i}", f"%row{i}", array.kind, len(array.names), f"%{block}.row", self.lines
            )
        return names

    def _compute(self, names: dict[int, str], wanted: Iterable[int], block: str) -> dict[int, str]:
        """The names, extended by the wanted scalars without names, which are read or computed here, in order."""
        names = dict(names)
        for name in wanted:
            if name in names:
                continue
            if name in self.places:
                i, entry, kind = self.places[name]
                names[name] = self.scalars.load(name, f"%{block}.row{i}", entry, kind, self.lines)
            elif self.loop.program.operations[name].name == "settles" and not self.loop.seek_steady:
                names[name] = self.scalars.constant(False)
            else:
                names[name] = self.scalars.define(name, names, self.lines)
        return names

    def _put(self, names: dict[int, str], block: str, carried: list[int]) -> None:
        """Write the outputs of a row and continue with the next; the steady part is copied from the previous row."""
        steady = self.part.slow if block == "rest" else [False] * len(self.same)
        for i, array in enumerate(self.loop.each):
            self.scalars.row_of(
                f"%{block}.each{i}", f"%each{i}", array.kind, len(array.names), f"%{block}.row", self.lines
            )
            for entry, name in enumerate(array.names):
                if steady[name]:
                    self.scalars.copy(f"%{block}.each{i}", entry - len(array.names), entry, array.kind, self.lines)
                else:
                    self.scalars.store(name, names[name], f"%{block}.each{i}", entry, array.kind, self.lines)
        for i, name in enumerate(self.loop.last):
            if not steady[name]:
                self.scalars.store(name, names[name], "%last", i, "double", self.lines)
        for i in carried:
            name = self.loop.next_carry[i]
            self._name(f"%{block}.after{i}", self.scalars.in_memory(name, names[name], self.lines))
        self.lines.append(f"%{block}.next = add i64 %{block}.row, 1")
        self.lines.append(f"%{block}.more = icmp slt i64 %{block}.next, %T")
