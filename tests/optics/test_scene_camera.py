"""The simulated camera: Malus' law, noise, reproducibility, clipping, and what happens when its rig is gone."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from optics_session import SCENE, SIZE, options, take

from drivers.camera.process import CameraProcess
from drivers.contracts import Camera
from drivers.errors import DeviceError, DeviceLost
from hw_mocks.scene_camera import SceneCamera
from hw_mocks.scene_file import load_scene
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer
from processing.optics.camera_model import Pinhole
from processing.scene.optical import stokes_image, sun_cosine


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
def url(world: World) -> Iterator[str]:
    with WorldServer(world) as server:
        yield server.url


def surfaces(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Mask of each wall, and its true S0, S1, S2 in counts (closed form: reflectance x cosine of the sun x counts)."""
    scene = load_scene(path)
    pinhole = Pinhole(0.008, 8 * 8.3e-6, *SIZE, depression_rad=math.radians(9.0))
    _, index = stokes_image(scene, pinhole)
    truth = [
        np.array(s.stokes) * sun_cosine(s, pinhole, scene.sun_direction) * scene.sun_counts for s in scene.surfaces
    ]
    return np.stack([index == number for number in range(len(truth))]), np.array(truth)


@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0, 90.0, 120.0, 300.0])
def test_frames_obey_malus_law_with_an_imperfect_polarizer(scene: Path, world: World, url: str, degrees: float) -> None:
    camera = SceneCamera(options(scene, url, extinction_ratio=20.0))
    camera.open()
    world.polarizer_rad.hold(math.radians(degrees))
    frame = take(camera)
    camera.close()
    masks, truth = surfaces(scene)
    for mask, (s0, s1, s2) in zip(masks, truth, strict=True):
        # Equations, 2.18: I = [(q + r) S0 + (q - r) (S1 cos 2t + S2 sin 2t)] / 2 with q = 1, r = 1 / 20; black 200.
        angle = 2 * math.radians(degrees)
        expected = 200 + 0.5 * (1.05 * s0 + 0.95 * (s1 * math.cos(angle) + s2 * math.sin(angle)))
        values = frame.image[mask].astype(float)
        variance = expected - 200 + 12**2 + 1 / 12
        assert mask.sum() > 150
        # Five standard errors of the mean; six of the variance (Poisson is nearly normal here: sqrt(2 / n)).
        assert values.mean() == pytest.approx(expected, abs=5 * math.sqrt(variance / mask.sum()))
        assert values.var() == pytest.approx(variance, rel=6 * math.sqrt(2 / mask.sum()))


def test_frames_depend_on_seed_angle_and_number_alone(scene: Path, world: World, url: str) -> None:
    def run(seed: int, degrees: tuple[float, ...]) -> list[bytes]:
        camera = SceneCamera(options(scene, url, seed))
        camera.open()
        taken = []
        for angle in degrees:
            world.polarizer_rad.hold(math.radians(angle))
            taken += [take(camera).image.tobytes() for _ in range(2)]
        camera.close()
        return taken

    first = run(3, (0.0, 45.0))
    # The same settings in another order, then again: the same frames.
    assert run(3, (45.0, 0.0)) == first[2:] + first[:2]
    assert run(3, (0.0, 45.0)) == first
    # Frames of one setting differ from one another, and so do seeds.
    assert len(set(first)) == 4
    assert not set(run(4, (0.0, 45.0))) & set(first)


def test_bright_light_clips_and_never_wraps(scene: Path, world: World, url: str) -> None:
    bright = scene.with_name("bright.toml")
    bright.write_text(SCENE.replace("counts = 40000.0", "counts = 4000000.0"))
    for limit in (65_535, 4095):
        camera = SceneCamera(options(bright, url, saturation_counts=limit))
        camera.open()
        image = take(camera).image
        camera.close()
        masks, _ = surfaces(bright)
        assert image.dtype == np.uint16
        assert (image[masks.any(axis=0)] == limit).all()


def test_darkness_does_not_wrap_either(scene: Path, url: str) -> None:
    dark = scene.with_name("dark.toml")
    dark.write_text(SCENE.replace("counts = 40000.0", "counts = 0.001"))
    camera = SceneCamera(options(dark, url, black_level_counts=0.0))
    camera.open()
    image = take(camera).image
    camera.close()
    # Half of the read noise (12 counts) is below zero: cut off there.
    assert image.max() < 100
    assert 0.4 < np.mean(image == 0) < 0.6


def test_contract_and_records(scene: Path, url: str) -> None:
    camera = SceneCamera(options(scene, url, exposure_s=0.02))
    assert isinstance(camera, Camera)
    assert camera.open().name == "simulated camera looking at 'two walls'"
    assert camera.poll() is None
    camera.trigger()
    assert camera.poll() is None
    camera.make_safe()
    frames = [take(camera) for _ in range(2)]
    assert [frame.frame_id for frame in frames] == [0, 1]
    assert camera.shape == frames[0].image.shape == (SIZE[1], SIZE[0])
    # The camera's clock and the host's run alike here.
    span = (frames[1].t_host_ns - frames[0].t_host_ns) * 1e-9
    assert frames[1].t_device_s - frames[0].t_device_s == pytest.approx(span, abs=1e-9)
    assert span >= 0.02
    fix = camera.clock()
    assert fix is not None
    assert fix.t_device_s > frames[1].t_device_s
    assert camera.lost_frames == 0
    camera.close()
    camera.close()
    assert camera.clock() is None
    for act in (camera.trigger, camera.poll):
        with pytest.raises(DeviceLost, match="not open"):
            act()


def test_a_simulated_rig_that_is_gone_is_lost(scene: Path) -> None:
    with WorldServer(World()) as server:
        camera = SceneCamera(options(scene, server.url))
        camera.open()
        take(camera)
    with pytest.raises(DeviceError):
        camera.trigger()
    assert camera.poll() is None
    with pytest.raises(DeviceError):
        camera.open()
    camera.close()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"scene_file": "nowhere.toml"}, "nowhere.toml"),
        ({"world_url": "tcp://192.0.2.1:5?token=a"}, "no address of a simulated rig"),
    ],
)
def test_wrong_options_are_device_errors(scene: Path, url: str, wrong: dict[str, str], words: str) -> None:
    camera = SceneCamera(replace(options(scene, url), **wrong))
    with pytest.raises(DeviceError, match=words):
        camera.open()
    camera.close()


@pytest.mark.parametrize("wrong", [{"extinction_ratio": 1.0}, {"electrons_per_count": 0.0}, {"seed": -1}])
def test_impossible_numbers_are_refused(scene: Path, wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SceneCamera(options(scene, "tcp://127.0.0.1:1?token=a", **wrong))


def test_in_a_process_of_its_own_it_gives_the_same_frames(scene: Path, world: World, url: str) -> None:
    world.polarizer_rad.hold(0.5)
    inside = SceneCamera(options(scene, url, 7))
    inside.open()
    expected = take(inside)
    inside.close()
    outside = CameraProcess("scene", options(scene, url, 7))
    try:
        outside.open()
        frame = take(outside)  # type: ignore[arg-type]
        np.testing.assert_array_equal(frame.image, expected.image)
        assert frame.image.dtype == np.uint16
        fix = outside.clock()
        assert fix is not None
        # One monotonic clock for all processes of the host: the fix lies after the frame.
        assert fix.t_host_ns > frame.t_host_ns
        assert fix.t_device_s > frame.t_device_s
    finally:
        outside.close()
