"""The rig file and the reader of all files that users write."""

from polfuse_lab.rig.model import (
    CameraSection,
    DeviceSection,
    Geometry,
    PhaseCentres,
    PolarizerSection,
    RadarSection,
    Rig,
    Site,
    StorageSection,
    SwitchesSection,
    TrolleySection,
    Waveform,
    driver_options,
    load_rig,
)
from polfuse_lab.rig.toml_model import FileMistake, FileModel, parse_model, read_model

__all__ = [
    "CameraSection",
    "DeviceSection",
    "FileMistake",
    "FileModel",
    "Geometry",
    "PhaseCentres",
    "PolarizerSection",
    "RadarSection",
    "Rig",
    "Site",
    "StorageSection",
    "SwitchesSection",
    "TrolleySection",
    "Waveform",
    "driver_options",
    "load_rig",
    "parse_model",
    "read_model",
]
