"""What a camera's process and its user say to each other: every message survives the wire, anything else is refused."""

import math
import multiprocessing
import pickle
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera import messages
from drivers.camera.genicam_setup import GenicamOptions
from drivers.camera.process import CameraProcess
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import ClockFix, Frame, Identity
from hw_mocks.scene_camera import SceneCamera
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer

SCENE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"
FIX = ClockFix("camera", 1.5, 123, 45)


@pytest.mark.parametrize(
    "answer",
    [
        messages.Opened(Identity("camera", "made", "name", "detail"), (582, 782)),
        messages.ClockTold(3, FIX),
        messages.ClockTold(3, None),
        messages.NumbersTold(4, (1e-5, 2.0)),
        messages.Failed(0, "DeviceLost", "what", "where", "advice"),
        messages.FrameTaken(1, 2, "uint16", 3, 4, 0.002, 0.0, 1.25, 6, True, 7),
    ],
)
def test_answers_survive_the_wire(answer: messages.Answer) -> None:
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        messages.say(theirs, answer)
        assert messages.hear_answer(ours) == answer


def test_requests_survive_the_wire_with_options() -> None:
    options = GenicamOptions(device="x", exposure_s=0.004, chunks=True)
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        messages.say(ours, messages.Open("harvesters", messages.pack_options(options)))
        heard = messages.hear_request(theirs)
        assert isinstance(heard, messages.Open)
        assert messages.unpack_options(GenicamOptions, heard.options) == options


def test_a_frame_without_a_time_stamp_stays_without() -> None:
    frame = Frame(np.zeros((2, 3), np.uint8), 9, 0.001, math.nan, math.nan, 77, lost_before=2)
    taken = messages.FrameTaken.of(frame, ticket=1, number=1, lost=2)
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        messages.say(theirs, taken)
        heard = messages.hear_answer(ours)
    assert isinstance(heard, messages.FrameTaken)
    back = heard.frame(frame.image)
    assert math.isnan(back.t_device_s)
    assert math.isnan(back.gain_db)
    assert (back.frame_id, back.t_host_ns, back.lost_before, heard.dtype) == (9, 77, 2, "uint8")


@pytest.mark.parametrize("kind", [DeviceError, DeviceLost, DeviceTimeout, DeviceRefused, DeviceBadAnswer])
def test_errors_arrive_as_they_were_raised(kind: type[DeviceError]) -> None:
    class Vendors(kind):  # type: ignore[valid-type,misc]
        pass

    # A vendor's own subclass is not known at the other end: it arrives as the nearest that is.
    for raised in (kind("a", where="b", advice="c"), Vendors("a", where="b", advice="c")):
        error = messages.Failed.of(1, raised).error()
        assert type(error) is kind
        assert (error.what, error.where, error.advice) == ("a", "b", "c")


@given(st.binary(max_size=200))
def test_what_is_no_message_is_refused(data: bytes) -> None:
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        theirs.send_bytes(data)
        with pytest.raises(DeviceBadAnswer, match="no message"):
            messages.hear_answer(ours)
        ours.send_bytes(data)
        with pytest.raises(EOFError):
            messages.hear_request(theirs)


def test_a_pickle_is_no_message() -> None:
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        theirs.send_bytes(pickle.dumps(("frame", 1)))
        with pytest.raises(DeviceBadAnswer):
            messages.hear_answer(ours)


def test_the_exposure_is_set_in_the_cameras_own_process() -> None:
    with WorldServer(World()) as server:
        options = SceneCamera.Options(str(SCENE), server.url, width_px=32, height_px=24, pixel_pitch_m=2e-4)
        camera = CameraProcess("scene", options)
        try:
            camera.open()
            low, high = camera.exposure_limits()
            assert low < 0.002 < high
            assert camera.set_exposure(0.004) == pytest.approx(0.004)
            first = _take(camera)
            assert first.exposure_s == pytest.approx(0.004)
            with pytest.raises(DeviceRefused, match="an exposure of 100 s"):
                camera.set_exposure(100.0)
            fix = camera.clock()
            assert fix is not None
            pid = camera.pid
            # A fresh process, and the options' own exposure again.
            camera.reconnect()
            assert camera.pid != pid
            assert _take(camera).exposure_s == pytest.approx(0.002)
        finally:
            camera.close()


def _take(camera: CameraProcess) -> Frame:
    camera.trigger()
    for _ in range(5000):
        frame = camera.poll()
        if frame is not None:
            return frame
        time.sleep(0.001)
    raise AssertionError("no frame")
