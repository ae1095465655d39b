"""Bodies of a scene file that the simulated rig looks at (``polfuse sim``): its tables of substances and solids."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ConfigDict

from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import read_model
from polfuse_lab.simulation.scene_file import BodyTables

if TYPE_CHECKING:
    from processing.scene.solids import SolidScene


class RigBodies(BodyTables):
    """The bodies of a scene file of the rig, whose other tables are the simulated rig's to read."""

    model_config = ConfigDict(extra="ignore")

    name: str = "scene"
    """A name for reports."""


def read_bodies(path: Path | str, centre_hz: float) -> SolidScene:
    """The bodies of a scene file of the rig, standing on z = 0; x along the rail, y away from it.

    Args:
        path: the scene file.
        centre_hz: the radar's frequency, for permittivities.

    Raises:
        PolfuseError: a file, substance or body that cannot be used.
    """
    found = read_model(path, RigBodies)
    scene = found.bodies(found.name, Path(path), centre_hz)
    if scene.speed_m_s > 0:
        raise PolfuseError(
            "holds a body with velocity_m_s; bodies before the simulated rig stand still",
            where=str(path),
            advice="leave it out, or let 'polfuse simulate' fly over it",
        )
    return scene
