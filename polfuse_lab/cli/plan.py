"""``polfuse plan``: a dry run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def plan(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file.")],
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan file.")],
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Dry run: steps, time, file size and limits of a collect; touches no device.

    Example: polfuse plan rig.toml plan.toml
    """
    from polfuse_lab.plans import load_plan
    from polfuse_lab.plans.dry_run import dry_run
    from polfuse_lab.rig import load_rig

    outcome = dry_run(load_rig(rig), load_plan(plan))
    minutes, seconds = divmod(round(outcome.seconds), 60)
    lines = [f"{len(outcome.steps)} steps, about {minutes} min {seconds:02d} s, at most {outcome.bytes / 1e6:.1f} MB"]
    lines += [f"problem: {problem}" for problem in outcome.problems] or ["no problems found"]
    result(
        {
            "steps": len(outcome.steps),
            "seconds": outcome.seconds,
            "bytes": outcome.bytes,
            "limits_ok": outcome.limits_ok,
            "problems": outcome.problems,
        },
        as_json=json_,
        text="\n".join(lines),
    )
