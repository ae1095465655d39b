"""Sessions of a simulated polarizer series, for tests of the optics stage."""

import math
from pathlib import Path

import numpy as np

from drivers.records import Frame
from hw_mocks.scene_camera import SceneCamera
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer
from polfuse_lab.records import Exposure
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter

SIZE = (98, 73)
"""Columns and rows: the thesis's sensor at an eighth of its resolution."""
PITCH_M = 8 * 8.3e-6

SCENE = """
name = "two walls"
[sun]
azimuth_deg = 180.0
elevation_deg = 40.0
counts = 40000.0
background_s0 = 0.1
[[surface]]
name = "left wall"
corner_m = [-1.2, 6.0, -1.6]
edge_u_m = [1.1, 0.0, 0.0]
edge_v_m = [0.0, 0.0, 1.5]
s0 = 0.7
dolp = 0.45
aop_deg = 30.0
[[surface]]
name = "right wall"
corner_m = [0.2, 6.0, -1.6]
edge_u_m = [1.1, 0.0, 0.0]
edge_v_m = [0.0, 0.0, 1.5]
s0 = 0.4
dolp = 0.06
aop_deg = -70.0
"""

RIG = f"""
name = "optics"
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.07
[radar]
driver = "sounddevice"
[switches]
driver = "dowkey_ms"
[trolley]
driver = "by_hand"
length_m = 3.2
[camera]
driver = "scene"
width_px = {SIZE[0]}
height_px = {SIZE[1]}
exposure_s = 0.001
focal_length_m = 0.008
pixel_pitch_m = {PITCH_M}
depression_deg = 9.0
black_level_counts = 200.0
read_noise_counts = 12.0
[polarizer]
driver = "by_hand"
extinction_ratio = 800.0
"""


def options(scene: Path, url: str, seed: int = 0, **other: object) -> SceneCamera.Options:
    values: dict[str, object] = {
        "scene_file": str(scene),
        "world_url": url,
        "width_px": SIZE[0],
        "height_px": SIZE[1],
        "pixel_pitch_m": PITCH_M,
        "depression_deg": 9.0,
        "exposure_s": 0.001,
        "black_level_counts": 200.0,
        "read_noise_counts": 12.0,
        "seed": seed,
    }
    return SceneCamera.Options(**{**values, **other})  # type: ignore[arg-type]


def take(camera: SceneCamera) -> Frame:
    camera.trigger()
    while (frame := camera.poll()) is None:
        pass
    return frame


def series(scene: Path, degrees: tuple[float, ...], frames: int, seed: int = 0) -> list[Exposure]:
    """Frames of the simulated camera with the simulated polarizer at each angle."""
    world = World()
    exposures = []
    with WorldServer(world) as server:
        camera = SceneCamera(options(scene, server.url, seed))
        try:
            camera.open()
            for angle in np.radians(degrees):
                world.polarizer_rad.hold(float(angle))
                exposures += [Exposure(take(camera), float(angle), math.radians(0.1)) for _ in range(frames)]
        finally:
            camera.close()
    return exposures


def write_session(path: Path, exposures: list[Exposure], *, rig: str | None = RIG) -> Path:
    waveform = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)
    shape = exposures[0].frame.image.shape if exposures else (SIZE[1], SIZE[0])
    config = SessionConfig(
        "collect", waveform, 48_000.0, frame_shape=(shape[0], shape[1]), rig_toml=rig, audio_block_frames=1024
    )
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for exposure in exposures:
            writer.write(exposure)
    return path
