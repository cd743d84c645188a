"""The terms that exist. A new one is one file of `expdesign.mechanism.terms` and one line here."""

from __future__ import annotations

import copyreg
from collections.abc import Iterable
from typing import Any

from expdesign.mechanism.term import Parameter, Term, parameters_of
from expdesign.mechanism.terms import (
    actuator_friction,
    asymmetric_friction,
    cable,
    cogging,
    cogging_second,
    cubic_friction,
    drive_inertia,
    force_offset,
    gravity_compensation,
    load_friction,
    passive_friction,
    payload,
    quadratic_friction,
    rigid_platform,
    stribeck,
    struts,
)

TERMS: dict[str, Term] = {
    term.name: term
    for term in (
        struts.TERM,
        rigid_platform.GENERAL,
        drive_inertia.TERM,
        passive_friction.TERM,
        actuator_friction.TERM,
        asymmetric_friction.TERM,
        quadratic_friction.TERM,
        cubic_friction.TERM,
        force_offset.TERM,
        stribeck.TERM,
        load_friction.TERM,
        cable.TERM,
        cogging.TERM,
        cogging_second.TERM,
        gravity_compensation.TERM,
        payload.TERM,
    )
}
"""By their keys in the robot file's `terms`; the platform in its general form."""

_FORMS = {
    **TERMS,
    "rigid_platform, symmetric": rigid_platform.SYMMETRIC,
    "drive_inertia, on a thread": drive_inertia.ON_A_THREAD,
}


def _form(name: str) -> Term:
    return _FORMS[name]


def _reduced(term: Term) -> str | tuple[Any, ...]:
    for name, form in _FORMS.items():
        if form is term:
            return _form, (name,)
    return term.__reduce_ex__(2)


# Other processes have the same files: what is there goes by its name, and stays the same object.
copyreg.pickle(Term, _reduced)

DEFAULT = ("struts", "rigid_platform", "passive_friction", "actuator_friction")
"""Where a robot file lists none."""


def terms_named(names: Iterable[str], *, general: bool, turning: bool = False) -> tuple[Term, ...]:
    """Return the terms of these names.

    With the symmetric (5) or general (10) platform, and with screws that the platform turns or not.
    """
    swapped = {} if general else {rigid_platform.GENERAL: rigid_platform.SYMMETRIC}
    if turning:
        swapped[drive_inertia.TERM] = drive_inertia.ON_A_THREAD
    return tuple(swapped.get(term, term) for term in (TERMS[name] for name in names))


def known_parameters() -> dict[str, Parameter]:
    """Return the parameters of every term that exists, by name."""
    return {parameter.name: parameter for parameter in parameters_of(tuple(TERMS.values()))}


def parameter_unit(name: str) -> str:
    """Return the SI unit of a parameter by its name."""
    return known_parameters()[name].unit
