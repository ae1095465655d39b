"""Scenes that the ray tracer and Mitsuba 3 both simulate: the thesis's bodies before a white screen, lit by a lamp."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from processing.raytrace import shapes
from processing.raytrace.materials import Fresnel, Lambert, Material, Shadowing
from processing.raytrace.sources import PointSource
from processing.raytrace.triangles import Triangles
from processing.raytrace.view import View

BODIES = ("plate", "dihedral", "trihedral", "sphere")
SURFACES = ("smooth aluminium", "rough aluminium", "smooth glass", "rough glass")
SCREEN_ALBEDO = 0.8
BOUNCES = 4
_INDEX = {"aluminium": 1.02 + 6.84j, "glass": 1.5 + 0j}
_SLOPE_SD = 0.15


@dataclass(frozen=True)
class Case:
    """A scene for both: ``mesh`` has material 0, a screen behind the camera material 1."""

    name: str
    body: Triangles
    screen: Triangles
    surface: Fresnel
    lamp: PointSource
    view: View

    @property
    def materials(self) -> list[Material]:
        """In the order of the meshes' indices."""
        return [self.surface, Lambert(SCREEN_ALBEDO)]

    def write(self, path: Path) -> None:
        """For the program that runs Mitsuba."""
        values: dict[str, Any] = {
            "bounces": BOUNCES,
            "index": [complex(self.surface.index).real, complex(self.surface.index).imag],
            "alpha": math.sqrt(2) * self.surface.slope_sd,
            "albedo": SCREEN_ALBEDO,
            "lamp": [*self.lamp.position_m, self.lamp.intensity],
            "camera": [self.view.position_m, self.view.target_m, self.view.up],
            "field_deg": math.degrees(self.view.field_rad),
            "size": [self.view.width_px, self.view.height_px],
            "meshes": [[mesh.vertices_m.tolist(), mesh.faces.tolist()] for mesh in (self.body, self.screen)],
        }
        path.write_text(json.dumps(values))


def case(body: str, surface: str, pixels: int) -> Case:
    """One of :data:`BODIES` of one of :data:`SURFACES`, ``pixels`` wide and high."""
    mesh = {
        "plate": shapes.plate(2.0).turned(shapes.turn_about((1, 0, 0), -1.2)),
        "dihedral": shapes.dihedral(1.6),
        "trihedral": shapes.trihedral(1.3).turned(shapes.turn_about((0, 0, 1), math.pi / 4)),
        "sphere": shapes.sphere(0.8, divisions=3).moved((0, 0, 0.5)),
    }[body]
    roughness, _, matter = surface.partition(" ")
    material = Fresnel(_INDEX[matter], _SLOPE_SD if roughness == "rough" else 0.0, shadowing=Shadowing.SMITH_RATIONAL)
    # The screen stands behind the camera and the lamp between them, so that every smooth face shows lit white.
    screen = shapes.patch((-6.0, 5.5, -1.0), (12.0, 0.0, 0.0), (0.0, 2.0, 8.0))
    return Case(
        f"{body}, {surface}",
        mesh,
        screen,
        material,
        PointSource((0.6, 3.6, 2.6), 20.0),
        View((0.35, 4.0, 2.2), (0.0, 0.3, 0.45), pixels, pixels, math.radians(26.0)),
    )


def of_blocks(mean: np.ndarray[Any, Any], error: np.ndarray[Any, Any], block: int) -> tuple[Any, Any]:
    """Means over blocks of pixels, and their standard errors: both (rows / block, columns / block, 4)."""
    rows, columns = mean.shape[0] // block, mean.shape[1] // block
    parts = (rows, block, columns, block, -1)
    mean = mean[: rows * block, : columns * block].reshape(parts).mean(axis=(1, 3))
    squares = (error[: rows * block, : columns * block] ** 2).reshape(parts).sum(axis=(1, 3))
    return mean, np.sqrt(squares) / block**2
