"""What both eyes look at: radar targets, optical surfaces, the sun, and the imperfections of the radar.

Coordinates are the rig's: x along the rail, y away from it, z up, origin at the aperture's centre; the ground is
``z = -antenna_height_m`` of the rig. Scattering matrices are ``S[rx, tx]`` in sqrt(m^2), so that RCS = |S|^2.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Point:
    """An isotropic point scatterer."""

    name: str
    position_m: Vector
    scattering: NDArray[np.complex128]
    """(2, 2) complex, S[rx, tx], sqrt(m^2)."""


@dataclass(frozen=True)
class Reflector:
    """An analytic reflector, most kinds with flat, square faces.

    ``azimuth_rad`` and ``elevation_rad`` are the direction to the aperture's centre in the reflector's own frame
    (thesis Fig. 5.14): for a plate and a dihedral measured from the boresight, for a trihedral from its edges. From
    another antenna position both angles change by the change of the geometric direction.
    """

    name: str
    kind: str
    """``"plate"``, ``"dihedral"``, ``"trihedral"`` (square), ``"trihedral_triangular"`` or ``"sphere"``."""
    position_m: Vector
    """Phase centre: the face's centre, the fold's centre, the apex, or the sphere's centre."""
    edge_m: float
    """Edge of the faces, m: of a triangular one from the corner to a tip; of a sphere its diameter."""
    azimuth_rad: float = 0.0
    elevation_rad: float = 0.0
    fold_rad: float = 0.0
    """Dihedral only: angle of the fold line from horizontal; S = sqrt(sigma) [[cos 2f, sin 2f], [sin 2f, -cos 2f]]."""


@dataclass(frozen=True)
class Bush:
    """A cloud of randomly oriented thin dipoles around a centre (volume scattering)."""

    name: str
    position_m: Vector
    radius_m: float
    scatterers: int
    rcs_m2: float
    """Mean total co-polarized RCS, m^2."""
    seed: int = 0


@dataclass(frozen=True)
class FrontEnd:
    """Imperfections of the radar: M = receive @ S @ transmit, coupling, noise."""

    receive: NDArray[np.complex128] = field(default_factory=lambda: np.eye(2, dtype=np.complex128))
    transmit: NDArray[np.complex128] = field(default_factory=lambda: np.eye(2, dtype=np.complex128))
    amplitude_at_1m: float = 1.0
    """Beat amplitude, fraction of full scale, of 1 m^2 at 1 m on the antennas' axes."""
    coupling: float = 0.0
    """Beat amplitude of the direct path between the antennas, fraction of full scale."""
    coupling_range_m: float = 0.3
    """Apparent range of that path, m."""
    noise: float = 0.0
    """Noise of one audio sample, rms, fraction of full scale."""


@dataclass(frozen=True)
class Surface:
    """A flat optical patch: a parallelogram with a Stokes reflectance.

    ``stokes`` is the reflected Stokes vector (S0, S1, S2) for unit unpolarized sun irradiance at normal incidence,
    multiplied by the cosine of the sun's angle on the patch.
    """

    name: str
    corner_m: Vector
    edge_u_m: Vector
    edge_v_m: Vector
    stokes: tuple[float, float, float]


@dataclass(frozen=True)
class Scene:
    """Everything there is to see."""

    name: str
    points: tuple[Point, ...] = ()
    reflectors: tuple[Reflector, ...] = ()
    bushes: tuple[Bush, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    background_stokes: tuple[float, float, float] = (0.05, 0.0, 0.0)
    """Stokes vector of whatever no surface covers."""
    sun_direction: Vector = (0.0, -0.5, 0.8660254037844386)
    """Unit vector towards the sun."""
    sun_counts: float = 30_000.0
    """Camera counts (through no polarizer) for S0 = 1, at the rig's exposure and gain."""
    front_end: FrontEnd = field(default_factory=FrontEnd)
    seed: int = 0
    picture: NDArray[np.float64] | None = None
    """What the camera sees of bodies: Stokes parameters (3, rows, columns) for S0 = 1 of a white surface that faces the
    sun. It takes the place of surfaces and background."""
