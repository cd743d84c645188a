"""The catalogue of terms, from the modules of this package and of plug-ins."""

from __future__ import annotations

import copyreg
from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from constraints.plugins import declarations
from expdesign.mechanism.term import Parameter, Term, parameters_of
from expdesign.mechanism.terms import rigid_platform
from expdesign.mechanism.terms.actuator_forces import DRIVE_INERTIA, DRIVE_INERTIA_ON_A_THREAD

DEFAULT = ("struts", "rigid_platform", "passive_friction", "actuator_friction")
"""Terms of a robot file without `terms`."""


@cache
def term_definitions() -> Mapping[str, Term]:
    """Return every term by its key in the robot file's `terms`, in the order of `Term.place`.

    The platform has its general form.

    Examples
    --------
    >>> list(term_definitions())[:2]
    ['struts', 'rigid_platform']
    """
    found: dict[str, Term] = {}
    for term in sorted(declarations(Term, __name__, "TERM", "TERMS"), key=lambda term: term.place):
        if term.name in found:
            raise ValueError(f"two terms have the name '{term.name}'")
        found[term.name] = term
    return MappingProxyType(found)


def terms_named(names: Iterable[str], *, general: bool, turning: bool = False) -> tuple[Term, ...]:
    """Return the terms of these names.

    With the symmetric (5) or general (10) platform, and with screws that the platform turns or not.
    """
    swapped = {} if general else {rigid_platform.GENERAL: rigid_platform.SYMMETRIC}
    if turning:
        swapped[DRIVE_INERTIA] = DRIVE_INERTIA_ON_A_THREAD
    return tuple(swapped.get(term, term) for term in map(term_definitions().__getitem__, names))


@cache
def known_parameters() -> Mapping[str, Parameter]:
    """Return the parameters of every term in the catalogue, by name."""
    parameters = parameters_of(tuple(term_definitions().values()))
    return MappingProxyType({parameter.name: parameter for parameter in parameters})


def parameter_unit(name: str) -> str:
    """Return the SI unit of a parameter.

    Examples
    --------
    >>> parameter_unit("r1")
    'N'
    """
    return known_parameters()[name].unit


_OTHER_FORMS = {
    "rigid_platform, symmetric": rigid_platform.SYMMETRIC,
    "drive_inertia, on a thread": DRIVE_INERTIA_ON_A_THREAD,
}


def _form(name: str) -> Term:
    return _OTHER_FORMS.get(name) or term_definitions()[name]


def _reduce_term(term: Term) -> str | tuple[Any, ...]:
    for forms in (_OTHER_FORMS, term_definitions()):
        for name, form in forms.items():
            if form is term:
                return _form, (name,)
    return term.__reduce_ex__(2)


# Worker processes have the same catalogue: its terms are pickled by name and stay identical.
copyreg.pickle(Term, _reduce_term)
