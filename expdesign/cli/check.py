"""`expdesign check`: validate a run and show what it means, without computing anything else."""

from __future__ import annotations

from expdesign.cli.output import JsonOption, RunArgument, note, warn, write_json


def check(run: RunArgument, as_json: JsonOption = False) -> None:
    """Validate a run and print its complete configuration, with every default, in SI units.

    Nothing is computed but whether the home pose keeps the limits, and whether the study could be
    done. Warnings, what `expdesign run` would do, and the pairs of struts that share a joint and
    are left out of the clearance, go to standard error.
    """
    import typer

    from expdesign.configuration import load_run, resolved_yaml
    from expdesign.robot import robot_from
    from expdesign.stages.run import refuse_study, run_folder
    from expdesign.stages.table import left_out, named, performed, stages_without_design

    configuration = load_run(run)
    robot_from(configuration.robot)
    refuse_study(configuration)
    pairs = [(i + 1, j + 1) for i, j in configuration.robot.shared_joint_pairs]
    done = performed(configuration)
    warnings = list(configuration.warnings)
    if missing := stages_without_design(configuration, run_folder(configuration, None)):
        warnings.append(f"expdesign run refuses this file. {missing.message}")
    if as_json:
        write_json(
            {
                "status": 0,
                "file": None if configuration.file is None else str(configuration.file),
                "stages": configuration.stages,
                "run_does": done,
                "configuration": configuration.run.model_dump(mode="json", by_alias=True),
                "shared_joints": pairs,
                "warnings": warnings,
            }
        )
        return
    typer.echo(resolved_yaml(configuration), nl=False)
    unnamed = "" if configuration.stages else " (the file names no stage)"
    note(f"expdesign run does: {', '.join(done) or 'nothing'}{unnamed}")
    for stage in named(configuration):
        if reason := left_out(stage, configuration):
            note(f"{stage}: left out, {reason}")
    for first, second in pairs:
        note(f"struts {first} and {second} share a joint: left out of the strut clearance")
    for warning in warnings:
        warn(warning)
