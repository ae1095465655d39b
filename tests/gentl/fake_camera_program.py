"""Run in a network namespace of its own: our driver against Aravis' fake camera, through the producer.

Prints one JSON object. Arguments: the producer, the fake camera's program.
"""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from drivers.camera.harvesters_camera import HarvestersCamera
from drivers.errors import DeviceError
from drivers.records import Frame

SHAPE = (96, 128)
STEP_AND_WHITE = {"Mono8": (1, 255), "Mono16": (256, 65_535)}


def start(program: str) -> subprocess.Popen[bytes]:
    camera = subprocess.Popen([program, "-i", "127.0.0.1"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # DISCOVERY_CMD of the GigE Vision standard, until it is answered.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        control.settimeout(0.1)
        end = time.monotonic() + 10
        while time.monotonic() < end:
            control.sendto(bytes([0x42, 1, 0, 2, 0, 0, 0, 1]), ("127.0.0.1", 3956))
            try:
                control.recv(1024)
                return camera
            except OSError:
                time.sleep(0.05)
    camera.kill()
    raise TimeoutError("the fake camera does not answer")


def take(camera: HarvestersCamera) -> Frame:
    camera.trigger()
    end = time.monotonic() + 15
    while (frame := camera.poll()) is None:
        if time.monotonic() > end:
            raise TimeoutError("no frame within 15 s")
    return frame


def is_pattern(frame: Frame, name: str) -> bool:
    """Whether every pixel is Aravis' diagonal ramp, step (x + y + frame number) modulo white, at gain 0 and 10 ms."""
    step, white = STEP_AND_WHITE[name]
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return bool(np.array_equal(frame.image, step * (x + y + frame.frame_id) % white))


def main(cti: str, program: str) -> dict[str, object]:
    told: dict[str, object] = {}
    fake = start(program)
    try:
        for name in STEP_AND_WHITE:
            options = HarvestersCamera.Options(
                cti=cti, pixel_format=name, width_px=SHAPE[1], height_px=SHAPE[0], exposure_s=0.01, timeout_s=3.0
            )
            camera = HarvestersCamera(options)
            identity = camera.open()
            frames = [take(camera) for _ in range(4)]
            told[name] = {
                "detail": identity.detail,
                "types": sorted({str(frame.image.dtype) for frame in frames}),
                "numbers": [frame.frame_id for frame in frames],
                "exact": [is_pattern(frame, name) for frame in frames],
                "stamps_s": [frame.t_device_s for frame in frames],
                "exposure_s": frames[0].exposure_s,
            }
            if name != "Mono16":
                camera.close()
        fake.kill()
        fake.wait()
        begun = time.monotonic()
        try:
            take(camera)
            told["lost"] = ""
        except DeviceError as error:
            told["lost"] = f"{type(error).__name__}: {error}"
        told["lost_after_s"] = time.monotonic() - begun
        begun = time.monotonic()
        camera.close()
        told["closed_after_s"] = time.monotonic() - begun
        try:
            camera.open()
            told["absent"] = ""
        except DeviceError as error:
            told["absent"] = str(error)
        fake = start(program)
        camera.open()
        told["after_return"] = is_pattern(take(camera), "Mono16")
        camera.close()
    finally:
        fake.kill()
        fake.wait()
    return told


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], str(Path(sys.argv[2])))))
