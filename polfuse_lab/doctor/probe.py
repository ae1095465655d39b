"""``python -m polfuse_lab.doctor.probe sound|cameras PRODUCER``: asks libraries of others, and prints one JSON object.

A process of its own: a sound server may hang, and a camera's producer may crash.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def sound_inputs() -> list[str]:
    """Stereo inputs as PortAudio names them. Raises whatever sounddevice raises."""
    import sounddevice

    apis = [api["name"] for api in sounddevice.query_hostapis()]
    devices = [device for device in sounddevice.query_devices() if device["max_input_channels"] >= 2]
    return [f"{d['name']}, {apis[d['hostapi']]}, {d['default_samplerate']:g} Hz" for d in devices]


def cameras(producer: str) -> list[str]:
    """Cameras that a GenTL producer sees. Raises whatever harvesters raises."""
    from harvesters.core import Harvester

    with Harvester() as harvester:
        harvester.add_file(producer, check_existence=True, check_validity=True)
        harvester.update()
        return [f"{info.vendor} {info.model} {info.serial_number}" for info in harvester.device_info_list]


def main(words: list[str]) -> None:
    """Print what was found, or why nothing could be."""
    found: list[str] = []
    trouble = ""
    try:
        found = sound_inputs() if words == ["sound"] else cameras(words[1])
    except ImportError as error:
        trouble = f"the Python package {error.name} is not installed"
    except Exception as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        name = Path(words[-1]).name
        trouble = f"{name}: {first}" if words[0] == "cameras" else first
    print(json.dumps({"found": found, "trouble": trouble}))


if __name__ == "__main__":
    main(sys.argv[1:])
