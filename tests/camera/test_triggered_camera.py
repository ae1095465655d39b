"""The harvesters driver on a triggered 16 bit camera of our own behind harvesters' own interface.

The simulated camera of the genicam package has no trigger, no 16 bits and never fails; this one does.
"""

import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from camera_node_map import PFNC, Node, NodeMap

from drivers.camera.harvesters_camera import HarvestersCamera
from drivers.contracts import ExposureControl
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import Frame

core = pytest.importorskip("harvesters.core", reason="install with: pip install 'polfuse-lab[camera]'")

SHAPE = (4, 6)


class Unplugged(Node):
    def __getattribute__(self, name: str) -> Any:
        if name == "value":
            raise OSError("device lost (Message from the source: none)")
        return super().__getattribute__(name)


class Acquirer:
    """Answers each software trigger with one frame, unless told otherwise."""

    Events = core.ImageAcquirer.Events
    num_buffers = 3

    def __init__(self) -> None:
        self.nodes = {
            "PixelFormat": Node("Mono8", symbolics=("Mono8", "Mono16")),
            "Width": Node(SHAPE[1], 1, 100),
            "Height": Node(SHAPE[0], 1, 100),
            "ExposureTimeAbs": Node(100.0, 10.0, 1e6),
            "Gain": Node(0.0, 0.0, 24.0),
            "TriggerSelector": Node("AcquisitionStart", symbolics=("AcquisitionStart", "FrameStart")),
            "TriggerMode": Node("Off", symbolics=("Off", "On")),
            "TriggerSource": Node("Line1", symbolics=("Line1", "Software")),
            "TriggerSoftware": Node(None, on_execute=self.fire),
            "TimestampLatch": Node(None),
            "TimestampLatchValue": Node(5_000_000_000),
        }
        self.remote_device = SimpleNamespace(node_map=NodeMap(self.nodes))
        self.callbacks: list[Any] = []
        self.waiting: list[Any] = []
        self.next_id = 10
        self.incomplete = 0
        self.mute = False
        self.queued = 0
        self.memory: np.ndarray[Any, np.dtype[Any]] = np.zeros(SHAPE, dtype=np.uint16)
        self.code = 0

    def fire(self) -> None:
        if self.mute:
            return
        self.next_id += 1
        if self.incomplete:
            self.incomplete -= 1
            self.waiting.append(None)
            return
        self.waiting.append(self.next_id)

    def add_callback(self, event: object, callback: Any) -> None:
        assert event == self.Events.INCOMPLETE_BUFFER
        self.callbacks.append(callback)

    def try_fetch(self, *, timeout: float, is_raw: bool) -> Any:
        assert is_raw, "harvesters raises KeyError for pixel formats that it does not know, and keeps the buffer"
        assert timeout > 0, "harvesters waits for ever when the time-out is 0"
        if not self.waiting:
            return None
        frame_id = self.waiting.pop(0)
        if frame_id is None:
            for callback in self.callbacks:
                callback.emit(None)
            return None
        # The producer's memory is used again for the next frame.
        self.memory[:] = frame_id * 100 % 65_536
        return SimpleNamespace(
            frame_id=frame_id,
            timestamp_ns=frame_id * 1e6,
            width=self.memory.shape[1],
            height=self.memory.shape[0],
            pixel_format=self.code or PFNC[self.nodes["PixelFormat"].value],
            image_offset=0,
            padding_x=0,
            size_filled=self.memory.nbytes,
            raw_buffer=self.memory.tobytes(),
            parent=SimpleNamespace(queue_buffer=self._queue),
        )

    def _queue(self, _: object) -> None:
        self.queued += 1
        self.memory[:] = 0

    def start(self) -> None: ...
    def stop(self) -> None: ...
    def destroy(self) -> None: ...


@pytest.fixture
def acquirer(monkeypatch: pytest.MonkeyPatch) -> Acquirer:
    made = Acquirer()

    class Harvester:
        device_info_list = (SimpleNamespace(vendor="Maker", model="M16", serial_number="7"),)

        def add_file(self, *_: object, **__: object) -> None: ...
        def update(self) -> None: ...
        def create(self, _: object) -> Acquirer:
            return made

        def reset(self) -> None: ...

    monkeypatch.setattr(core, "Harvester", Harvester)
    return made


@pytest.fixture
def camera(acquirer: Acquirer) -> Iterator[HarvestersCamera]:
    device = HarvestersCamera(HarvestersCamera.Options(exposure_s=0.003, gain_db=6.0, timeout_s=0.2))
    identity = device.open()
    assert identity.detail == "6x4 Mono16, software trigger, exposure 3 ms, gain 6 dB, viky.cti"
    yield device
    device.close()


def until(camera: HarvestersCamera, found: Callable[[], Frame | None]) -> Frame:
    deadline = time.monotonic() + 2
    while time.monotonic() < deadline:
        frame = found()
        if frame is not None:
            return frame
    raise AssertionError("no frame within 2 s")


def test_settings_are_sent_under_the_cameras_own_names(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    values = {name: node.value for name, node in acquirer.nodes.items()}
    assert values["PixelFormat"] == "Mono16"
    assert values["ExposureTimeAbs"] == pytest.approx(3000.0)
    assert values["Gain"] == 6.0
    assert (values["TriggerSelector"], values["TriggerSource"], values["TriggerMode"]) == (
        "FrameStart",
        "Software",
        "On",
    )


def test_one_frame_for_each_trigger_copied_before_its_buffer_goes_back(
    camera: HarvestersCamera, acquirer: Acquirer
) -> None:
    for expected in (11, 12, 13):
        camera.trigger()
        frame = until(camera, camera.poll)
        assert frame.frame_id == expected
        np.testing.assert_array_equal(frame.image, np.full(SHAPE, expected * 100, dtype=np.uint16))
        assert frame.t_device_s == pytest.approx(expected * 1e-3)
        assert frame.exposure_s == pytest.approx(0.003)
        assert frame.gain_db == 6.0
    assert acquirer.queued == 3
    assert camera.lost_frames == 0


def test_an_incomplete_frame_is_counted_and_asked_for_again(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    camera.trigger()
    until(camera, camera.poll)
    acquirer.incomplete = 2
    camera.trigger()
    frame = until(camera, camera.poll)
    assert frame.frame_id == 14
    assert frame.lost_before == 2
    assert camera.lost_frames == 2
    camera.trigger()
    assert until(camera, camera.poll).lost_before == 0


def test_gaps_in_the_numbering_are_lost_frames(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    camera.trigger()
    until(camera, camera.poll)
    acquirer.next_id += 3
    camera.trigger()
    assert until(camera, camera.poll).lost_before == 3
    assert camera.lost_frames == 3


def test_stale_frames_are_given_back_before_a_trigger(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    acquirer.fire()
    acquirer.fire()
    camera.trigger()
    assert until(camera, camera.poll).frame_id == 13
    assert acquirer.queued == 3


def test_an_overdue_frame_is_a_timeout_and_the_next_one_works(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    acquirer.mute = True
    camera.trigger()
    start = time.monotonic()
    with pytest.raises(DeviceTimeout, match=r"no frame within 0.2 s"):
        until(camera, camera.poll)
    assert 0.2 <= time.monotonic() - start < 1
    assert camera.poll() is None
    acquirer.mute = False
    camera.trigger()
    assert until(camera, camera.poll).frame_id == 11


def test_an_unplugged_camera_is_lost_not_late(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    acquirer.mute = True
    camera.trigger()
    acquirer.nodes["Width"] = Unplugged(0)
    with pytest.raises(DeviceLost, match=r"does not answer any more \(device lost\)"):
        until(camera, camera.poll)


def test_a_frame_of_another_size_is_refused(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    acquirer.memory = np.zeros((4, 5), dtype=np.uint16)
    camera.trigger()
    with pytest.raises(DeviceError, match="expected"):
        until(camera, camera.poll)
    # Its buffer went back all the same.
    assert acquirer.queued == 1


def test_the_cameras_clock(camera: HarvestersCamera) -> None:
    before = time.monotonic_ns()
    fix = camera.clock()
    assert fix is not None
    assert fix.t_device_s == 5.0
    assert before <= fix.t_host_ns <= time.monotonic_ns()
    assert fix.round_trip_ns >= 0


def test_the_exposure_can_be_set_between_frames(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    assert isinstance(camera, ExposureControl)
    assert camera.exposure_limits() == pytest.approx((10e-6, 1.0))
    assert camera.set_exposure(0.004) == pytest.approx(0.004)
    assert acquirer.nodes["ExposureTimeAbs"].value == pytest.approx(4000.0)
    camera.trigger()
    assert until(camera, camera.poll).exposure_s == pytest.approx(0.004)
    with pytest.raises(DeviceRefused, match=r"ExposureTime: found 2e\+06, allowed: 10.0 to 1000000.0|found 2000000.0"):
        camera.set_exposure(2.0)
    del acquirer.nodes["ExposureTimeAbs"]
    for act in (lambda: camera.set_exposure(0.001), camera.exposure_limits):
        with pytest.raises(DeviceRefused, match="cannot be set"):
            act()


def test_a_frame_in_another_format_is_refused_by_its_code(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    # RGB8 of PFNC: harvesters' own fetch would fail here with KeyError or unpack nonsense.
    acquirer.code = 0x02180014
    camera.trigger()
    with pytest.raises(DeviceBadAnswer, match=r"in pixel format 0x02180014, expected 0x01100007 \(Mono16\)"):
        until(camera, camera.poll)
    assert acquirer.queued == 1
    acquirer.code = 0
    camera.trigger()
    assert until(camera, camera.poll).image.shape == SHAPE


def test_frame_numbers_of_16_bits_go_round_without_loss(camera: HarvestersCamera, acquirer: Acquirer) -> None:
    acquirer.next_id = 0xFFFD
    ids = []
    for _ in range(4):
        if acquirer.next_id == 0xFFFF:
            # GigE Vision 1: block 0 does not exist.
            acquirer.next_id = 0
        camera.trigger()
        ids.append(until(camera, camera.poll).frame_id)
    assert ids == [0xFFFE, 0xFFFF, 1, 2]
    # Between the fixture's first frame and the second nothing was fetched, so the jump there counts nothing.
    assert camera.lost_frames == 0
    acquirer.next_id = 0xFFFD
    camera.trigger()
    until(camera, camera.poll)
    lost = camera.lost_frames
    acquirer.next_id = 2
    camera.trigger()
    # 0xFFFF, 1 and 2 are missing between 0xFFFE and 3.
    assert until(camera, camera.poll).lost_before == 3
    assert camera.lost_frames == lost + 3


def test_incomplete_frames_before_a_trigger_do_not_let_stale_ones_through(
    camera: HarvestersCamera, acquirer: Acquirer
) -> None:
    acquirer.waiting += [None, 11]
    acquirer.next_id = 11
    camera.trigger()
    assert until(camera, camera.poll).frame_id == 12
    assert camera.lost_frames == 1


def test_a_camera_that_is_gone_is_lost_before_the_frame_is_overdue(acquirer: Acquirer) -> None:
    device = HarvestersCamera(HarvestersCamera.Options(timeout_s=30.0))
    device.open()
    acquirer.mute = True
    acquirer.nodes["Width"] = Unplugged(0)
    start = time.monotonic()
    device.trigger()
    with pytest.raises(DeviceLost, match="does not answer any more"):
        until(device, device.poll)
    assert time.monotonic() - start < 2
    device.close()


def test_a_line_trigger_waits_for_the_line_and_says_so(acquirer: Acquirer) -> None:
    device = HarvestersCamera(HarvestersCamera.Options(trigger="line", timeout_s=0.2))
    assert "trigger on Line1" in device.open().detail
    device.trigger()
    assert device.poll() is None
    acquirer.fire()
    assert until(device, device.poll).frame_id == 11
    device.trigger()
    with pytest.raises(DeviceTimeout, match=r"no frame within 0\.2 s of its trigger on Line1"):
        until(device, device.poll)
    device.close()


def test_chunks_tell_a_frames_own_time_and_exposure(acquirer: Acquirer) -> None:
    acquirer.nodes |= {
        "ChunkModeActive": Node(False),
        "ChunkSelector": Node("Timestamp", symbolics=("Timestamp", "ExposureTime")),
        "ChunkEnable": Node(False),
        "ChunkTimestamp": Node(250_000_000),
        "ChunkExposureTime": Node(2999.0),
        "GevTimestampTickFrequency": Node(125_000_000),
    }
    device = HarvestersCamera(HarvestersCamera.Options(chunks=True))
    device.open()
    device.trigger()
    frame = until(device, device.poll)
    # 250e6 ticks of 125 MHz.
    assert frame.t_device_s == 2.0
    assert frame.exposure_s == pytest.approx(2.999e-3)
    device.close()
