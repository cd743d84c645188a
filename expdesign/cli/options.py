"""Options of a command that are keys of a section: their text is for the schema to read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from typing import Annotated, Any, NamedTuple

import typer


class Option(NamedTuple):
    """An option of a command that is a key of a section; `read` gives what would stand there."""

    metavar: str
    help: str
    read: Callable[[str], Any] = str


def with_options(
    options: Mapping[str, Option],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator: a command has every option of the table in place of its ``**options``."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        own = signature(command, eval_str=True)
        *first, last = (one for one in own.parameters.values() if one.kind is not one.VAR_KEYWORD)
        more = [
            Parameter(
                key,
                Parameter.POSITIONAL_OR_KEYWORD,
                default=None,
                annotation=Annotated[
                    str | None,
                    typer.Option(flag(key), metavar=option.metavar, help=option.help),
                ],
            )
            for key, option in options.items()
        ]
        # Every function takes the attribute (PEP 362), which mypy does not know.
        command.__signature__ = own.replace(parameters=[*first, *more, last])  # type: ignore[attr-defined]
        return command

    return decorated


def flag(key: str) -> str:
    """Return the option that a key is."""
    return f"--{key.replace('_', '-')}"
