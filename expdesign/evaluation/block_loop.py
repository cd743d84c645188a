"""LLVM code of the loop over blocks of samples, one sample to a lane.

Arrays hold the elements of one sample side by side, rows of lanes the same element of all samples
of a block: numbers are copied one by one, which takes little of the time.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

ENTRY = "evaluate"
"""Name of the function that evaluates all samples: see `vector_code`."""


@dataclass(frozen=True)
class Lanes:
    """Number of samples that are evaluated together; as text, the type of their vector."""

    count: int

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


_COPY = """define private void @{name}(
  ptr %rows, ptr %array, ptr %places, i64 %elements, i64 %size, i64 %first, i64 %count
) {{
entry:
  %last = sub i64 %count, 1"""
_SAMPLE = """  %wanted{k} = add i64 %first, {k}
  %sample{k} = call i64 @llvm.umin.i64(i64 %wanted{k}, i64 %last)
  %start{k} = mul i64 %sample{k}, %size
  %at{k} = getelementptr double, ptr %array, i64 %start{k}"""
_ELEMENT = """  br label %element
element:
  %e = phi i64 [0, %entry], [%next, %element]
  %row = getelementptr {lanes}, ptr %rows, i64 %e
  %listed = getelementptr i64, ptr %places, i64 %e
  %place = load i64, ptr %listed"""
_NUMBER = """  %of_array{k} = getelementptr double, ptr %at{k}, i64 %place
  %of_row{k} = getelementptr double, ptr %row, i64 {k}
  %number{k} = load double, ptr %of_{source}{k}
  store double %number{k}, ptr %of_{target}{k}"""
_COPIED = """  %next = add i64 %e, 1
  %all = icmp eq i64 %next, %elements
  br i1 %all, label %out, label %element
out:
  ret void
}"""


def _copy_function(name: str, source: str, target: str, lanes: Lanes) -> list[str]:
    """Return a function that copies the elements at some places of a block's samples.

    Source and target are ``array`` and ``row``. The last sample fills an incomplete block.
    """
    every = range(lanes.count)
    return [
        _COPY.format(name=name),
        *(_SAMPLE.format(k=k) for k in every),
        _ELEMENT.format(lanes=lanes),
        *(_NUMBER.format(k=k, source=source, target=target) for k in every),
        _COPIED,
    ]


_HEAD = """define void @{entry}(
  ptr %varying, ptr %fixed, ptr %results, i64 %count, ptr %scratch
) {{
entry:
  %outputs = getelementptr {lanes}, ptr %scratch, i64 {outputs}
  %work = getelementptr {lanes}, ptr %scratch, i64 {work}
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
    """
    copied = [
        *(("gather", "%varying", k, range(size), size) for k, size in enumerate(inputs)),
        *(("scatter", "%results", k, row, sizes[k]) for k, row in enumerate(places)),
    ]
    starts = list(accumulate((len(row) for *_, row, _ in copied), initial=0))
    lines = ["declare i64 @llvm.umin.i64(i64, i64)"]
    calls: dict[str, list[str]] = {"gather": [], "scatter": []}
    for (name, arrays, k, row, size), start in zip(copied, starts, strict=False):
        if row:
            own, listed = f"{name}{k}", ", ".join(f"i64 {place}" for place in row)
            lines.append(f"@{own} = private constant [{len(row)} x i64] [{listed}]")
            calls[name] += [
                f"  %of_{own} = getelementptr ptr, ptr {arrays}, i64 {k}",
                f"  %array_{own} = load ptr, ptr %of_{own}",
                f"  %rows_{own} = getelementptr {lanes}, ptr %scratch, i64 {start}",
                f"  call void @{name}(ptr %rows_{own}, ptr %array_{own}, ptr @{own}, "
                f"i64 {len(row)}, i64 {size}, i64 %first, i64 %count)",
            ]
    given = "ptr %scratch, ptr %fixed, ptr %outputs, ptr %work"
    return [
        *lines,
        *_copy_function("gather", "array", "row", lanes),
        *_copy_function("scatter", "row", "array", lanes),
        _HEAD.format(entry=ENTRY, lanes=lanes, outputs=starts[len(inputs)], work=starts[-1]),
        *calls["gather"],
        *(f"  call void @part{k}({given})" for k in range(parts)),
        *calls["scatter"],
        _TAIL.format(count=lanes.count),
    ]
