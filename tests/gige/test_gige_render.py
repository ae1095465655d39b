"""What the camera sees: Malus' law through the polarizer as it really moved, the mosaic, exposure and gain."""

import math

import numpy as np
import pytest
from gige_client import Client, image_of
from scipy.integrate import quad

from hw_mocks.gige_camera import SONY_MOSAIC, Exposure, GigeCamera, Optics, SceneView, Settings
from hw_mocks.scene_camera import SceneCamera
from hw_mocks.sensor import Sensor
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer
from processing.optics.mosaic import Mosaic
from processing.scene.model import Scene

# A scene of nothing but background, whose Stokes vector is known everywhere.
S = (0.5, 0.2, -0.1)
SCENE = Scene("background", background_stokes=S, sun_counts=40_000.0)
SILENT = Sensor(black_level_counts=100.0)


def intensity(angle_rad: float, extinction: float = math.inf) -> float:
    """Counts behind a polarizer: Goldstein's imperfect polarizer, thesis 2.18 when the extinction is infinite."""
    r = 1 / extinction
    polarized = S[1] * math.cos(2 * angle_rad) + S[2] * math.sin(2 * angle_rad)
    return 40_000 * 0.5 * ((1 + r) * S[0] + (1 - r) * polarized)


def view(
    world: World, *, mosaic: Mosaic | None = None, extinction: float = math.inf, repeat_after: int = 0
) -> SceneView:
    return SceneView(
        SCENE,
        world,
        Optics(width_px=40, height_px=30).pinhole(),
        SILENT,
        reference_exposure_s=0.01,
        extinction_ratio=extinction,
        mosaic=mosaic,
        seed=1,
        repeat_after=repeat_after,
    )


def exposure(start_ns: int = 10**9, duration_s: float = 0.01, gain: float = 1.0) -> Exposure:
    return Exposure(0, start_ns, duration_s, gain, slice(0, 30), slice(0, 40))


def mean_of(image: np.ndarray, expected: float) -> None:
    """Five standard errors of the mean of Poisson counts."""
    assert image.mean() == pytest.approx(expected + 100, abs=5 * math.sqrt(expected / image.size) + 0.02)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 157.0])
def test_standing_polarizer(degrees: float) -> None:
    world = World()
    world.polarizer_rad.hold(math.radians(degrees), 0)
    mean_of(view(world, extinction=50.0).take(exposure()), intensity(math.radians(degrees), 50.0))


def test_polarizer_that_turns_during_the_exposure() -> None:
    world = World()
    # It turns by 60 degrees in 8 ms, starting 3 ms into the exposure of 10 ms: the frame is the mean over time.
    start, stop = math.radians(10), math.radians(70)
    world.polarizer_rad.hold(start, 0)
    world.polarizer_rad.move(start, stop, 10**9 + 3_000_000, 10**9 + 11_000_000)
    turning, _ = quad(lambda t: intensity(start + (stop - start) * t / 8.0), 0.0, 7.0)
    expected = (3.0 * intensity(start) + turning) / 10.0
    image = view(world).take(exposure())
    # The trapezoidal rule over 32 steps misses the kink at 3 ms by at most a step's worth of the slope: 2e-3 of it.
    assert image.mean() == pytest.approx(expected + 100, abs=5 * math.sqrt(expected / image.size) + 2e-3 * expected)
    assert abs(expected - intensity(start)) > 0.1 * expected


def test_exposure_before_the_turn_sees_nothing_of_it() -> None:
    world = World()
    world.polarizer_rad.move(0.0, 1.0, 10**9 + 10_000_001, 2 * 10**9)
    mean_of(view(world).take(exposure()), intensity(0.0))


def test_exposure_time_and_gain() -> None:
    world = World()
    mean_of(view(world).take(exposure(duration_s=0.005)), intensity(0.0) / 2)
    amplified = view(world).take(exposure(gain=2.0))
    light = intensity(0.0)
    assert amplified.mean() == pytest.approx(2 * light + 100, abs=10 * math.sqrt(light / amplified.size) + 0.02)
    # Gain amplifies the noise of the photo-electrons with them: variance 4 x light, within 6 sqrt(2 / n).
    assert amplified.var() == pytest.approx(4 * light, rel=6 * math.sqrt(2 / amplified.size))


@pytest.mark.parametrize("mosaic", [SONY_MOSAIC, Mosaic(((0, 135), (45, 90)))])
def test_mosaic_does_not_care_for_the_rig_s_polarizer(mosaic: Mosaic) -> None:
    world = World()
    world.polarizer_rad.hold(0.7, 0)
    image = view(world, mosaic=mosaic).take(exposure())
    for i in range(2):
        for k in range(2):
            mean_of(image[i::2, k::2], intensity(math.radians(mosaic.angles_deg[i][k])))


def test_repeated_frames() -> None:
    seen = view(World(), repeat_after=3)
    frames = [seen.take(exposure()).tobytes() for _ in range(7)]
    assert frames[0:3] == frames[3:6]
    assert frames[6] == frames[0]
    assert len(set(frames)) == 3


TWO_WALLS = """
name = "wall"
[sun]
azimuth_deg = 180.0
elevation_deg = 40.0
counts = 40000.0
background_s0 = 0.1
[[surface]]
name = "wall"
corner_m = [-1.2, 6.0, -1.6]
edge_u_m = [1.1, 0.0, 0.0]
edge_v_m = [0.0, 0.0, 1.5]
s0 = 0.7
dolp = 0.45
aop_deg = 30.0
"""


def test_frames_are_those_of_the_camera_in_process(tmp_path: object) -> None:
    from pathlib import Path

    from hw_mocks.scene_file import load_scene

    path = Path(str(tmp_path)) / "scene.toml"
    path.write_text(TWO_WALLS)
    world = World()
    world.polarizer_rad.hold(math.radians(45.0), 0)
    shape = {"width_px": 64, "height_px": 48}
    sensor = {"black_level_counts": 200.0, "read_noise_counts": 5.0}
    with WorldServer(world) as server:
        values = {**shape, **sensor, "exposure_s": 0.001, "seed": 4}
        inside = SceneCamera(SceneCamera.Options(scene_file=str(path), world_url=server.url, **values))  # type: ignore[arg-type]
        inside.open()
        inside.trigger()
        frame = None
        while frame is None:
            frame = inside.poll()
        inside.close()
    settings = Settings(exposure_s=0.001, seed=4, sensor=Sensor(200.0, 1.0, 5.0))
    optics = Optics(64, 48)
    with (
        GigeCamera(load_scene(path), world, port=0, optics=optics, settings=settings) as camera,
        Client(camera) as client,
    ):
        client.open()
        client.put("AcquisitionMode", 1)
        client.start()
        data, _ = image_of(client.take())
        camera.check()
    np.testing.assert_array_equal(data.view("<u2").reshape(48, 64), frame.image)
