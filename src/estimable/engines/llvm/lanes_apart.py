"""Runs side by side whose arrays lie apart, as they came: each number of a row is gathered from them, or scattered to them."""

from .scalars import Scalars

ALIGNED = {"double": 8, "i64": 8, "i8": 1}


class Apart(Scalars):
    """Scalars of which each lane has memory of its own: what `base` points to lies there where `base.0`, `base.1`, .. point.

    A number that is written of the last row only is held in a register until then.
    """

    def load(self, name: int, base: str, entry: int, kind: str, lines: list[str]) -> str:
        """The scalar `name` from an entry of what `base` points to."""
        if kind == "double":
            return self.from_memory(name, self.read(base, entry, lines), lines)
        return self.assign(
            f"icmp ne <{self.lanes} x i8> {self._gather(base, entry, kind, lines)}, zeroinitializer", lines
        )

    def read(self, base: str, entry: int, lines: list[str]) -> str:
        """The number at an entry of what `base` points to."""
        return self._gather(base, entry, "double", lines)

    def write(self, value: str, base: str, entry: int, lines: list[str]) -> None:
        """Write a number to an entry of what `base` points to."""
        if base == "%last":
            lines.append(f"store {self.number} {value}, ptr %last.entry{entry}")
        else:
            self._scatter(value, base, entry, "double", lines)

    def store(self, name: int, value: str, base: str, entry: int, kind: str, lines: list[str]) -> None:
        """Write the scalar `name` to an entry of what `base` points to."""
        if kind == "double":
            self.write(self.in_memory(name, value, lines), base, entry, lines)
            return
        change = f"zext {self.truth}" if self.is_truth(name) else f"fptosi {self.number}"
        self._scatter(self.assign(f"{change} {value} to <{self.lanes} x {kind}>", lines), base, entry, kind, lines)

    def copy(self, base: str, source: int, target: int, kind: str, lines: list[str]) -> None:
        """Write what one entry of what `base` points to holds to another."""
        self._scatter(self._gather(base, source, kind, lines), base, target, kind, lines)

    def row_of(self, name: str, base: str, kind: str, items: int, row: str, lines: list[str]) -> None:
        """`name` points to a row of what `base` points to."""
        offset = self.assign(f"mul i64 {row}, {items}", lines)
        for lane in range(self.lanes):
            lines.append(f"{name}.{lane} = getelementptr inbounds {kind}, ptr {base}.{lane}, i64 {offset}")

    def begin(self, bases: list[str], last: int, lines: list[str]) -> None:
        """Point each base to each lane's own: that of run `first` and those after it, of the last one again beyond it."""
        runs = [self._beyond(lane, lines) for lane in range(self.lanes)]
        for i, base in enumerate(bases):
            at = self.assign(f"getelementptr inbounds i64, ptr %steps, i64 {i}", lines)
            step = self.assign(f"load i64, ptr {at}", lines)
            for lane, run in enumerate(runs):
                bytes_on = self.assign(f"mul i64 {run}, {step}", lines)
                lines.append(f"{base}.{lane} = getelementptr inbounds i8, ptr {base}, i64 {bytes_on}")
        lines += [f"%last.entry{entry} = alloca {self.number}" for entry in range(last)]

    def end(self, last: int, lines: list[str]) -> None:
        """Write what is written of the last row only."""
        for entry in range(last):
            value = self.assign(f"load {self.number}, ptr %last.entry{entry}", lines)
            self._scatter(value, "%last", entry, "double", lines)

    def function(self, bases: list[str], body: str) -> str:
        """The function that runs groups of runs side by side, one group after the other."""
        pointers, apart = (", ".join(f"{kind} {base}" for base in bases) for kind in ("ptr", "ptr noalias"))
        return f"""define internal void @group(i64 %T, i64 %first, i64 %most, ptr %steps, {apart}) {{
{body}
}}
define void @run(i64 %T, i64 %begin, i64 %end, i64 %most, ptr %steps, {pointers}) {{
entry:
  br label %groups
groups:
  %first = phi i64 [%begin, %entry], [%next, %groups]
  call void @group(i64 %T, i64 %first, i64 %most, ptr %steps, {pointers})
  %next = add i64 %first, {self.lanes}
  %more = icmp slt i64 %next, %end
  br i1 %more, label %groups, label %exit
exit:
  ret void
}}
"""

    def _beyond(self, lane: int, lines: list[str]) -> str:
        """The run in a lane."""
        run = self.assign(f"add i64 %first, {lane}", lines)
        inside = self.assign(f"icmp slt i64 {run}, %most", lines)
        return self.assign(f"select i1 {inside}, i64 {run}, i64 %most", lines)

    def _gather(self, base: str, entry: int, kind: str, lines: list[str]) -> str:
        vector = "poison"
        for lane in range(self.lanes):
            place = self._place(base, lane, entry, kind, lines)
            item = self.assign(f"load {kind}, ptr {place}, align {ALIGNED[kind]}", lines)
            vector = self.assign(f"insertelement <{self.lanes} x {kind}> {vector}, {kind} {item}, i64 {lane}", lines)
        return vector

    def _scatter(self, vector: str, base: str, entry: int, kind: str, lines: list[str]) -> None:
        for lane in range(self.lanes):
            place = self._place(base, lane, entry, kind, lines)
            item = self.assign(f"extractelement <{self.lanes} x {kind}> {vector}, i64 {lane}", lines)
            lines.append(f"store {kind} {item}, ptr {place}, align {ALIGNED[kind]}")

    def _place(self, base: str, lane: int, entry: int, kind: str, lines: list[str]) -> str:
        return self.assign(f"getelementptr inbounds {kind}, ptr {base}.{lane}, i64 {entry}", lines)
