"""GenICam cameras (GigE Vision, USB3 Vision, CoaXPress …) through the vendor's GenTL producer and harvesters.

Run it in a process of its own (:class:`drivers.camera.process.CameraProcess`): fetching holds the interpreter's lock,
and some producers recover only when their process ends.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from drivers.camera import features as names
from drivers.camera.features import Features
from drivers.camera.genicam_frames import chunks_of, image_of, timestamp_s
from drivers.camera.genicam_setup import GenicamOptions, Setup, exposure_of, set_up
from drivers.camera.pixel_formats import Counts
from drivers.camera.producers import ask_only, find_producer
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import ClockFix, Frame, Identity

_FETCH_S = 0.01
_ID_LIMIT = 0xFFFF
_ID_NEAR = 0x1000
_PROBE_S = 0.5
"""A frame later than this after its exposure: the camera is asked whether it is still there, again and again."""
_STALE = 2
"""Frames of a free-running camera that are passed over after a trigger. A frame that arrives at t began at most two
frame periods earlier (exposure and read-out take at most one each), so only the third surely began after it."""


class HarvestersCamera:
    """Contract :class:`drivers.contracts.Camera` for GenICam cameras."""

    Options = GenicamOptions

    def __init__(self, options: GenicamOptions) -> None:
        self._options = checked(options)
        self._where = f"camera {options.device!r}" if options.device else "camera"
        self._harvester: Any = None
        self._acquirer: Any = None
        self._features: Features | None = None
        self._setup: Setup | None = None
        self._exposure_s = options.exposure_s
        self._deadline: float | None = None
        self._probe_at = 0.0
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
        if self._setup is None:
            raise self._closed()
        return self._setup.shape

    @property
    def lost_frames(self) -> int:
        """Frames lost (gaps in the camera's numbering while triggered) or incomplete since the camera was opened."""
        return self._lost

    def trigger(self) -> None:
        """Ask for one frame whose exposure begins after this call (with the line's next pulse for a line trigger)."""
        if self._features is None or self._setup is None:
            raise self._closed()
        with self._failures("did not take the trigger"):
            self._drain()
            self._to_skip = _STALE if self._setup.free else 0
            self._fire()
        now = time.monotonic()
        self._deadline = now + self._exposure_s + self._options.timeout_s
        self._probe_at = now + self._exposure_s + _PROBE_S

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
            # Raw: harvesters' own unpacking knows no mosaics, and what it does not know it neither unpacks nor returns.
            buffer = self._acquirer.try_fetch(timeout=_FETCH_S, is_raw=True)
        if buffer is not None:
            return self._accept(buffer)
        if self._lost > lost:
            with self._failures("did not take the trigger"):
                self._fire()
        now = time.monotonic()
        if now > min(self._probe_at, self._deadline):
            self._probe_at = now + _PROBE_S
            try:
                with self._failures("does not answer any more"):
                    self._features.probe()
            except DeviceLost:
                self._deadline = None
                raise
        if now > self._deadline:
            self._deadline = None
            raise DeviceTimeout(
                f"no frame within {self._options.timeout_s:g} s of its {self._awaited()}",
                where=self._where,
                advice="check the cable, the packet size and the trigger settings, or lengthen option timeout_s",
            )
        return None

    def exposure_limits(self) -> tuple[float, float]:
        """Shortest and longest exposure, s.

        Raises:
            DeviceRefused: the camera's exposure cannot be set.
        """
        if self._features is None:
            raise self._closed()
        with self._failures("did not tell its exposures"):
            limits = self._features.limits(names.EXPOSURE)
        if limits is None:
            raise self._fixed_exposure()
        return limits[0] * 1e-6, limits[1] * 1e-6

    def set_exposure(self, seconds: float) -> float:
        """Expose so long from the next trigger on; return what the camera made of it, s.

        Raises:
            DeviceRefused: outside the camera's limits, or its exposure cannot be set.
        """
        if self._features is None:
            raise self._closed()
        with self._failures("did not take its exposure"):
            try:
                if not self._features.put(names.EXPOSURE, seconds * 1e6, needed=False):
                    raise self._fixed_exposure()
            except ValueError as error:
                raise DeviceRefused(str(error), where=self._where, advice="stay within the limits (us)") from error
            self._exposure_s = exposure_of(self._features, seconds)
        return self._exposure_s

    def clock(self) -> ClockFix | None:
        """The camera's clock latched now, or None where it cannot be read."""
        if self._features is None:
            raise self._closed()
        with self._failures("did not tell its time"):
            for command, value, frequency in names.TIMESTAMP_LATCH:
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
        self._acquirer = self._harvester = self._features = self._setup = None
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
        cti = find_producer(self._options.cti, self._where)
        ask_only(self._options.addresses, cti, self._where)
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
        try:
            setup = set_up(features, self._options)
        except ValueError as error:
            raise DeviceRefused(str(error), where=self._where, advice="correct the camera's options") from error
        acquirer.start()
        self._features, self._setup = features, setup
        self._exposure_s = setup.exposure_s
        self._lost = self._lost_told = 0
        self._last_id = None
        missing = f"; lacks {', '.join(features.missing)}" if features.missing else ""
        detail = f"{', '.join(setup.notes)}, {cti.name}{missing}"
        return Identity("camera", "harvesters", _words(device, "vendor", "model", "serial_number"), detail)

    def _choose(self, devices: list[Any]) -> Any:
        names = [_words(device, "vendor", "model", "serial_number", "id_", "user_defined_name") for device in devices]
        for device, name in zip(devices, names, strict=True):
            if self._options.device.casefold() in name.casefold():
                return device
        found = "; ".join(names) or "none"
        raise DeviceLost(
            f"no such camera (found: {found})", where=self._where, advice="check cable, power and option device"
        )

    def _fire(self) -> None:
        """Give the software trigger, where that is what the camera waits for."""
        assert self._features is not None
        assert self._setup is not None
        if not self._setup.free and self._options.trigger == "software":
            self._features.execute("TriggerSoftware")

    def _awaited(self) -> str:
        return f"trigger on {self._options.trigger_line}" if self._options.trigger == "line" else "trigger"

    def _drain(self) -> None:
        """Give back whatever was exposed before; there are never more frames waiting than buffers."""
        for _ in range(int(self._acquirer.num_buffers) + 1):
            lost = self._lost
            buffer = self._acquirer.try_fetch(timeout=1e-3, is_raw=True)
            if buffer is None:
                if self._lost == lost:
                    return
                continue
            self._last_id = int(buffer.frame_id)
            buffer.parent.queue_buffer(buffer)

    def _accept(self, buffer: Any) -> Frame | None:
        """A buffer as a frame, or None where it was exposed too early. The buffer goes back in any case."""
        assert self._features is not None
        assert self._setup is not None
        t_host_ns = time.monotonic_ns()
        try:
            with self._failures("gave a frame that cannot be read"):
                frame_id = int(buffer.frame_id)
                self._count(frame_id)
                if self._to_skip:
                    self._to_skip -= 1
                    return None
                # Copied before the buffer goes back: the producer writes into it again.
                image = self._image(buffer)
                told = chunks_of(self._features) if self._setup.chunks else {}
                stamp_s = told.get("time_s", timestamp_s(buffer))
        finally:
            with self._failures("did not take a buffer back"):
                buffer.parent.queue_buffer(buffer)
        self._deadline = None
        lost_before, self._lost_told = self._lost - self._lost_told, self._lost
        return Frame(
            image=image,
            frame_id=frame_id,
            exposure_s=told.get("exposure_s", self._exposure_s),
            gain_db=self._setup.gain_db,
            t_device_s=stamp_s,
            t_host_ns=t_host_ns,
            lost_before=lost_before,
        )

    def _image(self, buffer: Any) -> Counts:
        assert self._setup is not None
        try:
            return image_of(buffer, self._setup)
        except ValueError as error:
            self._deadline = None
            raise DeviceBadAnswer(
                f"a frame came {error}",
                where=self._where,
                advice="close other programs that set this camera, and open it again",
            ) from error

    def _count(self, frame_id: int) -> None:
        """Count the frames missing before this one, where frames come only when asked for."""
        assert self._setup is not None
        last, self._last_id = self._last_id, frame_id
        if self._setup.free or last is None:
            return
        gap = frame_id - last - 1
        if last > _ID_LIMIT - _ID_NEAR and last <= _ID_LIMIT and frame_id < _ID_NEAR:
            # The 16 bit numbers of GigE Vision 1 go on with 1: 0 is no frame's.
            gap += _ID_LIMIT
        if gap > 0:
            # Those that harvesters discarded as incomplete are counted already.
            self._lost = max(self._lost, self._lost_told + gap)

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

    def _fixed_exposure(self) -> DeviceRefused:
        return DeviceRefused(
            "its exposure cannot be set", where=self._where, advice="leave automatic exposure out of the plan"
        )

    def _closed(self) -> DeviceLost:
        return DeviceLost("is not open", where=self._where, advice="open it first")


def _words(device: Any, *names: str) -> str:
    """What a producer tells about a device; it may refuse single entries."""
    words = []
    for name in names:
        with suppress(Exception):
            words.append(str(getattr(device, name) or ""))
    return " ".join(word for word in words if word)
