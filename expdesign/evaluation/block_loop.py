"""LLVM code of the loop over blocks of samples, one sample to a lane.

Arrays hold the elements of one sample side by side, vectors the same element of all samples:
between them small square matrices are transposed in the processor's registers.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate

ENTRY = "evaluate"
"""Name of the function that evaluates all samples: see `vector_code`."""


@dataclass(frozen=True)
class Lanes:
    """Number of samples that are evaluated together; as text, the type of their vector."""

    count: int
    """A power of two."""

    def __str__(self) -> str:
        return f"<{self.count} x double>"

    @property
    def mask(self) -> str:
        """Type of a vector of conditions."""
        return f"<{self.count} x i1>"

    @property
    def bytes(self) -> int:
        """Size of the vector."""
        return 8 * self.count

    def constant(self, value: float) -> str:
        """Return a vector of equal numbers."""
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return f"<{', '.join([f'double 0x{bits:016X}'] * self.count)}>"

    def transpose(self, rows: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return instructions that transpose as many vectors as there are lanes, and their names.

        Blocks off the diagonal are exchanged: those of half the size, of a quarter, and so on.
        """
        lines: list[str] = []
        now, step = list(rows), self.count // 2
        while step:
            for low in (k for k in range(self.count) if not k & step):
                pair = f"{self} {now[low]}, {self} {now[low + step]}"
                for side in (0, 1):
                    places = [
                        (j & ~step) + step * side + (self.count if j & step else 0)
                        for j in range(self.count)
                    ]
                    listed = ", ".join(f"i32 {place}" for place in places)
                    name = f"%t{step}_{low + side * step}"
                    now[low + side * step] = name
                    lines.append(
                        f"  {name} = shufflevector {pair}, <{self.count} x i32> <{listed}>"
                    )
            step //= 2
        return lines, now


def _copy_function(name: str, parameters: str, body: Sequence[str], lanes: Lanes) -> list[str]:
    """Return a function that copies groups of as many elements as there are lanes.

    The last sample fills an incomplete group. `body` has the instructions for the group with the
    number ``%g``, with the address of each lane's sample, ``%at0``, ….
    """
    lines = [
        f"define private void @{name}(",
        f"  ptr %rows, ptr %array, i64 %first, i64 %count, i64 %size, i64 %groups, {parameters}",
        ") {",
        "entry:",
        "  %last = sub i64 %count, 1",
    ]
    for k in range(lanes.count):
        lines += [
            f"  %wanted{k} = add i64 %first, {k}",
            f"  %sample{k} = call i64 @llvm.umin.i64(i64 %wanted{k}, i64 %last)",
            f"  %start{k} = mul i64 %sample{k}, %size",
            f"  %at{k} = getelementptr double, ptr %array, i64 %start{k}",
        ]
    return [
        *lines,
        "  br label %group",
        "group:",
        "  %g = phi i64 [0, %entry], [%next, %group]",
        *body,
        "  %next = add i64 %g, 1",
        "  %all = icmp eq i64 %next, %groups",
        "  br i1 %all, label %out, label %group",
        "out:",
        "  ret void",
        "}",
    ]


def _gather_function(lanes: Lanes) -> list[str]:
    """Return the function that copies elements of an input into lanes.

    The last group overlaps the one before; that of an input with fewer elements than lanes extends
    into the rows of the next input, which is copied after it.
    """
    every = range(lanes.count)
    body = [
        f"  %next_first = mul i64 %g, {lanes.count}",
        "  %element = call i64 @llvm.umin.i64(i64 %next_first, i64 %highest)",
    ]
    for k in every:
        body += [
            f"  %from{k} = getelementptr double, ptr %at{k}, i64 %element",
            f"  %of_lane{k} = load {lanes}, ptr %from{k}, align 8",
        ]
    turned, found = lanes.transpose([f"%of_lane{k}" for k in every])
    body += turned
    for j in every:
        body += [
            f"  %row{j} = add i64 %element, {j}",
            f"  %to{j} = getelementptr {lanes}, ptr %rows, i64 %row{j}",
            f"  store {lanes} {found[j]}, ptr %to{j}, align {lanes.bytes}",
        ]
    return _copy_function("gather", "i64 %highest", body, lanes)


def _scatter_function(lanes: Lanes) -> list[str]:
    """Return the function that copies rows of lanes to elements of an output.

    Each group has a row in the table: the row of each of its elements, and the first element.
    """
    every, width = range(lanes.count), lanes.count + 1
    body = [
        f"  %in_table = mul i64 %g, {width}",
        "  %listed = getelementptr i64, ptr %table, i64 %in_table",
    ]
    for j in every:
        body += [
            f"  %row_at{j} = getelementptr i64, ptr %listed, i64 {j}",
            f"  %row{j} = load i64, ptr %row_at{j}",
            f"  %from{j} = getelementptr {lanes}, ptr %rows, i64 %row{j}",
            f"  %of_element{j} = load {lanes}, ptr %from{j}, align {lanes.bytes}",
        ]
    turned, found = lanes.transpose([f"%of_element{j}" for j in every])
    body += [
        *turned,
        f"  %element_at = getelementptr i64, ptr %listed, i64 {lanes.count}",
        "  %element = load i64, ptr %element_at",
    ]
    for k in every:
        body += [
            f"  %to{k} = getelementptr double, ptr %at{k}, i64 %element",
            f"  store {lanes} {found[k]}, ptr %to{k}, align 8",
        ]
    return _copy_function("scatter", "ptr %table", body, lanes)


def _table_rows(
    places: Sequence[int], size: int, start: int, zero: int, lanes: Lanes
) -> Iterator[list[int]]:
    """Yield the rows of an output's table, see `_scatter_function`, without groups of zeros.

    The last group overlaps the one before; that of an output with fewer elements than lanes
    extends into the next sample, which is written after it.
    """
    rows = {place: start + k for k, place in enumerate(places)}
    last = max(0, size - lanes.count)
    firsts = [*range(0, last, lanes.count), last]
    for first in firsts:
        row = [rows.get(first + j, zero) for j in range(lanes.count)]
        if row != [zero] * lanes.count:
            yield [*row, first]


_HEAD = """define void @{entry}(
  ptr %varying, ptr %fixed, ptr %results, i64 %count, ptr %scratch
) {{
entry:
  %outputs = getelementptr {lanes}, ptr %scratch, i64 {outputs}
  %work = getelementptr {lanes}, ptr %scratch, i64 {work}
  %nothing = getelementptr {lanes}, ptr %scratch, i64 {zero}
  store {lanes} zeroinitializer, ptr %nothing, align {bytes}
  br label %block
block:
  %first = phi i64 [0, %entry], [%next, %block]"""
_TAIL = """  %next = add i64 %first, {count}
  %end = icmp uge i64 %next, %count
  br i1 %end, label %out, label %block
out:
  ret void
}}"""


def block_loop(
    inputs: Sequence[int],
    parts: int,
    places: Sequence[Sequence[int]],
    sizes: Sequence[int],
    work: int,
    lanes: Lanes,
) -> list[str]:
    """Return the text of `ENTRY`, which calls functions ``@part0``, … for block after block.

    Parameters
    ----------
    inputs : sequence of int
        Elements of each varying input.
    parts : int
        Number of functions that are called, one after the other.
    places, sizes, lanes
        See `vector_code`.
    work : int
        Rows of the functions' working memory.
    """
    starts = list(accumulate(inputs, initial=0))
    ends = list(accumulate((len(row) for row in places), initial=starts[-1]))
    # Behind everything that gathering an input with few elements overwrites.
    zero = ends[-1] + work + lanes.count
    tables = [
        list(_table_rows(row, size, start, zero, lanes))
        for start, row, size in zip(ends, places, sizes, strict=False)
    ]
    lines = []
    for k, table in enumerate(tables):
        numbers = [f"i64 {number}" for row in table for number in row]
        if numbers:
            listed = ", ".join(numbers)
            lines.append(f"@table{k} = private constant [{len(numbers)} x i64] [{listed}]")
    lines += [
        "declare i64 @llvm.umin.i64(i64, i64)",
        *_gather_function(lanes),
        *_scatter_function(lanes),
    ]
    lines.append(
        _HEAD.format(
            entry=ENTRY,
            lanes=lanes,
            bytes=lanes.bytes,
            outputs=starts[-1],
            work=ends[-1],
            zero=zero,
        )
    )
    for k, (start, size) in enumerate(zip(starts, inputs, strict=False)):
        if not size:
            continue
        lines += [
            f"  %from{k} = getelementptr ptr, ptr %varying, i64 {k}",
            f"  %array{k} = load ptr, ptr %from{k}",
            f"  %rows{k} = getelementptr {lanes}, ptr %scratch, i64 {start}",
        ]
        lines.append(
            f"  call void @gather(ptr %rows{k}, ptr %array{k}, i64 %first, i64 %count, "
            f"i64 {size}, i64 {-(-size // lanes.count)}, i64 {max(0, size - lanes.count)})"
        )
    given = "ptr %scratch, ptr %fixed, ptr %outputs, ptr %work"
    lines += [f"  call void @part{k}({given})" for k in range(parts)]
    for k, (table, size) in enumerate(zip(tables, sizes, strict=True)):
        if table:
            lines += [
                f"  %to{k} = getelementptr ptr, ptr %results, i64 {k}",
                f"  %result{k} = load ptr, ptr %to{k}",
                f"  call void @scatter(ptr %scratch, ptr %result{k}, i64 %first, i64 %count, "
                f"i64 {size}, i64 {len(table)}, ptr @table{k})",
            ]
    return [*lines, _TAIL.format(count=lanes.count)]
