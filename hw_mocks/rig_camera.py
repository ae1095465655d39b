"""The simulated rig's camera on the wire: a GigE Vision camera on a loopback address that looks at the rig's scene."""

from __future__ import annotations

import errno

from hw_mocks.gige_camera import GVCP_PORT, GigeCamera, Optics, Settings
from hw_mocks.scene_file import CameraEntry, SceneFile
from hw_mocks.sensor import Sensor
from hw_mocks.world import World
from polfuse_lab.errors import PolfuseError
from processing.optics.mosaic import parse_mosaic
from processing.scene.model import Scene

_ADDRESSES = tuple(f"127.0.0.{host}" for host in range(1, 9))
"""Clients look at one port only, so that each rig of this machine needs an address of its own."""
_EXPOSURES_S = (10e-6, 10.0)
_WHERE = "simulated GigE camera"


def start_gige_camera(file: SceneFile, scene: Scene, world: World, seed: int) -> GigeCamera:
    """Start the scene file's camera on the first free loopback address.

    Args:
        file: the scene file.
        scene: what it looks at.
        world: the simulated rig, which knows how the polarizer moved.
        seed: of the noise. Until the camera has been opened a second time, its frames are those of
            :class:`hw_mocks.scene_camera.SceneCamera` with this seed; as a real camera's, its noise does not start
            afresh when it is opened again.

    Raises:
        PolfuseError: the scene file has no camera, one that cannot expose so long, or no address is free.
    """
    camera = file.camera
    if camera is None:
        raise PolfuseError("the scene file has no camera", where=_WHERE, advice="add a section [camera] to it")
    low, high = _EXPOSURES_S
    if not low <= camera.exposure_s <= high:
        raise PolfuseError(
            f"found camera.exposure_s = {camera.exposure_s:g}", where=_WHERE, advice=f"give {low:g} to {high:g} s"
        )
    optics, settings = _optics(camera), _settings(camera, seed)
    for address in _ADDRESSES:
        try:
            return GigeCamera(scene, world, address, optics=optics, settings=settings)
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EADDRNOTAVAIL):
                raise PolfuseError(f"could not start ({error})", where=_WHERE, advice="use camera = 'scene'") from error
    raise PolfuseError(
        f"UDP port {GVCP_PORT} is taken on {_ADDRESSES[0]} to {_ADDRESSES[-1]}",
        where=_WHERE,
        advice="end other simulated rigs, or use camera = 'scene'",
    )


def _optics(camera: CameraEntry) -> Optics:
    mosaic = parse_mosaic(camera.mosaic) if camera.mosaic != "none" else None
    return Optics(
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_length_m=camera.focal_length_m,
        pixel_pitch_m=camera.pixel_pitch_m,
        position_m=camera.position_m,
        depression_deg=camera.depression_deg,
        extinction_ratio=camera.extinction_ratio,
        mosaic=mosaic,
    )


def _settings(camera: CameraEntry, seed: int) -> Settings:
    sensor = Sensor(
        camera.black_level_counts, camera.electrons_per_count, camera.read_noise_counts, camera.saturation_counts
    )
    return Settings(exposure_s=camera.exposure_s, seed=seed, sensor=sensor)
