"""Runs side by side with rows in separate arrays: each number of a row is gathered from them, or scattered to them."""

from .scalars import Scalars

ALIGNED = {"double": 8, "i64": 8, "i8": 1}
TOGETHER = ("%fixed", "%carry", "%last")


class Apart(Scalars):
    """Scalars with rows in separate arrays: each lane of such a `base` is at `base.0`, `base.1`, .."""

    def load(self, name: int, base: str, entry: int, kind: str, lines: list[str]) -> str:
        """The scalar `name` from an entry of `base`."""
        if base in TOGETHER:
            return super().load(name, base, entry, kind, lines)
        vector = self._gather(base, entry, kind, lines)
        if kind == "double":
            return self.from_memory(name, vector, lines)
        return self.assign(f"icmp ne <{self.lanes} x i8> {vector}, zeroinitializer", lines)

    def store(self, name: int, value: str, base: str, entry: int, kind: str, lines: list[str]) -> None:
        """Write the scalar `name` to an entry of `base`."""
        if base in TOGETHER:
            super().store(name, value, base, entry, kind, lines)
            return
        if kind == "double":
            value = self.in_memory(name, value, lines)
        elif kind == "i8":
            value = self.assign(f"zext {self.bool} {value} to <{self.lanes} x i8>", lines)
        self._scatter(value, base, entry, kind, lines)

    def copy(self, base: str, source: int, target: int, kind: str, lines: list[str]) -> None:
        """Copy one entry of `base` to another."""
        self._scatter(self._gather(base, source, kind, lines), base, target, kind, lines)

    def row_of(self, name: str, base: str, kind: str, items: int, row: str, lines: list[str]) -> None:
        """Point `name` to a row of `base`."""
        offset = self.assign(f"mul i64 {row}, {items}", lines)
        for lane in range(self.lanes):
            lines.append(f"{name}.{lane} = getelementptr inbounds {kind}, ptr {base}.{lane}, i64 {offset}")

    def begin(self, rows: list[str], lines: list[str]) -> None:
        """Point each array of rows to the array of each lane, from run `first` on; the last run repeats beyond the end."""
        runs = [self._run(lane, lines) for lane in range(self.lanes)]
        for i, base in enumerate(rows):
            at = self.assign(f"getelementptr inbounds i64, ptr %steps, i64 {i}", lines)
            step = self.assign(f"load i64, ptr {at}", lines)
            for lane, run in enumerate(runs):
                on = self.assign(f"mul i64 {run}, {step}", lines)
                lines.append(f"{base}.{lane} = getelementptr inbounds i8, ptr {base}, i64 {on}")

    def function(self, rows: list[str], sizes: list[int], body: str) -> str:
        """The function that runs groups of runs in order."""
        given, apart = (", ".join(f"{kind} {base}" for base in (*TOGETHER, *rows)) for kind in ("ptr", "ptr noalias"))
        moved = "\n".join(
            f"  {base}.here = getelementptr inbounds [{size} x {self.float}], ptr {base}, i64 %group"
            for base, size in zip(TOGETHER, sizes, strict=True)
        )
        here = ", ".join([*(f"ptr {base}.here" for base in TOGETHER), *(f"ptr {base}" for base in rows)])
        return f"""define internal void @group(i64 %T, i64 %first, i64 %most, ptr %steps, {apart}) {{
{body}
}}
define void @run(i64 %T, i64 %begin, i64 %end, i64 %most, ptr %steps, {given}) {{
entry:
  br label %groups
groups:
  %group = phi i64 [%begin, %entry], [%next, %groups]
  %first = mul i64 %group, {self.lanes}
{moved}
  call void @group(i64 %T, i64 %first, i64 %most, ptr %steps, {here})
  %next = add i64 %group, 1
  %more = icmp slt i64 %next, %end
  br i1 %more, label %groups, label %exit
exit:
  ret void
}}
"""

    def _run(self, lane: int, lines: list[str]) -> str:
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
