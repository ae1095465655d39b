"""A trolley that a person pushes, with a quadrature encoder read by a microcontroller over serial.

The position is measured all the time, also under way: radar records of a trolley in continuous motion know where each
sweep was taken (:meth:`EncoderTrolley.position_at`). A move is a request to the operator, and is over when the trolley
stands near its mark; where it really stands is what counts.

An encoder counts from where it was switched on. The trolley must stand at ``start_x_m`` when it is opened, or pass its
index mark (``index_x_m``) later: from then on positions refer to that mark.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from drivers.contracts import Operator
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import Identity, TrolleyFix
from drivers.transport import SerialLine
from drivers.trolley.by_hand import refuse_speed
from drivers.trolley.encoder_protocol import parse_line
from drivers.trolley.encoder_track import EncoderTrack, Jump, Scale

_OPEN_S = 4.0
_MAX_DAMAGED = 50


class EncoderTrolley:
    """Driver ``encoder``. Thread-safe; a thread of its own reads the line while it is open."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[trolley.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        port: str
        """Serial port of the microcontroller, or ``socket://host:port``."""
        length_m: Annotated[float, Gt(0)]
        """Usable length of the rail, m; x runs from -length_m/2 to +length_m/2."""
        counts_per_m: Annotated[float, Gt(0)]
        """Counts (all edges) for one metre of rail: counts of a turn over the measuring wheel's circumference."""
        direction: Literal[1, -1] = 1
        """1 where counts grow towards positive x, -1 where they fall."""
        start_x_m: float | None = None
        """x where the trolley stands when it is opened, m; left out: the rail's left end (-length_m/2)."""
        index_x_m: float | None = None
        """x of the index mark, m; left out: there is none."""
        reference_sd_m: Annotated[float, Gt(0), Le(1)] = 0.002
        """Standard deviation with which the trolley stands at its start, or the index mark is known, m."""
        scale_sd_percent: Annotated[float, Ge(0), Le(10)] = 0.2
        """Standard deviation of counts_per_m (wear and slip of the wheel), percent."""
        tolerance_m: Annotated[float, Gt(0), Le(0.5)] = 0.005
        """How near to its mark the trolley must stand, m."""
        rest_s: Annotated[float, Gt(0), Le(5)] = 0.5
        """How long it must stand there, s."""
        max_speed_m_s: Annotated[float, Gt(0), Le(50)] = 5.0
        """What no hand does, m/s: faster counts mean that something is wrong."""
        counter_bits: Literal[16, 24, 32] = 32
        """Width of the controller's counter."""
        baud: Annotated[int, Gt(0)] = 115_200
        """Line speed, bit/s."""
        silence_s: Annotated[float, Gt(0), Le(5)] = 1.0
        """Time without a line after which the encoder counts as dead, s."""

    def __init__(self, options: Options, operator: Operator) -> None:
        self._options = checked(options)
        self._operator = operator
        self._line = SerialLine(options.port, baud=options.baud, name="encoder trolley", timeout_s=options.silence_s)
        self._scale = Scale(
            options.counts_per_m * options.direction,
            options.scale_sd_percent / 100,
            options.reference_sd_m,
            options.index_x_m,
            options.counter_bits,
            options.max_speed_m_s,
        )
        self._lock = threading.RLock()
        self._track = EncoderTrack(self._scale, self._start_x_m)
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._failure: DeviceError | None = None
        self._damaged = self._damaged_running = 0
        self._target_m: float | None = None
        self._ticket: int | None = None

    @property
    def limits_m(self) -> tuple[float, float]:
        """Smallest and largest x that may be asked for, m."""
        return -self._options.length_m / 2, self._options.length_m / 2

    @property
    def lost_lines(self) -> int:
        """Lines of the encoder that were lost or damaged since it was opened; no count is lost with them."""
        with self._lock:
            return self._track.lost_lines

    def open(self) -> Identity:
        """Connect and wait for the first line (a controller that restarts with its port needs some 2 s).

        Raises:
            DeviceTimeout, DeviceLost, DeviceBadAnswer: no encoder talks there.
        """
        self.close()
        with self._lock:
            self._line.open()
            self._track = EncoderTrack(self._scale, self._start_x_m)
            self._failure = None
            self._damaged = self._damaged_running = 0
            self._closing.clear()
            self._thread = threading.Thread(target=self._read, name="encoder trolley", daemon=True)
            self._thread.start()
        give_up_s = time.monotonic() + _OPEN_S
        try:
            while not self._heard_from():
                if time.monotonic() > give_up_s:
                    raise self._silent(_OPEN_S)
                time.sleep(0.01)
        except BaseException:
            self.close()
            raise
        options = self._options
        reference = (
            "start" if options.index_x_m is None else f"start until the index mark at {options.index_x_m:+.3f} m"
        )
        detail = f"{options.counts_per_m:g} counts per metre, x = {self._start_x_m:+.4f} m at its {reference}"
        return Identity("trolley", "encoder", "encoder", detail)

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Ask the operator to push the trolley to ``x_m``; an earlier request is taken back.

        Raises:
            DeviceRefused: outside the rail, or a speed is asked for.
        """
        refuse_speed(speed_m_s, self._line.where)
        low, high = self.limits_m
        if not low <= x_m <= high:
            raise DeviceRefused(
                f"x = {x_m:g} m is outside the rail ({low:g} to {high:g} m)",
                where=self._line.where,
                advice="ask for a position on the rail",
            )
        with self._lock:
            self.stop()
            self._target_m = x_m
            self._ticket = self._operator.ask(
                f"Push the trolley to x = {x_m:+.4f} m ({x_m - low:.4f} m from the rail's left end) and let it stand; "
                "confirm only if it shall stay where it is."
            )

    def poll(self) -> TrolleyFix:
        """Where the trolley is; ``moving`` until it stands near its mark (or stands, and the operator has confirmed).

        Raises:
            DeviceLost: the encoder is gone, or restarted, so that its count means nothing any more.
            DeviceTimeout: the encoder is silent.
            DeviceBadAnswer: nothing but damaged lines come.
        """
        with self._lock:
            self._check()
            x_m, sd_m = self._track.position()
            standing = self._track.spread_m(self._options.rest_s) <= max(5e-4, 2.5 / self._options.counts_per_m)
            if self._target_m is not None and standing:
                confirmed = self._ticket is not None and self._operator.answered(self._ticket)
                if confirmed or abs(x_m - self._target_m) <= self._options.tolerance_m:
                    self.stop()
            moving = self._target_m is not None or not standing
            state = "asked" if self._target_m is not None else "standing" if standing else "pushed"
            return TrolleyFix(x_m, sd_m, moving, self._track.last_t_ns, state)

    def position_at(self, t_host_ns: int) -> TrolleyFix:
        """Where the trolley was at an instant of the last few seconds, interpolated between the encoder's lines.

        Args:
            t_host_ns: the host's monotonic clock, ns.

        Raises:
            ValueError: earlier than what is kept.
            DeviceLost, DeviceTimeout, DeviceBadAnswer: as :meth:`poll`.
        """
        with self._lock:
            self._check()
            x_m, sd_m = self._track.position(t_host_ns)
            return TrolleyFix(x_m, sd_m, True, t_host_ns, "interpolated")

    def stop(self) -> None:
        """Take the request back; the position stays known."""
        with self._lock:
            self._target_m = None
            if self._ticket is not None:
                self._operator.withdraw(self._ticket)
                self._ticket = None

    def make_safe(self) -> None:
        """Take the request back. Never raises."""
        self.stop()

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        self.stop()
        self._closing.set()
        self._line.close()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(2)

    @property
    def _start_x_m(self) -> float:
        start = self._options.start_x_m
        return -self._options.length_m / 2 if start is None else start

    def _read(self) -> None:
        """The reader's thread: every line is stamped when it arrives."""
        while not self._closing.is_set():
            try:
                text = self._line.read_line(0.2)
            except DeviceTimeout:
                continue  # silence is judged by whoever asks
            except DeviceBadAnswer:
                self._take(None, time.monotonic_ns())
                continue
            except DeviceError as error:
                if not self._closing.is_set():
                    self._failure = error
                return
            self._take(text, time.monotonic_ns())

    def _take(self, text: str | None, arrival_ns: int) -> None:
        line = None if text is None else parse_line(text)
        with self._lock:
            if line is None:
                self._damaged += 1
                self._damaged_running += 1
                return
            self._damaged_running = 0
            try:
                self._track.add(line, arrival_ns)
            except Jump as jump:
                self._failure = DeviceLost(
                    str(jump),
                    where=self._line.where,
                    advice="push the trolley back to its start (start_x_m) and open it again",
                )

    def _heard_from(self) -> bool:
        with self._lock:
            if self._failure is not None:
                raise self._failure
            self._check_damaged()
            return bool(self._track)

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure
        if not self._line.is_open or not self._track:
            raise DeviceLost("the port is not open", where=self._line.where, advice="open the device (again)")
        self._check_damaged()
        if time.monotonic_ns() - self._track.last_t_ns > self._options.silence_s * 1e9:
            raise self._silent(self._options.silence_s)

    def _check_damaged(self) -> None:
        if self._damaged_running > _MAX_DAMAGED:
            raise DeviceBadAnswer(
                f"sent {self._damaged_running} lines in a row that are none of an encoder",
                where=self._line.where,
                advice="check the port, its baud rate and the cable, and that the controller runs the encoder's sketch",
            )

    def _silent(self, seconds: float) -> DeviceTimeout:
        return DeviceTimeout(
            f"no line of the encoder for {seconds:g} s",
            where=self._line.where,
            advice="check the cable, the port and its baud rate, and that the controller runs the encoder's sketch",
        )
