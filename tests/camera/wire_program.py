"""Run in a network namespace of its own: our driver against the simulated GigE Vision camera, over real UDP.

Prints one JSON object. Arguments: the GenTL producer.
"""

import json
import sys
import time

import numpy as np

from drivers.camera.genicam_setup import GenicamOptions
from drivers.camera.pixel_formats import pixel_format
from drivers.camera.process import CameraProcess
from drivers.errors import DeviceError
from drivers.records import Frame
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.world import World

SHAPE = (64, 96)
FORMATS = ("Mono16", "Mono12p", "Mono12Packed", "Mono12", "Mono10p", "Mono10", "Mono8")


def take(camera: CameraProcess) -> Frame:
    camera.trigger()
    end = time.monotonic() + 5
    while (frame := camera.poll()) is None:
        if time.monotonic() > end:
            raise TimeoutError("no frame within 5 s")
        time.sleep(0.001)
    return frame


def number_of(image: np.ndarray, name: str) -> int | None:
    """Number of the frame whose pattern this is, by every pixel; None when it is no frame's."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    shift = 16 - pixel_format(name).bits
    for number in range(64):
        if np.array_equal(image, (7 * x + 13 * y + 16 * number) % 65_536 >> shift):
            return number
    return None


def main(cti: str) -> dict[str, object]:
    told: dict[str, object] = {}
    faults = FaultScript()
    settings = Settings(frame_rate_hz=100.0, exposure_s=0.001, drift_ppm=40.0)
    with GigeCamera(Pattern(*SHAPE), World(), settings=settings, faults=faults) as device:
        numbers: dict[str, list[int | None]] = {}
        for name in FORMATS:
            camera = CameraProcess("harvesters", GenicamOptions(cti=cti, pixel_format=name, exposure_s=0.001))
            try:
                identity = camera.open()
                numbers[name] = [number_of(take(camera).image, name) for _ in range(3)]
                told.setdefault("detail", identity.detail)
            finally:
                camera.close()
        told["numbers"] = numbers
        camera = CameraProcess("harvesters", GenicamOptions(cti=cti, exposure_s=0.001, gain_db=3.0, timeout_s=20.0))
        camera.open()
        fixes = []
        for _ in range(2):
            fix = camera.clock()
            frame = take(camera)
            after = camera.clock()
            assert fix is not None
            assert after is not None
            fixes.append((fix.t_device_s, frame.t_device_s, after.t_device_s))
        told["clock"] = fixes
        told["exposure_s"] = camera.set_exposure(0.0025)
        faults.start(FaultKind.DISCONNECT)
        start = time.monotonic()
        try:
            take(camera)
            told["lost"] = ""
        except DeviceError as error:
            told["lost"] = f"{type(error).__name__}: {error}"
        told["lost_after_s"] = time.monotonic() - start
        camera.close()
        faults.stop(FaultKind.DISCONNECT)
        # The camera frees the control that its lost client held once its heartbeat has been missed.
        end = time.monotonic() + 10
        while True:
            try:
                camera.reconnect()
                break
            except DeviceError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.3)
        told["after_return"] = take(camera).image.shape
        camera.close()
        device.check()
    return told


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
