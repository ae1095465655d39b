"""A sound card that is a file: exact, not paced. For tests of the driver."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card.paths import alsa_environment

DEVICE = "polfuse_file"


class AlsaFile:
    """An ALSA capture device that plays int16 stereo samples (frames, 2) as fast as they are read.

    After the file's end stale samples follow, not an error; read no further.
    """

    device = DEVICE

    def __init__(self, samples: NDArray[np.int16]) -> None:
        self._directory = Path(tempfile.mkdtemp(prefix="polfuse-alsa-"))
        raw, conf = self._directory / "samples.raw", self._directory / "asound.conf"
        raw.write_bytes(np.ascontiguousarray(samples, dtype="<i2").tobytes())
        conf.write_text(
            f"pcm.{DEVICE} {{\n"
            "  type file\n  slave.pcm { type null }\n  file /dev/null\n"
            f'  infile "{raw}"\n  format raw\n'
            f'  hint {{ show on description "{DEVICE}" }}\n'
            "}\n",
            encoding="utf-8",
        )
        self.environment = alsa_environment(conf)

    def close(self) -> None:
        """Remove the file. Idempotent."""
        shutil.rmtree(self._directory, ignore_errors=True)
