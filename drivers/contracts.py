"""The five contracts. A driver is any object with these methods; none of them blocks longer than stated.

Movements and recordings are started and then polled, so that whoever drives can stop within a second.
All methods raise :class:`drivers.errors.DeviceError` (or a subclass) and nothing else when the device fails.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from drivers.records import AudioBlock, Channel, ClockFix, Frame, Identity, Level, PolarizerFix, SwitchState, TrolleyFix


class Device(Protocol):
    """What every device can do."""

    def open(self) -> Identity:
        """Connect and say who answered. Blocks up to the device's own time-out (at most 10 s)."""

    def make_safe(self) -> None:
        """Bring the device to its safe state (stopped, default route). Never raises when already lost."""

    def close(self) -> None:
        """Release the device. Idempotent; never raises."""


@runtime_checkable
class Switches(Device, Protocol):
    """A transmit and a receive RF transfer switch."""

    def select(self, channel: Channel) -> SwitchState:
        """Route both switches and wait until they have settled (configured; at most 0.5 s)."""

    def state(self) -> SwitchState:
        """Ask the device for the present route."""


@runtime_checkable
class Radar(Device, Protocol):
    """The FMCW radar's beat and sync on a stereo audio port."""

    @property
    def sample_rate_hz(self) -> float:
        """Nominal sample rate of the open stream, Hz."""

    @property
    def lost_frames(self) -> int:
        """Frames known to be lost since the stream was opened."""

    def begin(self, frames: int) -> None:
        """Ask for ``frames`` contiguous frames, all of them sampled after this call."""

    def poll(self) -> AudioBlock | None:
        """Return the block asked for once it is whole, else None. Raises when the stream stalls or stops."""

    def cancel(self) -> None:
        """Forget the block asked for."""

    def level(self) -> Level:
        """Levels over the last tenth of a second."""

    def clock(self) -> ClockFix | None:
        """One pair of the stream's clock and the host's, or None where the stream has no usable clock."""


@runtime_checkable
class GaplessRadar(Protocol):
    """What a radar that can record one block after another without a gap also has."""

    def begin_stream(self, frames: int) -> None:
        """Ask for blocks of ``frames`` frames, each beginning with the frame after the last one's, all sampled after
        this call. :meth:`Radar.poll` returns each once it is whole; :meth:`Radar.cancel` ends it."""


@runtime_checkable
class OverheardRadar(Protocol):
    """What a radar whose samples can be looked at while they are recorded also has (for meters and live pictures)."""

    def newest(self, frames: int) -> AudioBlock | None:
        """The newest samples, up to ``frames`` of them, whether or not a record is under way; None where there are
        none.

        ``first_frame`` counts frames as they arrived and ``t_host_ns`` tells when the first of them did, both well
        enough to join blocks and to show them, no better. Any thread may call it; it takes nothing from records and
        never waits for them. Never raises.
        """


@runtime_checkable
class Trolley(Device, Protocol):
    """The trolley on the rail; x = 0 at the aperture's centre, increasing to the right as seen by the radar."""

    @property
    def limits_m(self) -> tuple[float, float]:
        """Smallest and largest x that may be asked for."""

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Begin to move, at a constant speed where one is given (else at the trolley's own); returns at once.

        Raises :class:`DeviceRefused` outside the limits or in alarm, or where a speed cannot be kept (by hand).
        """

    def poll(self) -> TrolleyFix:
        """Present position. ``moving`` stays True until the trolley stands at its target."""

    def stop(self) -> None:
        """Stop now (feed hold); the position stays known."""


@runtime_checkable
class Polarizer(Device, Protocol):
    """A linear polarizer in front of the camera."""

    def start_turn(self, angle_rad: float) -> None:
        """Begin to turn to an angle from horizontal; returns at once."""

    def poll(self) -> PolarizerFix:
        """Present angle. ``moving`` stays True until the polarizer stands at its target."""

    def stop(self) -> None:
        """Stop turning."""


@runtime_checkable
class Camera(Device, Protocol):
    """A camera that delivers one frame per trigger."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""

    def trigger(self) -> None:
        """Ask for one frame whose exposure begins after this call."""

    def poll(self) -> Frame | None:
        """The frame asked for once it has arrived, else None. Raises when it is overdue or the camera is lost."""

    @property
    def lost_frames(self) -> int:
        """Frames known to be lost or incomplete since the camera was opened."""

    def clock(self) -> ClockFix | None:
        """One pair of the camera's clock and the host's, or None where the camera has none."""


@runtime_checkable
class ExposureControl(Protocol):
    """What a camera whose exposure can be set also has."""

    def exposure_limits(self) -> tuple[float, float]:
        """Shortest and longest exposure, s."""

    def set_exposure(self, seconds: float) -> float:
        """Expose so long from the next trigger on; return what the camera made of it (exposures have steps), s."""


class Operator(Protocol):
    """A person who does by hand what a motor does elsewhere. The engine provides it to hand-operated drivers."""

    def ask(self, prompt: str) -> int:
        """Show a prompt; return a ticket at once."""

    def answered(self, ticket: int) -> bool:
        """Whether the operator has confirmed."""

    def withdraw(self, ticket: int) -> None:
        """Take the prompt back."""
