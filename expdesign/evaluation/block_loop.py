"""Samples in blocks of `LANES`, in LLVM's language: into lanes, through the functions, and out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

LANES = 8
"""Samples that are evaluated side by side."""
VECTOR = f"<{LANES} x double>"
ENTRY = "evaluate"
"""The function that is called from outside: see `vector_code`."""


def _copying(name: str, parameters: str, samples: str, element: str) -> str:
    """Return a function that goes through all lanes and the elements of each.

    Parameters
    ----------
    samples : str
        Sets ``%lanes``, how many there are.
    element : str
        Copies from or to ``%in_lane``, of element ``%j``; the lane's sample has number ``%sample``.
    """
    return f"""define private void @{name}(
  ptr %rows, ptr %array, i64 %first, i64 %count, i64 %elements, {parameters}
) {{
entry:
{samples}
  br label %lane
lane:
  %k = phi i64 [0, %entry], [%next_k, %done]
  %wanted = add i64 %first, %k
  %last = sub i64 %count, 1
  %sample = call i64 @llvm.umin.i64(i64 %wanted, i64 %last)
  %start = mul i64 %sample, %size
  br label %element
element:
  %j = phi i64 [0, %lane], [%next_j, %element]
  %row = mul i64 %j, {LANES}
  %place_in_lanes = add i64 %row, %k
  %in_lane = getelementptr double, ptr %rows, i64 %place_in_lanes
{element}
  %next_j = add i64 %j, 1
  %all = icmp eq i64 %next_j, %elements
  br i1 %all, label %done, label %element
done:
  %next_k = add i64 %k, 1
  %end = icmp eq i64 %next_k, %lanes
  br i1 %end, label %out, label %lane
out:
  ret void
}}"""


# Into lanes: the last sample stands for those that are missing.
_GATHER = _copying(
    "gather",
    "i64 %size",
    f"  %lanes = add i64 0, {LANES}",
    """  %from = add i64 %start, %j
  %source = getelementptr double, ptr %array, i64 %from
  %value = load double, ptr %source
  store double %value, ptr %in_lane""",
)
_SCATTER = _copying(
    "scatter",
    "i64 %size, ptr %places",
    f"""  %left = sub i64 %count, %first
  %lanes = call i64 @llvm.umin.i64(i64 %left, i64 {LANES})""",
    """  %place_at = getelementptr i64, ptr %places, i64 %j
  %place = load i64, ptr %place_at
  %to = add i64 %start, %place
  %target = getelementptr double, ptr %array, i64 %to
  %value = load double, ptr %in_lane
  store double %value, ptr %target""",
)
_LEAST = "declare i64 @llvm.umin.i64(i64, i64)"

_HEAD = f"""define void @{ENTRY}(
  ptr %varying, ptr %fixed, ptr %results, i64 %count, ptr %scratch
) {{{{
entry:
  %outputs = getelementptr {VECTOR}, ptr %scratch, i64 {{outputs}}
  %work = getelementptr {VECTOR}, ptr %scratch, i64 {{work}}
  br label %block
block:
  %first = phi i64 [0, %entry], [%next, %block]"""
_TAIL = f"""  %next = add i64 %first, {LANES}
  %end = icmp uge i64 %next, %count
  br i1 %end, label %out, label %block
out:
  ret void
}}"""


def block_loop(
    inputs: Sequence[int], parts: int, places: Sequence[Sequence[int]], sizes: Sequence[int]
) -> list[str]:
    """Return the text of `ENTRY`, which calls functions ``@part0``, … for block after block.

    Parameters
    ----------
    inputs : sequence of int
        Elements of each of the inputs that differ from sample to sample.
    parts : int
        How many functions are called, one after the other.
    places, sizes
        See `vector_code`.
    """
    starts = list(accumulate(inputs, initial=0))
    ends = list(accumulate((len(row) for row in places), initial=0))
    lines = [
        f"@places{k} = private constant [{len(row)} x i64] [{', '.join(f'i64 {j}' for j in row)}]"
        for k, row in enumerate(places)
        if len(row)
    ]
    lines += [_LEAST, _GATHER, _SCATTER]
    lines.append(_HEAD.format(outputs=starts[-1], work=starts[-1] + ends[-1]))
    for k, (start, count) in enumerate(zip(starts, inputs, strict=False)):
        if count:
            lines += [
                f"  %from{k} = getelementptr ptr, ptr %varying, i64 {k}",
                f"  %array{k} = load ptr, ptr %from{k}",
                f"  %rows{k} = getelementptr {VECTOR}, ptr %scratch, i64 {start}",
                f"  call void @gather(ptr %rows{k}, ptr %array{k}, "
                f"i64 %first, i64 %count, i64 {count}, i64 {count})",
            ]
    given = "ptr %scratch, ptr %fixed, ptr %outputs, ptr %work"
    lines += [f"  call void @part{k}({given})" for k in range(parts)]
    for k, (start, row, size) in enumerate(zip(ends, places, sizes, strict=False)):
        if len(row):
            lines += [
                f"  %to{k} = getelementptr ptr, ptr %results, i64 {k}",
                f"  %result{k} = load ptr, ptr %to{k}",
                f"  %found{k} = getelementptr {VECTOR}, ptr %outputs, i64 {start}",
                f"  call void @scatter(ptr %found{k}, ptr %result{k}, "
                f"i64 %first, i64 %count, i64 {len(row)}, i64 {size}, ptr @places{k})",
            ]
    return [*lines, _TAIL]
