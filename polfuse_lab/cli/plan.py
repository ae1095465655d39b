"""``polfuse plan``: a dry run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result

if TYPE_CHECKING:
    from polfuse_lab.plans.dry_run import DryRun


@guarded
def plan(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file.")],
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan file.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="SESSION.h5", help="Where it would be recorded: is there room?"),
    ] = None,
    at: Annotated[
        float, typer.Option(min=0.1, help="Ground range for which resolution and sensitivity are told, m.")
    ] = 10.0,
    explain: Annotated[
        bool, typer.Option("--explain", help="Measure this machine: what a session is best stored with, and why.")
    ] = False,
    list_: Annotated[bool, typer.Option("--list", help="List every step, as JSON in a line of its own.")] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Dry run: steps, time, file size, limits and wear of a collect, and what its image will resolve and show.

    Touches no device.

    Example: polfuse plan rig.toml plan.toml -o session.h5
    """
    from polfuse_lab.plans import load_plan
    from polfuse_lab.plans.dry_run import dry_run
    from polfuse_lab.plans.prediction import predict_image, prediction_lines
    from polfuse_lab.plans.step_json import steps_to_plain
    from polfuse_lab.rig import load_rig

    loaded, meant = load_plan(plan), load_rig(rig)
    outcome = dry_run(meant, loaded, output=Path.cwd() / "session.h5" if output is None else output)
    image = predict_image(meant, outcome.steps, at_m=at)
    storage = None
    if explain:
        from polfuse_lab.plans.storage import storage_choice

        storage = storage_choice(meant, outcome.steps, Path.cwd() / "session.h5" if output is None else output)
    why = [] if storage is None else storage.explain()
    listed = steps_to_plain(outcome.steps) if list_ else []
    result(
        {
            "steps": len(outcome.steps),
            "seconds": outcome.seconds,
            "bytes": outcome.bytes,
            "limits_ok": outcome.limits_ok,
            "problems": outcome.problems,
            "warnings": outcome.warnings,
            "kind": loaded.kind,
            "positions": outcome.planned.positions,
            "sweeps": outcome.records,
            "frames": outcome.planned.frames + outcome.planned.dark_frames,
            "switch_cycles": outcome.switch_cycles,
            "questions": outcome.questions,
            "free_bytes": outcome.free_bytes,
            "image": image,
            "storage": None if storage is None else {**storage.told(), "explanation": why},
        }
        | ({"list": listed} if list_ else {}),
        as_json=json_,
        text="\n".join([*_lines(outcome), *prediction_lines(image), *why, *_listed(listed)]),
    )


def _lines(outcome: DryRun) -> list[str]:
    """The outcome in words."""
    minutes, seconds = divmod(round(outcome.seconds), 60)
    planned = outcome.planned
    free = "" if outcome.free_bytes is None else f" ({outcome.free_bytes / 1e6:.0f} MB are free)"
    lines = [
        f"{len(outcome.steps)} steps, about {minutes} min {seconds:02d} s, at most {outcome.bytes / 1e6:.1f} MB{free}",
        f"positions: {planned.positions}, audio records: {outcome.records},"
        f" camera frames: {planned.frames + planned.dark_frames}, changes of the switches: {outcome.switch_cycles}",
    ]
    if outcome.questions:
        lines.append(f"questions to the operator: {outcome.questions}")
    lines += [f"note: {warning}" for warning in outcome.warnings]
    return lines + ([f"problem: {problem}" for problem in outcome.problems] or ["no problems found"])


def _listed(steps: list[dict[str, object]]) -> list[str]:
    import json

    return [f"{number:6} {json.dumps(step, ensure_ascii=False)}" for number, step in enumerate(steps, start=1)]
