"""`expdesign run`: every stage that the YAML names, resuming what is done."""

from __future__ import annotations

from expdesign.cli.design import OutOption, design_stage, run_folder
from expdesign.cli.errors import CommandFailed
from expdesign.cli.output import JsonOption, RunArgument, note, short, warn, write_json

_AVAILABLE = ("design",)


def run(run: RunArgument, out: OutOption = None, as_json: JsonOption = False) -> None:
    """Do every stage that the run file names, in their order; what is done already is kept."""
    from expdesign.cli.stages import is_done
    from expdesign.configuration import load_run

    configuration = load_run(run)
    folder = run_folder(configuration, out)
    stages = configuration.stages or ("design",)
    if not set(stages) & set(_AVAILABLE):
        raise CommandFailed(
            f"the run names {', '.join(stages)}; this version has {', '.join(_AVAILABLE)} only"
        )
    for stage in stages:
        if stage not in _AVAILABLE:
            warn(f"the stage '{stage}' is not part of this version and is left out")
        elif is_done(stage, configuration, folder):
            note(f"{stage}: done already, in {short(folder)}")
            if as_json:
                write_json({"status": 0, "folder": str(folder), "resumed": True})
        else:
            design_stage(configuration, folder, as_json=as_json)
