"""Optimal experiment design and identification for hexapods.

`load_robot` gives the model, `load_measurement` a recording. `design`, `simulate`, `estimate` and
`report` are the stages that are called most; `run` does all that a run file names. `__init__.pyi`
lists the public names; each is imported on its first use, as `expdesign --help` needs no CasADi.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
