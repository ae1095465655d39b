"""``polfuse doctor``: what is wrong with the devices, and how to mend it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


@guarded
def doctor(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file.")],
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Look at every device of a rig; say what is wrong and how to mend it. Moves nothing, writes nothing.

    Example: polfuse doctor rig.toml
    """
    from drivers.registry import KINDS, available
    from polfuse_lab.doctor import examine

    findings = examine(rig)
    sick = [finding for finding in findings if not finding.ok]
    lines = []
    for finding in findings:
        lines.append(f"{'ok  ' if finding.ok else 'FAIL'} {finding.kind} ({finding.name}): {finding.detail}")
        if finding.advice:
            lines.append(f"     mend: {finding.advice}")
    lines += ["installed drivers:"] + [f"  {kind}: {', '.join(available(kind)) or 'none'}" for kind in KINDS]
    result({"devices": [asdict(finding) for finding in findings], "ok": not sick}, as_json=json_, text="\n".join(lines))
    if sick:
        first = sick[0]
        progress(
            f"error: {len(sick)} of {len(findings)} devices need attention, first the {first.kind} ({first.name}):"
            f" {first.detail}; {first.advice}"
        )
        raise typer.Exit(1)
