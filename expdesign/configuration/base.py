"""What all sections of a file have in common: no unknown keys, no change after validation."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A mapping of the YAML with a fixed set of keys; frozen, plain data in SI units."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())
