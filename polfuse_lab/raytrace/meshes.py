"""Meshes from OBJ and PLY files, through trimesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from polfuse_lab.errors import PolfuseError
from processing.errors import DataError
from processing.raytrace.triangles import Triangles

SUFFIXES = (".obj", ".ply")


def read_mesh(path: Path | str) -> Triangles:
    """All triangles of a file, as it has them (faces of more corners are cut into triangles).

    Raises:
        PolfuseError: trimesh is missing, or the file is not there, of another kind, or holds no triangles.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise PolfuseError(f"is no mesh that can be read ('{path.suffix}')", where=str(path), advice="give OBJ or PLY")
    if not path.is_file():
        raise PolfuseError("there is no such mesh", where=str(path), advice="check the name in the scene file")
    try:
        import trimesh
    except ImportError as error:
        raise PolfuseError(
            "meshes are read by trimesh, which is not installed",
            where=str(path),
            advice="pip install 'polfuse-lab[raytrace]'",
        ) from error
    try:
        loaded: Any = trimesh.load(path, force="mesh", process=False)
        return Triangles(np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, dtype=np.int64))
    except DataError as error:
        raise PolfuseError(error.what, where=str(path), advice=error.advice) from error
    except Exception as error:  # a reader of foreign files may fail in any way
        raise PolfuseError(
            f"cannot be read as a mesh ({type(error).__name__}: {error})",
            where=str(path),
            advice="open it in the program that made it and export it again",
        ) from error
