"""GenICam cameras (GigE Vision, USB3 Vision, CoaXPress …) through the vendor's GenTL producer and harvesters.

Run it in a process of its own (:class:`drivers.camera.process.CameraProcess`): fetching holds the interpreter's lock,
and some producers recover only when their process ends.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt

from drivers.camera.features import EXPOSURE, GAIN, TIMESTAMP_LATCH, Features
from drivers.errors import DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import ClockFix, Frame, Identity

_FORMATS: dict[str, type[np.unsignedinteger[Any]]] = {"Mono16": np.uint16, "Mono8": np.uint8}
_FETCH_S = 0.01
_STALE = 2
"""Frames of a free-running camera that are passed over after a trigger. A frame that arrives at t began at most two
frame periods earlier (exposure and read-out take at most one each), so only the third surely began after it."""


class HarvestersCamera:
    """Contract :class:`drivers.contracts.Camera` for GenICam cameras."""

    @dataclass(frozen=True)
    class Options:
        """Settings of a GenICam camera; what the camera lacks is skipped and named when it is opened."""

        __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

        cti: str = ""
        """GenTL producer (.cti) of the camera's vendor; empty for the simulated camera of the genicam package."""
        device: str = ""
        """Part of the camera's serial number, model or name; empty for the first one found."""
        pixel_format: str = ""
        """"Mono16" or "Mono8"; empty for the first of these that the camera has."""
        exposure_s: Annotated[float, Gt(0)] = 0.002
        """Exposure, s."""
        gain_db: Annotated[float, Ge(0)] = 0.0
        """Gain, dB."""
        width_px: Annotated[int, Ge(0)] = 0
        """Columns; 0 leaves the camera's own."""
        height_px: Annotated[int, Ge(0)] = 0
        """Rows; 0 leaves the camera's own."""
        timeout_s: Annotated[float, Gt(0)] = 5.0
        """Time in which a frame must have arrived after its trigger, s."""
        trigger: Literal["software", "free"] = "software"
        """Software trigger, or the next wholly new frame of a free-running camera."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        self._where = f"camera {options.device!r}" if options.device else "camera"
        self._harvester: Any = None
        self._acquirer: Any = None
        self._features: Features | None = None
        self._shape: tuple[int, int] | None = None
        self._dtype: type[np.unsignedinteger[Any]] = np.uint16
        self._exposure_s = options.exposure_s
        self._gain_db = options.gain_db
        self._free = False
        self._deadline: float | None = None
        self._to_skip = 0
        self._lost = 0
        self._lost_told = 0
        self._last_id: int | None = None

    def open(self) -> Identity:
        """Load the producer, find the camera, set it up and start it.

        Raises:
            DeviceError: harvesters or the producer is missing, no camera answers, or it refuses a setting.
        """
        self.close()
        try:
            with self._failures("could not be opened"):
                return self._open()
        except BaseException:
            self.close()
            raise

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        if self._shape is None:
            raise self._closed()
        return self._shape

    @property
    def lost_frames(self) -> int:
        """Frames lost (gaps in the camera's numbering while triggered) or incomplete since the camera was opened."""
        return self._lost

    def trigger(self) -> None:
        """Ask for one frame whose exposure begins after this call."""
        if self._features is None:
            raise self._closed()
        with self._failures("did not take the trigger"):
            self._drain()
            if self._free:
                self._to_skip = _STALE
            else:
                self._features.execute("TriggerSoftware")
        self._deadline = time.monotonic() + self._options.timeout_s

    def poll(self) -> Frame | None:
        """The frame asked for once it is whole, else None. An incomplete frame is counted and asked for again.

        Raises:
            DeviceTimeout: the frame is overdue, and the camera answers.
            DeviceLost: the camera does not answer.
        """
        if self._features is None:
            raise self._closed()
        if self._deadline is None:
            return None
        lost = self._lost
        with self._failures("failed while fetching a frame"):
            buffer = self._acquirer.try_fetch(timeout=_FETCH_S)
        if buffer is not None:
            return self._accept(buffer)
        if self._lost > lost and not self._free:
            with self._failures("did not take the trigger"):
                self._features.execute("TriggerSoftware")
        if time.monotonic() > self._deadline:
            self._deadline = None
            with self._failures("does not answer any more"):
                # A camera that was unplugged still "acquires"; only reading from it tells.
                self._features.value("Width")
            raise DeviceTimeout(
                f"no frame within {self._options.timeout_s:g} s of its trigger",
                where=self._where,
                advice="check the cable, the packet size and the trigger settings, or lengthen option timeout_s",
            )
        return None

    def clock(self) -> ClockFix | None:
        """The camera's clock latched now, or None where it cannot be read."""
        if self._features is None:
            raise self._closed()
        with self._failures("did not tell its time"):
            for command, value, frequency in TIMESTAMP_LATCH:
                before = time.monotonic_ns()
                if not self._features.execute(command):
                    continue
                after = time.monotonic_ns()
                ticks = self._features.value(value)
                rate = 1e9 if frequency is None else self._features.value(frequency)
                if ticks is not None and rate:
                    return ClockFix("camera", ticks / rate, (before + after) // 2, after - before)
        return None

    def make_safe(self) -> None:
        """Forget the frame asked for; a camera needs no other safety."""
        self._deadline = None

    def close(self) -> None:
        """Stop and release the camera. Idempotent; never raises, and may take seconds when the camera is gone."""
        self._deadline = None
        acquirer, harvester = self._acquirer, self._harvester
        self._acquirer = self._harvester = self._features = self._shape = None
        for step in (
            *((acquirer.stop, acquirer.destroy) if acquirer is not None else ()),
            *((harvester.reset,) if harvester is not None else ()),
        ):
            with suppress(Exception):
                step()

    def _open(self) -> Identity:
        try:
            from harvesters.core import Callback, Harvester
        except ImportError as error:
            raise DeviceError(
                "the packages 'harvesters' and 'genicam' are not installed",
                where=self._where,
                advice="install them with: pip install 'polfuse-lab[camera]'",
            ) from error
        # Its loggers print tracebacks of errors that are raised as well.
        logging.getLogger("harvesters.core").setLevel(logging.CRITICAL)
        cti = self._producer()
        harvester = self._harvester = Harvester()
        harvester.add_file(str(cti), check_existence=True, check_validity=True)
        # Once, here: update() destroys acquirers that are alive.
        harvester.update()
        device = self._choose(harvester.device_info_list)
        acquirer = self._acquirer = harvester.create(device)
        camera = self

        class Incomplete(Callback):  # type: ignore[misc]
            def emit(self, context: object | None = None) -> None:
                camera._lost += 1

        acquirer.add_callback(acquirer.Events.INCOMPLETE_BUFFER, Incomplete())
        acquirer.timeout_period_on_update_event_data_call = 5
        features = Features(acquirer.remote_device.node_map)
        self._set_up(features)
        acquirer.start()
        self._features = features
        self._lost = self._lost_told = 0
        self._last_id = None
        missing = f"; lacks {', '.join(features.missing)}" if features.missing else ""
        trigger = "free running" if self._free else "software trigger"
        assert self._shape is not None
        detail = f"{self._shape[1]}x{self._shape[0]} {np.dtype(self._dtype).name}, {trigger}, {cti.name}{missing}"
        return Identity("camera", "harvesters", _words(device, "vendor", "model", "serial_number"), detail)

    def _producer(self) -> Path:
        if self._options.cti:
            cti = Path(self._options.cti)
        else:
            import genicam

            cti = Path(genicam.__file__).parent / "viky.cti"
        if not cti.is_file():
            raise DeviceError(
                f"the GenTL producer {cti} does not exist",
                where=self._where,
                advice="give the .cti file of the camera's vendor in option cti",
            )
        return cti

    def _choose(self, devices: list[Any]) -> Any:
        names = [_words(device, "vendor", "model", "serial_number", "id_", "user_defined_name") for device in devices]
        for device, name in zip(devices, names, strict=True):
            if self._options.device.casefold() in name.casefold():
                return device
        found = "; ".join(names) or "none"
        raise DeviceLost(
            f"no such camera (found: {found})", where=self._where, advice="check cable, power and option device"
        )

    def _set_up(self, features: Features) -> None:
        options = self._options
        try:
            offered = features.symbols("PixelFormat")
            wanted = options.pixel_format or next((name for name in _FORMATS if name in offered), "")
            if wanted not in _FORMATS:
                raise ValueError(
                    f"pixel_format: found {wanted or ', '.join(offered)}, allowed: {' or '.join(_FORMATS)}"
                )
            features.put("PixelFormat", wanted)
            self._dtype = _FORMATS[wanted]
            for name, size in (("Width", options.width_px), ("Height", options.height_px)):
                if size:
                    features.put(name, size)
            for automatic in ("ExposureAuto", "GainAuto"):
                features.put(automatic, "Off", needed=False)
            features.put(EXPOSURE, options.exposure_s * 1e6)
            if options.gain_db or features.node(GAIN) is not None:
                features.put(GAIN, options.gain_db)
            features.put("AcquisitionMode", "Continuous", needed=False)
            self._free = options.trigger == "free" or not self._trigger_on(features)
            if options.trigger == "free":
                features.put("TriggerMode", "Off", needed=False)
        except ValueError as error:
            raise DeviceRefused(str(error), where=self._where, advice="correct the camera's options") from error
        # What the camera really took: exposure and gain have steps.
        exposure, gain = features.value(EXPOSURE), features.value(GAIN)
        self._exposure_s = float(exposure) * 1e-6 if exposure is not None else options.exposure_s
        self._gain_db = float(gain) if gain is not None else 0.0
        self._shape = int(features.value("Height") or 0), int(features.value("Width") or 0)
        for given, got, name in (
            (options.height_px, self._shape[0], "rows"),
            (options.width_px, self._shape[1], "columns"),
        ):
            if given and given != got:
                raise DeviceRefused(f"{given} {name} asked, {got} set", where=self._where, advice=f"ask for {got}")

    def _trigger_on(self, features: Features) -> bool:
        if features.node("TriggerMode") is None or features.node("TriggerSoftware") is None:
            features.missing.append("TriggerMode" if features.node("TriggerMode") is None else "TriggerSoftware")
            return False
        features.put("TriggerSelector", "FrameStart", needed=False)
        features.put("TriggerSource", "Software", needed=False)
        return features.put("TriggerMode", "On")

    def _drain(self) -> None:
        """Give back whatever was exposed before; there are never more frames waiting than buffers."""
        for _ in range(int(self._acquirer.num_buffers) + 1):
            buffer = self._acquirer.try_fetch(timeout=1e-3)
            if buffer is None:
                return
            self._last_id = int(buffer.frame_id)
            buffer.queue()

    def _accept(self, buffer: Any) -> Frame | None:
        t_host_ns = time.monotonic_ns()
        try:
            frame_id = int(buffer.frame_id)
            if not self._free and self._last_id is not None and frame_id > self._last_id + 1:
                # Every frame of a triggered camera was asked for; those that harvesters discarded are counted already.
                self._lost = max(self._lost, self._lost_told + frame_id - self._last_id - 1)
            self._last_id = frame_id
            if self._to_skip:
                self._to_skip -= 1
                return None
            component = buffer.payload.components[0]
            rows, columns = int(component.height), int(component.width)
            # Copied before the buffer goes back: the producer writes into it again.
            data = np.array(component.data)
            stamp_ns = _timestamp_ns(buffer)
        finally:
            buffer.queue()
        if data.dtype != self._dtype or data.size != rows * columns or (rows, columns) != self._shape:
            raise DeviceError(
                f"a frame came as {columns}x{rows} {data.dtype}, expected {self._shape} {np.dtype(self._dtype).name}",
                where=self._where,
                advice="close other programs that set this camera, and open it again",
            )
        self._deadline = None
        lost_before, self._lost_told = self._lost - self._lost_told, self._lost
        return Frame(
            image=data.reshape(rows, columns),
            frame_id=frame_id,
            exposure_s=self._exposure_s,
            gain_db=self._gain_db,
            t_device_s=stamp_ns * 1e-9,
            t_host_ns=t_host_ns,
            lost_before=lost_before,
        )

    @contextmanager
    def _failures(self, what: str) -> Iterator[None]:
        """Turn whatever harvesters and the producer raise into :class:`DeviceLost`."""
        try:
            yield
        except DeviceError:
            raise
        except Exception as error:
            words = str(error).split("(Message", maxsplit=1)[0].strip() or type(error).__name__
            raise DeviceLost(
                f"{what} ({words})", where=self._where, advice="check cable and power, then open it again"
            ) from error

    def _closed(self) -> DeviceLost:
        return DeviceLost("is not open", where=self._where, advice="open it first")


def _words(device: Any, *names: str) -> str:
    """What a producer tells about a device; it may refuse single entries."""
    words = []
    for name in names:
        with suppress(Exception):
            words.append(str(getattr(device, name) or ""))
    return " ".join(word for word in words if word)


def _timestamp_ns(buffer: Any) -> float:
    """The camera's own stamp of a frame, ns; NaN where the producer has none."""
    with suppress(Exception):
        return float(buffer.timestamp_ns)
    with suppress(Exception):
        # Not buffer.timestamp, which answers 0 where there is none.
        return float(buffer.module.timestamp) * 1e9 / float(buffer.timestamp_frequency)
    return float("nan")
