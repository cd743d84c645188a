"""What contradicts the rest of its file: found by count, shape and name, and told with its key."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from constraints.arrays import Array
from expdesign.configuration import Problem, shown
from expdesign.runfolder.described import negative_variance


def other_shape(
    key: str, numbers: Array | None, shape: tuple[int, ...], of: str
) -> Iterator[Problem]:
    """Yield that an array has not the shape that the file asks for; nothing for None.

    Parameters
    ----------
    key : str
        Of the array.
    numbers : array or None
    shape : tuple of int
    of : str
        What its rows and columns are counted by, in words.
    """
    if numbers is not None and numbers.shape != shape:
        found, wanted = (" × ".join(map(str, each)) for each in (numbers.shape, shape))
        yield Problem(f"there are {found} numbers", key=key, allowed=f"{wanted}, as of {of}")


def no_covariance(key: str, numbers: Array | None, count: int, of: str) -> Iterator[Problem]:
    """Yield that a matrix is no covariance of as many; arguments as of `other_shape`."""
    wrong = list(other_shape(key, numbers, (count, count), of))
    yield from wrong
    place = None if wrong or numbers is None else negative_variance(numbers)
    if numbers is not None and place is not None:
        at = f"{key}[{place + 1}][{place + 1}]"
        message = f"{numbers[place, place]:g} is a negative variance"
        yield Problem(message, key=at, allowed="zero and more")


def other_count(key: str, entries: Collection[object], count: int, of: str) -> Iterator[Problem]:
    """Yield that a list has not as many entries as the file asks for; `of`: of what, in words."""
    if len(entries) != count:
        yield Problem(
            f"the list has {len(entries)}", key=key, allowed=f"{count}, one for each of {of}"
        )


def unknown_names(
    key: str, names: Iterable[str], known: Collection[str], of: str
) -> Iterator[Problem]:
    """Yield the first name that the file does not have elsewhere; `of`: where, in words."""
    for name in names:
        if name not in known:
            yield Problem(
                f"there is no {shown(name)} among {of}", key=key, allowed=", ".join(known)
            )
            return


def other_names(
    key: str, names: Collection[str], wanted: Collection[str], of: str
) -> Iterator[Problem]:
    """Yield that names are not all of those that the file has elsewhere; `of`: where, in words."""
    yield from unknown_names(key, names, wanted, of)
    missing = [name for name in wanted if name not in names]
    if missing:
        yield Problem(f"{shown(missing[0])} of {of} is missing", key=key, allowed=", ".join(wanted))
