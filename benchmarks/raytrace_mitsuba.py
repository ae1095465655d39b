"""Runs Mitsuba 3 on a scene of :mod:`benchmarks.raytrace_scenes`, alone in its process: SCENE.json OUT.npz SPP RUNS.

Without an LLVM that Mitsuba can use (``DRJIT_LIBLLVM_PATH``) the interpreter of scalars is taken.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np


def mesh_file(folder: Path, name: str, vertices: list[list[float]], faces: list[list[int]]) -> str:
    """Write a PLY file as text; returns its path."""
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(f"{x:.9g}" for x in vertex) for vertex in vertices]
    lines += [f"3 {i} {j} {k}" for i, j, k in faces]
    path = folder / f"{name}.ply"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def scene(mi: Any, given: dict[str, Any], folder: Path) -> Any:
    """The scene as Mitsuba has it."""
    n, k = given["index"]
    metal: dict[str, Any] = {"type": "conductor", "eta": n, "k": k}
    if given["alpha"] > 0:
        metal |= {"type": "roughconductor", "alpha": given["alpha"], "distribution": "beckmann"}
    white = {"type": "diffuse", "reflectance": given["albedo"]}
    origin, target, up = given["camera"]
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "stokes", "path": {"type": "path", "max_depth": given["bounces"] + 1}},
        "lamp": {"type": "point", "position": given["lamp"][:3], "intensity": given["lamp"][3]},
        "sensor": {
            "type": "perspective",
            "fov": given["field_deg"],
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=up),
            "film": {
                "type": "hdrfilm",
                "width": given["size"][0],
                "height": given["size"][1],
                "pixel_format": "luminance",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
    }
    for number, (mesh, surface) in enumerate(zip(given["meshes"], (metal, white), strict=True)):
        file = mesh_file(folder, f"mesh{number}", *mesh)
        # Faces are seen from their front; "twosided" would turn S2 and S3 around on the back.
        parts[f"mesh{number}"] = {"type": "ply", "filename": file, "face_normals": True, "bsdf": surface}
    return mi.load_dict(parts)


def main(scene_file: str, out: str, samples: int, runs: int) -> None:
    """Render ``runs`` pictures with different seeds; writes them (runs, rows, columns, 4), and the seconds of each."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_mono_polarized" if "DRJIT_LIBLLVM_PATH" in os.environ else "scalar_spectral_polarized")
    with tempfile.TemporaryDirectory() as folder:
        loaded = scene(mi, json.loads(Path(scene_file).read_text()), Path(folder))
        mi.render(loaded, spp=samples, seed=12345).numpy()  # compiles
        pictures, seconds = [], []
        for seed in range(runs):
            begun = time.perf_counter()
            planes = np.array(mi.render(loaded, spp=samples, seed=seed))
            seconds.append(time.perf_counter() - begun)
            # Colour planes first, then S0 … S3 with the same luminance in each of their three. Mitsuba counts S3 for
            # fields exp(+i w t), which is the other hand.
            pictures.append(planes[..., -12::3] * np.array([1.0, 1.0, 1.0, -1.0]))
    np.savez(out, pictures=np.array(pictures), seconds=np.array(seconds))
    # Its threads do not always come to an end by themselves.
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
