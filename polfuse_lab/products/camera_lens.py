"""The camera's lens from pictures of a chessboard: stage ``"camera"``, and its use for the rig file's numbers."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.optics.camera_calibration import FEWEST, CameraCalibration, calibrate_camera
from processing.optics.camera_model import Pinhole
from processing.optics.chessboard import find_chessboard

Floats = NDArray[np.float64]

STAGE = "camera"
SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".npy")
"""Of pictures that are looked at; others in the folder are not."""


@dataclass(frozen=True)
class LensMade:
    """A lens that was calibrated."""

    products: Path
    found: CameraCalibration
    width_px: int
    height_px: int
    used: tuple[str, ...]
    """Names of the pictures."""
    without_board: tuple[str, ...]
    """Pictures in which no board was found."""

    @property
    def principal_offset_px(self) -> tuple[float, float]:
        """The optical axis against the sensor's middle."""
        return self.found.principal_offset_px(self.width_px, self.height_px)

    def rig_lines(self, pixel_pitch_m: float) -> list[str]:
        """What the rig file's [camera] has to say."""
        k = ", ".join(f"{number:.5g}" for number in self.found.distortion)
        offset = ", ".join(f"{number:.2f}" for number in self.principal_offset_px)
        return [
            f"focal_length_m = {self.found.focal_length_px * pixel_pitch_m:.7f}",
            f"distortion = [{k}]",
            f"principal_offset_px = [{offset}]",
        ]


def calibrate_lens(
    folder: Path | str,
    products_path: Path | str,
    rows: int,
    columns: int,
    *,
    progress: Callable[[str], None] | None = None,
) -> LensMade:
    """Find a camera's focal length, axis and distortion from a folder of pictures of one chessboard.

    Writes the stage "camera": array ``corners`` (pictures, rows, columns, 2) in pixels; settings as of
    :class:`processing.optics.camera_calibration.CameraCalibration`, with ``width_px``, ``height_px``,
    ``principal_offset_px`` and the pictures' names.

    Args:
        folder: where the pictures are; all are of one size.
        products_path: the products file; made if it is not there, its other stages are kept.
        rows, columns: inner corners of the board, down and along.
        progress: called with each picture's name.

    Raises:
        PolfuseError: no pictures, one that cannot be read, other sizes, or boards in too few of them.
        DataError: boards that tell nothing of the camera.
    """
    folder = Path(folder)
    paths = sorted(path for path in _files(folder) if path.suffix.lower() in SUFFIXES)
    if not paths:
        raise PolfuseError(
            "holds no pictures", where=str(folder), advice=f"give a folder of {', '.join(SUFFIXES)} files of a board"
        )
    corners: list[Floats] = []
    used: list[str] = []
    without: list[str] = []
    first: tuple[int, ...] | None = None
    for path in paths:
        if progress is not None:
            progress(path.name)
        picture = _picture(path)
        if first is not None and picture.shape != first:
            raise PolfuseError(
                f"is {picture.shape[1]} x {picture.shape[0]} pixels, and {paths[0].name} {first[1]} x {first[0]}",
                where=str(path),
                advice="give pictures of one camera as it took them, neither cut nor turned",
            )
        first = picture.shape
        try:
            corners.append(find_chessboard(picture, rows, columns))
            used.append(path.name)
        except DataError:
            without.append(path.name)
    if len(corners) < FEWEST:
        raise PolfuseError(
            f"a chessboard with {rows} x {columns} inner corners was found in {len(corners)} of {len(paths)} pictures"
            f" (not in {_listed(without)})",
            where=str(folder),
            advice=f"count the corners where four fields meet (--board ROWSxCOLUMNS), and take {FEWEST} or more "
            "pictures that show the whole board, sharp and evenly lit",
        )
    assert first is not None
    height, width = first
    found = calibrate_camera(corners, width, height)
    made = LensMade(Path(products_path), found, width, height, tuple(used), tuple(without))
    Products(products_path).write(
        STAGE,
        {"corners": np.stack(corners)},
        settings={
            **vars(found),
            "principal_offset_px": made.principal_offset_px,
            "width_px": width,
            "height_px": height,
            "board": [rows, columns],
            "pictures": used,
            "without_board": without,
        },
        inputs=[folder / name for name in used],
        units={"corners": "px"},
    )
    return made


def holds_lens(path: Path | str) -> bool:
    """Whether a products file holds a calibrated lens."""
    return STAGE in Products(path).stages()


def with_lens(camera: Pinhole, path: Path | str) -> Pinhole:
    """The camera with the lens that a products file holds.

    Raises:
        PolfuseError: no stage "camera", or that of another sensor.
    """
    settings = Products(path).settings(STAGE)
    size = int(settings["width_px"]), int(settings["height_px"])
    if size != (camera.width_px, camera.height_px):
        raise PolfuseError(
            f"its boards were taken with {size[0]} x {size[1]} pixels, the scene with {camera.width_px} x "
            f"{camera.height_px}",
            where=str(path),
            advice="calibrate with pictures of the same camera in the same format",
        )
    k1, k2, p1, p2 = (float(number) for number in settings["distortion"])
    right, down = (float(number) for number in settings["principal_offset_px"])
    return replace(
        camera,
        focal_length_m=float(settings["focal_length_px"]) * camera.pixel_pitch_m,
        distortion=(k1, k2, p1, p2),
        principal_offset_px=(right, down),
    )


def _files(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise PolfuseError(
            f"is no folder of pictures ({error.strerror})", where=str(folder), advice="give the folder of the board's"
        ) from error


def _picture(path: Path) -> Floats:
    """Brightness (rows, columns)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of sizes and of unknown tags: what matters is whether it can be read
            if path.suffix.lower() == ".npy":
                values = np.load(path, allow_pickle=False)
            else:
                with Image.open(path) as image:
                    values = np.asarray(image.convert("RGB") if image.mode == "P" else image)
            picture = np.asarray(values, dtype=np.float64)
    except Exception as error:
        # Damaged pictures raise nearly every kind of exception.
        raise PolfuseError(
            f"cannot be read as a picture ({error})",
            where=str(path),
            advice="take it out of the folder, or save it anew",
        ) from error
    if picture.ndim == 3:
        picture = picture[..., :3].mean(axis=-1)
    if picture.ndim != 2:
        raise PolfuseError(f"has shape {picture.shape}", where=str(path), advice="give one picture a file")
    return picture


def _listed(names: list[str], most: int = 5) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
