"""What a logger writes of the machine: columns, units and noise of its own.

Time in ms, lengths in mm, currents in mA behind force constants, decimal commas.
"""

import numpy as np

FORCE_CONSTANTS = (92.4, 90.1, 91.7, 89.6, 93.2, 90.8)
"""N/A, of each actuator."""

DATA = {
    "delimiter": ";",
    "decimal": ",",
    "columns": {
        "t": "Zeit",
        **{f"q{j}": f"Weg {j}" for j in range(1, 7)},
        **{f"Q{j}": f"Strom {j}" for j in range(1, 7)},
    },
    "units": {"t": "ms", "q": "mm", "Q": "mA"},
    "force_constants": list(FORCE_CONSTANTS),
}
"""The section `data` of a run file that reads it."""


def write_recording(path, driven, periods, noise, seed):
    """Write a recording: repetitions of what happened in one period, with noise.

    Parameters
    ----------
    path, driven
        File, and what happened.
    periods
        How many.
    noise
        Covariances of lengths [m²] and forces [N²].
    seed
        Of the noise.
    """
    rng = np.random.default_rng(seed)
    count = periods * len(driven.lengths)
    lengths, forces = (
        np.tile(clean, (periods, 1)) + rng.multivariate_normal(np.zeros(6), covariance, count)
        for clean, covariance in zip((driven.lengths, driven.forces), noise, strict=True)
    )
    time = driven.step * np.arange(count)
    table = 1000 * np.column_stack([time, forces / FORCE_CONSTANTS, lengths])
    columns = DATA["columns"]
    names = [columns[key] for key in ("t", *(f"{a}{j}" for a in "Qq" for j in range(1, 7)))]
    lines = [";".join(names), *(";".join(f"{cell:.5f}" for cell in row) for row in table)]
    path.write_text("\n".join(lines).replace(".", ",") + "\n", encoding="utf-8")
