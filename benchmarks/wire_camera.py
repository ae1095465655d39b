"""A simulated GigE Vision camera in a process of its own: ``python -m benchmarks.wire_camera``.

Arguments: loopback address, rows, columns, speed of its link in bits per second. Frames are the test pattern's,
over real UDP packets, at the speed of the link. Prints its address once it runs, and ends when its standard input does.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from hw_mocks.gige_camera import GigeCamera, Link, Pattern, Settings
from hw_mocks.world import World

CYCLE = 4096
"""Numbers of the pattern after which it comes again."""


def number_of(image: NDArray[np.generic]) -> int | None:
    """Number, modulo 4096, of the frame whose pattern this is; None when it is no frame's. Looks at every 8th row."""
    first = int(image[0, 0])
    rows, columns = image.shape
    wanted = np.add.outer(np.arange(0, rows, 8) * 13, np.arange(0, columns, 11) * 7) + first
    return first // 16 if first % 16 == 0 and np.array_equal(image[::8, ::11], wanted.astype(np.uint16)) else None


def main(address: str, rows: int, columns: int, bits_per_s: float) -> None:
    """Run the camera until the standard input ends."""
    settings = Settings(link=Link(bits_per_s))
    with GigeCamera(Pattern(rows, columns), World(), address, settings=settings) as camera:
        print(camera.address, flush=True)
        sys.stdin.read()
        camera.check()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
