"""The harvesters driver on the simulated camera that the genicam package brings along."""

import math
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.camera.harvesters_camera import HarvestersCamera
from drivers.contracts import Camera
from drivers.errors import DeviceError, DeviceLost, DeviceRefused
from drivers.records import Frame

pytest.importorskip("harvesters", reason="install with: pip install 'polfuse-lab[camera]'")

Options = HarvestersCamera.Options


@pytest.fixture
def camera() -> Iterator[HarvestersCamera]:
    device = HarvestersCamera(Options(width_px=320, height_px=200, device="green", timeout_s=3))
    yield device
    device.close()


def take(camera: Camera) -> Frame:
    camera.trigger()
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        frame = camera.poll()
        if frame is not None:
            return frame
    raise AssertionError("no frame within 5 s")


def test_frames_are_what_was_asked_for(camera: HarvestersCamera) -> None:
    identity = camera.open()
    assert isinstance(camera, Camera)
    assert "Viky 1" in identity.name
    # The simulated camera has neither; that is told, not hidden.
    assert "lacks ExposureTime, TriggerMode" in identity.detail
    assert "free running" in identity.detail
    assert camera.shape == (200, 320)
    frames = [take(camera) for _ in range(3)]
    for frame in frames:
        assert frame.image.shape == (200, 320)
        assert frame.image.dtype == np.uint8
        # A white picture with a ball: neither empty nor flat.
        assert 200 < frame.image.mean() < 255
        assert frame.image.min() < 200
        assert not frame.incomplete
        # This producer has no time stamps: undefined, not zero.
        assert math.isnan(frame.t_device_s)
    assert camera.lost_frames == 0
    assert camera.clock() is None


def test_a_frame_is_exposed_after_its_trigger(camera: HarvestersCamera) -> None:
    camera.open()
    first = take(camera)
    # 20 frames/s fill the producer's buffers meanwhile: what was exposed before the trigger is passed over. Numbers
    # count exposures, so a stale frame would follow its predecessor at once.
    time.sleep(0.5)
    before = time.monotonic_ns()
    second = take(camera)
    assert second.frame_id >= first.frame_id + 3
    # Two frame periods (50 ms) pass before the third frame after the trigger, less one tenth for the pacing.
    assert second.t_host_ns - before > 0.09e9


def test_frames_do_not_change_when_their_buffer_is_filled_again(camera: HarvestersCamera) -> None:
    camera.open()
    first = take(camera)
    kept = first.image.copy()
    for _ in range(4):
        take(camera)
    np.testing.assert_array_equal(first.image, kept)


def test_polling_without_a_trigger_gives_nothing(camera: HarvestersCamera) -> None:
    camera.open()
    assert camera.poll() is None
    camera.trigger()
    camera.make_safe()
    assert camera.poll() is None


def test_it_opens_again_after_closing(camera: HarvestersCamera) -> None:
    for _ in range(2):
        camera.open()
        take(camera)
        camera.close()
        camera.close()
    for act in (camera.trigger, camera.poll, camera.clock, lambda: camera.shape):
        with pytest.raises(DeviceLost, match="not open"):
            act()


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        (Options(pixel_format="RGBa8"), DeviceRefused, "found 'RGBa8', allowed: Mono16, Mono12p"),
        (Options(pixel_format="Mono16"), DeviceRefused, "allowed: RGBa8, Mono8"),
        (Options(width_px=5000), DeviceRefused, "Width: found 5000, allowed: 100 to 800"),
        (Options(device="XYZ-123"), DeviceLost, "no such camera .found: .*Viky 0"),
        (Options(cti="/nowhere/vendor.cti"), DeviceError, "vendor.cti does not exist"),
        (Options(cti=__file__), DeviceLost, "could not be opened"),
    ],
)
def test_what_cannot_be_is_refused_in_words(options: HarvestersCamera.Options, kind: type, words: str) -> None:
    device = HarvestersCamera(options)
    with pytest.raises(kind, match=words):
        device.open()
    device.close()


@pytest.mark.parametrize("wrong", [{"exposure_s": 0.0}, {"timeout_s": -1.0}, {"gain_db": float("nan")}])
def test_impossible_options_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        HarvestersCamera(Options(**wrong))  # type: ignore[arg-type]


def test_the_bundled_producer_is_found_where_genicam_is() -> None:
    import genicam

    assert (Path(genicam.__file__).parent / "viky.cti").is_file()


def test_only_the_addresses_given_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.camera.producers import ask_only

    monkeypatch.setenv("POLFUSE_GENTL_INTERFACE", "eth7")
    monkeypatch.setenv("POLFUSE_GENTL_CAMERAS", "192.0.2.1")
    own = Path("polfuse-aravis.cti")
    ask_only((), own, "camera")
    assert os.environ["POLFUSE_GENTL_CAMERAS"] == "192.0.2.1", "without addresses nothing changes"
    ask_only(("127.0.0.1", "192.0.2.20"), own, "camera")
    assert os.environ["POLFUSE_GENTL_CAMERAS"] == "127.0.0.1,192.0.2.20"
    # An interface would be asked by broadcast.
    assert "POLFUSE_GENTL_INTERFACE" not in os.environ
    for wrong in ("255.255.255.255", "0.0.0.0", "224.0.0.1", "camera.local", "127.0.0.1,127.0.0.2", ""):
        with pytest.raises(DeviceRefused, match="addresses"):
            ask_only((wrong,), own, "camera")
    with pytest.raises(DeviceRefused, match="cannot be told"):
        HarvestersCamera(Options(addresses=("127.0.0.1",))).open()
