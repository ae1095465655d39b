"""A camera in a process of its own: frames, errors, death and hanging of either side, nothing left behind."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from multiprocessing import shared_memory
from pathlib import Path

import numpy as np
import pytest

from drivers.camera.frame_ring import FrameRing
from drivers.camera.harvesters_camera import HarvestersCamera
from drivers.camera.process import CameraProcess
from drivers.contracts import Camera
from drivers.errors import DeviceError, DeviceLost
from drivers.records import Frame

pytest.importorskip("harvesters", reason="install with: pip install 'polfuse-lab[camera]'")

Options = HarvestersCamera.Options
posix = pytest.mark.skipif(os.name != "posix", reason="stops and kills processes with POSIX signals")


@pytest.fixture
def camera() -> Iterator[CameraProcess]:
    process = CameraProcess("harvesters", Options(pixel_format="Mono8", timeout_s=3))
    yield process
    process.close()


def take(camera: Camera, limit_s: float = 5.0) -> Frame:
    camera.trigger()
    deadline = time.monotonic() + limit_s
    while time.monotonic() < deadline:
        frame = camera.poll()
        if frame is not None:
            return frame
        time.sleep(0.001)
    raise AssertionError(f"no frame within {limit_s} s")


def watch(camera: Camera) -> None:
    """Poll until the camera raises."""
    while True:
        assert camera.poll() is None
        time.sleep(0.01)


def alive(pid: int) -> bool:
    """Whether a process exists and has not merely not been waited for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def block_exists(name: str) -> bool:
    return Path("/dev/shm", name).exists()


def gone(camera: CameraProcess) -> tuple[int, str]:
    """Pid of the camera's process and name of its shared memory."""
    assert camera.pid is not None
    assert camera._ring is not None
    return camera.pid, camera._ring.name


def test_frames_come_through_shared_memory(camera: CameraProcess) -> None:
    identity = camera.open()
    assert isinstance(camera, Camera)
    assert "Viky" in identity.name
    assert "process of its own" in identity.detail
    assert camera.pid != os.getpid()
    assert camera.shape == (400, 400)
    frames = [take(camera) for _ in range(6)]
    for frame in frames:
        assert frame.image.shape == (400, 400)
        assert frame.image.dtype == np.uint8
        assert 200 < frame.image.mean() < 255
    # More frames than slots: each is a copy of its own. The ball moves, so the pictures differ.
    assert len({frame.image.tobytes() for frame in frames}) > 1
    assert [frame.frame_id for frame in frames] == sorted({frame.frame_id for frame in frames})
    assert camera.lost_frames == 0
    assert camera.clock() is None


def test_a_new_trigger_forgets_the_frame_asked_for_before(camera: CameraProcess) -> None:
    camera.open()
    camera.trigger()
    time.sleep(0.4)
    # The first frame waits in the pipe now. What poll() gives must be exposed after the second trigger.
    before = time.monotonic_ns()
    assert take(camera).t_host_ns > before
    camera.trigger()
    camera.make_safe()
    time.sleep(0.3)
    assert camera.poll() is None


@posix
def test_a_killed_camera_process_is_lost_within_two_seconds_and_opens_again(camera: CameraProcess) -> None:
    camera.open()
    take(camera)
    pid, block = gone(camera)
    camera.trigger()
    os.kill(pid, signal.SIGKILL)
    start = time.monotonic()
    with pytest.raises(DeviceLost, match="ended with status -9"):
        watch(camera)
    assert time.monotonic() - start < 2
    with pytest.raises(DeviceLost):
        camera.trigger()
    camera.make_safe()
    camera.open()
    assert not block_exists(block)
    assert take(camera).image.shape == (400, 400)


@posix
def test_a_hung_camera_process_is_lost_within_two_seconds_and_can_be_closed(camera: CameraProcess) -> None:
    camera.open()
    pid, block = gone(camera)
    os.kill(pid, signal.SIGSTOP)
    start = time.monotonic()
    with pytest.raises(DeviceLost, match="no sign of life"):
        take(camera)
    assert time.monotonic() - start < 2
    start = time.monotonic()
    camera.close()
    # 0.2 s to close, 0.5 s after SIGTERM (which a stopped process does not take), then SIGKILL.
    assert time.monotonic() - start < 2
    assert not alive(pid)
    assert not block_exists(block)


@posix
def test_an_engine_that_is_killed_leaves_no_camera_and_no_memory_behind(tmp_path: Path) -> None:
    program = tmp_path / "engine.py"
    program.write_text(
        textwrap.dedent("""
            import time
            from drivers.camera.harvesters_camera import HarvestersCamera
            from drivers.camera.process import CameraProcess

            if __name__ == "__main__":
                camera = CameraProcess("harvesters", HarvestersCamera.Options())
                camera.open()
                camera.trigger()
                print(camera.pid, camera._ring.name, flush=True)
                time.sleep(60)
        """)
    )
    engine = subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert engine.stdout is not None
        pid, block = engine.stdout.readline().split()
        assert alive(int(pid))
        assert block_exists(block)
        engine.kill()
        engine.wait(5)
        deadline = time.monotonic() + 5
        while (alive(int(pid)) or block_exists(block)) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert not alive(int(pid))
        assert not block_exists(block)
    finally:
        engine.kill()
        engine.communicate(timeout=10)


def test_what_the_driver_raises_arrives_as_it_was_raised() -> None:
    camera = CameraProcess("harvesters", Options(device="XYZ-123"))
    with pytest.raises(DeviceLost, match=r"no such camera .found: .*Viky 0") as caught:
        camera.open()
    assert caught.value.advice == "check cable, power and option device"
    assert camera.pid is None


@pytest.mark.parametrize(
    ("driver", "options", "words"),
    [
        ("no such driver", Options(), "no camera driver is called"),
        ("harvesters", "not options", "options are str, not the driver"),
        ("harvesters", Options(exposure_s=-1.0), "exposure_s: found -1.0"),
    ],
)
def test_a_driver_that_cannot_be_made_is_a_device_error(driver: str, options: object, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        CameraProcess(driver, options).open()


@posix
def test_a_camera_that_does_not_open_in_time_is_given_up() -> None:
    camera = CameraProcess("harvesters", Options(), open_timeout_s=0.01, close_timeout_s=0.1)
    start = time.monotonic()
    with pytest.raises(DeviceError, match=r"did not open within 0.01 s"):
        camera.open()
    assert time.monotonic() - start < 2
    assert camera.pid is None


@posix
def test_closing_leaves_nothing_and_can_be_repeated(camera: CameraProcess) -> None:
    files = len(os.listdir("/proc/self/fd"))
    for _ in range(2):
        camera.open()
        pid, block = gone(camera)
        take(camera)
        camera.close()
        camera.close()
        assert not alive(pid)
        assert not block_exists(block)
    # The resource tracker, shared by all processes, keeps one pipe open after the first use.
    assert len(os.listdir("/proc/self/fd")) <= files + 1
    for act in (camera.trigger, camera.poll, camera.clock, lambda: camera.shape):
        with pytest.raises(DeviceLost, match="not open"):
            act()
    camera.make_safe()


def test_ring_keeps_each_frame_for_as_many_frames_as_it_has_slots() -> None:
    ring = FrameRing((3, 5), slots=3)
    try:
        reader = FrameRing((3, 5), slots=3, name=ring.name)
        images = [np.full((3, 5), 1000 + n, dtype=np.uint16) for n in range(5)]
        for number, image in enumerate(images):
            ring.put(number, image)
        for number in (2, 3, 4):
            np.testing.assert_array_equal(reader.get(number, "uint16"), images[number])
        ring.put(7, np.full((3, 5), 7, dtype=np.uint8))
        np.testing.assert_array_equal(reader.get(7, "uint8"), np.full((3, 5), 7))
        for wrong in (np.zeros((5, 3), np.uint16), np.zeros((3, 5), np.uint32), np.zeros((3, 5), np.int16)):
            with pytest.raises(ValueError, match="expected uint8 or uint16"):
                ring.put(0, wrong)
        time.sleep(0.02)
        assert reader.silence_s() > 0.02
        ring.beat()
        assert reader.silence_s() < 0.02
        reader.close()
    finally:
        ring.close()
        ring.close()
    with pytest.raises(FileNotFoundError):
        shared_memory.SharedMemory(name=ring.name)
