"""Run in a network namespace of its own: harvesters, through the producer, against a simulated camera whose packets get
lost, and whose frames carry chunks.

Prints one JSON object. Argument: the producer.
"""

import json
import multiprocessing
import sys
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from harvesters.core import Callback, Harvester

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.world import World

SHAPE = (240, 320)
FRAMES = 30
READ_WRITE = 4
"""GenApi's access mode RW."""


def is_pattern(image: np.ndarray) -> bool:
    """Whether every pixel is the pattern's, whatever the frame's number."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    offset = (image.astype(np.int64) - 7 * x - 13 * y) % 65_536
    return bool((offset == offset[0, 0]).all() and offset[0, 0] % 16 == 0)


def simulate(pipe: Connection) -> None:
    """The camera, in a process of its own: harvesters holds the interpreter's lock while it waits for answers."""
    faults = FaultScript()
    settings = Settings(frame_rate_hz=20.0, exposure_s=0.001)
    with GigeCamera(Pattern(*SHAPE), World(), settings=settings, faults=faults) as device:
        pipe.send("ready")
        while (command := pipe.recv()) is not None:
            name, kind, amount = command
            if name == "start":
                faults.start(FaultKind[kind], amount=amount)
            else:
                faults.stop(FaultKind[kind])
            pipe.send(dict(device.counts))


def watch(cti: str, fault: Any) -> dict[str, object]:
    told: dict[str, object] = {}
    incomplete = 0

    class Incomplete(Callback):  # type: ignore[misc]
        def emit(self, context: object | None = None) -> None:
            nonlocal incomplete
            incomplete += 1

    harvester = Harvester()
    harvester.add_file(cti)
    harvester.update()
    acquirer = harvester.create(0)
    acquirer.add_callback(acquirer.Events.INCOMPLETE_BUFFER, Incomplete())
    acquirer.num_buffers = 8
    nodes = acquirer.remote_device.node_map
    nodes.PixelFormat.value = "Mono16"
    nodes.TriggerMode.value = "Off"

    fault("start", "DROP_PACKETS", 0.02)
    acquirer.start()
    exact, numbers = [], []
    for _ in range(FRAMES):
        with acquirer.fetch(timeout=5) as buffer:
            numbers.append(buffer.module.frame_id)
            exact.append(is_pattern(buffer.payload.components[0].data.reshape(SHAPE)))
    counts = fault("stop", "DROP_PACKETS", 0.0)
    told["exact"], told["numbers"] = exact, numbers
    told["dropped"], told["resent"] = counts["packets dropped"], counts["packets sent again"]
    told["incomplete_of_drops"] = incomplete
    # Half a frame, and not to be had again: told, never given out as a picture.
    before = incomplete
    fault("start", "OVERFLOW", 0.0)
    for _ in range(200):
        if incomplete >= before + 3:
            break
        buffer = acquirer.try_fetch(timeout=0.05)
        if buffer is not None:
            buffer.queue()
    told["incomplete"] = incomplete - before
    fault("stop", "OVERFLOW", 0.0)
    acquirer.stop()

    nodes.ChunkModeActive.value = True
    for chunk in nodes.ChunkSelector.symbolics:
        nodes.ChunkSelector.value = chunk
        if nodes.ChunkEnable.get_access_mode() == READ_WRITE:
            nodes.ChunkEnable.value = True
    acquirer.start()
    with acquirer.fetch(timeout=5) as buffer:
        module = buffer.module
        told["has_chunks"] = bool(module.is_containing_chunk_data())
        told["payload_type"] = int(module.payload_type)
        told["filled"] = int(module.size_filled)
        told["chunk_image"] = is_pattern(buffer.payload.components[0].data.reshape(SHAPE))
    acquirer.stop()
    acquirer.destroy()
    harvester.reset()
    return told


def main(cti: str) -> dict[str, object]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    camera = context.Process(target=simulate, args=(theirs,), daemon=True)
    camera.start()
    assert ours.poll(20), "the simulated camera did not start"
    ours.recv()

    def fault(*command: object) -> Any:
        ours.send(command)
        return ours.recv()

    try:
        return watch(cti, fault)
    finally:
        ours.send(None)
        camera.join(10)


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
