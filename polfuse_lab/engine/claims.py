"""Which devices an engine holds, so that two engines do not fight over one."""

from __future__ import annotations

from pathlib import Path

from polfuse_lab.engine.directory import EngineInfo, engines
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Rig

KINDS = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
PLACES = ("port", "url", "world_url", "host", "address", "addresses", "serial_number", "device", "cti")
"""Options that say where a device is, in any driver."""
BY_HAND = "by_hand"


def claims(rig: Rig) -> list[str]:
    """What a rig's devices are reached by, one text for each; devices that are worked by hand can be had by anybody."""
    found = []
    for kind in KINDS:
        section = rig.section(kind)
        if section is None or section.driver == BY_HAND:
            continue
        # An address may end with a token, which is nobody's business.
        places = [
            f"{name}={str(section.options[name]).partition('?')[0]}" for name in PLACES if section.options.get(name)
        ]
        # Where nothing is said, it is the driver's only (or first) device.
        found.append(f"{kind}: {section.driver} {' '.join(places)}".strip())
    return found


def holder(rig: Rig, *, own: Path | None = None, mode: str | None = None) -> EngineInfo | None:
    """A running engine that holds one of the rig's devices; None where there is none.

    Args:
        rig: the rig that is to be used.
        own: directory of an engine that does not count.
        mode: only engines of this mode count, if given.
    """
    wanted = set(claims(rig))
    for engine in engines():
        if engine.directory != own and (mode is None or engine.mode == mode) and wanted & set(engine.devices):
            return engine
    return None


def refuse_held(rig: Rig, *, mode: str | None = None) -> None:
    """Raise :class:`PolfuseError` where another engine holds one of the rig's devices; arguments as :func:`holder`."""
    other = holder(rig, mode=mode)
    if other is None:
        return
    shared = sorted(set(claims(rig)) & set(other.devices))
    if other.mode == "bench":
        what, advice = f"set-up mode of '{other.rig_name}'", "close set-up mode, or begin the collect from there"
    else:
        what, advice = f"the collect of {other.output}", "wait until it has ended, or abort it"
    kind, _, driver = shared[0].partition(": ")
    raise PolfuseError(
        f"is in use by {what} (process {other.pid})", where=f"{kind} ({driver.partition(' ')[0]})", advice=advice
    )
