"""First hits by Intel's Embree (PyPI ``embreex``), which works in float32, made exact for the triangle that it finds.

An alternative to :class:`processing.raytrace.bvh.Tree` for single looks at large meshes: one thread, quick to build.
Pictures are traced with the tree, whose float64 finds edges and the surface left behind without tolerances.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.raytrace.moller_trumbore import Hits, intersect
from processing.raytrace.triangles import Triangles

Floats = NDArray[np.float64]


class Embree:
    """A mesh in Embree.

    Raises:
        DataError: embreex is not installed.
    """

    def __init__(self, mesh: Triangles) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            raise DataError(
                "embreex is not installed", "pip install 'polfuse-lab[raytrace]', or use bvh.build"
            ) from error
        self._corners = mesh.corners_m
        # float32 has 7 digits: counted from the middle they are spent on the mesh, not on where it stands.
        self._centre, self._radius = mesh.sphere
        self._scene: Any = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, (self._corners - self._centre).astype(np.float32))

    def closest(self, origin: ArrayLike, direction: ArrayLike) -> Hits:
        """The nearest triangle that each ray meets, to float32; distance, u and v of it in float64 (thesis 4.3).

        Args:
            origin, direction: (N, 3). Rays that begin on a surface may meet it.
        """
        o, d = np.asarray(origin, dtype=np.float64), np.asarray(direction, dtype=np.float64)
        start = np.ascontiguousarray(o - self._centre, dtype=np.float32)
        found = np.asarray(self._scene.run(start, np.ascontiguousarray(d, dtype=np.float32)), dtype=np.int64)
        met = found >= 0
        distance, u, v = np.full(len(o), np.inf), np.zeros(len(o)), np.zeros(len(o))
        distance[met], u[met], v[met] = intersect(o[met], d[met], self._corners[found[met]])
        return Hits(distance, found, u, v)
