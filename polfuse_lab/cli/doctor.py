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
    from polfuse_lab.doctor import examine, gather, judge
    from polfuse_lab.doctor.system import rig_producer
    from polfuse_lab.rig import load_rig

    model = load_rig(rig)
    producer = rig_producer(model)
    facts = gather(rig.resolve().parent, (producer,) if producer else ())
    system = judge(model, facts)
    findings = examine(rig)
    found = {
        "serial_ports": [asdict(port) for port in facts.serial_ports],
        "sound_inputs": facts.sound_inputs.found,
        "gentl_producers": facts.producers,
        "cameras": {path: listing.found for path, listing in facts.cameras.items()},
        "drivers": {kind: available(kind) for kind in KINDS},
    }
    sick = [finding for finding in (*findings, *system) if not finding.ok]
    lines = []
    for finding in (*findings, *system):
        what = finding.name if finding.kind == "system" else f"{finding.kind} ({finding.name})"
        lines.append(f"{'ok  ' if finding.ok else 'FAIL'} {what}: {finding.detail}")
        if finding.advice:
            lines.append(f"     {'better' if finding.ok else 'mend'}: {finding.advice}")
    ports = [f"{port.device} ({port.description or 'no description'})" for port in facts.serial_ports]
    cameras = [name for listing in facts.cameras.values() for name in listing.found]
    lines.append("found on this computer:")
    for name, items in (
        ("serial ports", ports),
        ("sound inputs", facts.sound_inputs.found),
        ("GenTL producers", facts.producers),
        ("cameras", cameras),
    ):
        lines.append(f"  {name}: {'; '.join(items) or 'none'}")
    lines += ["installed drivers:"] + [f"  {kind}: {', '.join(available(kind)) or 'none'}" for kind in KINDS]
    values = {
        "devices": [asdict(finding) for finding in findings],
        "system": [asdict(finding) for finding in system],
        "found": found,
        "ok": not sick,
    }
    result(values, as_json=json_, text="\n".join(lines))
    if sick:
        first = sick[0]
        what = f"the {first.kind} ({first.name})" if first.kind != "system" else f"the computer ({first.name})"
        progress(
            f"error: {len(sick)} of {len(findings) + len(system)} things need attention, first {what}:"
            f" {first.detail}; {first.advice}"
        )
        raise typer.Exit(1)
