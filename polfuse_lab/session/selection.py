"""Part of a session, chosen by channel, position and time, and read when it is looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import SUPERSEDED

if TYPE_CHECKING:
    import xarray

    from polfuse_lab.session.reader import Session

ChannelChoice = Channel | str | Iterable[Channel | str] | None
PositionChoice = int | slice | Iterable[int] | None
TimeChoice = tuple[float | None, float | None] | None
ANGLE_TOLERANCE_DEG = 0.5
"""Polarizers stand this near to the angle that was asked for."""

Item = TypeVar("Item", bound="AudioRecord | FrameRecord")


@dataclass(frozen=True)
class AudioRecord:
    """One audio record of a session; its samples are read when asked for."""

    session: Session
    index: int
    """Its number in the session, as in :meth:`Session.audio`."""

    @property
    def row(self) -> np.void:
        """Its row of the table of sweeps."""
        row: np.void = self.session.sweeps[self.index]
        return row

    @property
    def channel(self) -> Channel:
        """Polarimetric channel."""
        return Channel(int(self.row["channel"]))

    @property
    def position(self) -> int:
        """Position along the rail, counted from 0."""
        return int(self.row["position"])

    @property
    def x_m(self) -> float:
        """Where the trolley was, m."""
        return float(self.row["x_m"])

    @property
    def time_s(self) -> float:
        """When it began, s since the session's first record."""
        return (int(self.row["t_host_ns"]) - self.session.first_host_ns) * 1e-9

    def __len__(self) -> int:
        return int(self.row["samples"])

    def __getitem__(self, part: slice) -> NDArray[Any]:
        """Samples ``part``: (n, channels), exactly as sampled; only these are read."""
        return self.session.audio_part(self.index, part)

    @property
    def samples(self) -> NDArray[Any]:
        """All samples: (n, channels)."""
        return self[:]

    def blocks(self, frames: int) -> Iterator[NDArray[Any]]:
        """The samples in pieces of ``frames``, the last one shorter."""
        for start in range(0, len(self), frames):
            yield self[start : start + frames]


@dataclass(frozen=True)
class FrameRecord:
    """One camera frame of a session; its image is read when asked for."""

    session: Session
    index: int
    """Its number in the session, as in :meth:`Session.frame`."""

    @property
    def row(self) -> np.void:
        """Its row of the table of frames."""
        row: np.void = self.session.frames[self.index]
        return row

    @property
    def angle_deg(self) -> float:
        """Angle of the polarizer, degrees."""
        return float(np.degrees(self.row["angle_rad"]))

    @property
    def time_s(self) -> float:
        """When it was taken, s since the session's first record."""
        return (int(self.row["t_host_ns"]) - self.session.first_host_ns) * 1e-9

    @property
    def image(self) -> NDArray[Any]:
        """Counts: (rows, columns)."""
        return self.session.frame(self.index)


class Selection(Generic[Item]):
    """Records chosen from a session, in the order in which they were taken. Nothing but the tables has been read.

    ``len(selection)``, ``selection[i]``, ``selection[a:b]``, and ``for record in selection``.
    """

    def __init__(self, session: Session, indices: NDArray[np.intp], rows: NDArray[np.void],
                 make: Callable[[Session, int], Item]) -> None:  # fmt: skip
        self._session = session
        self._make = make
        self._table = rows
        self.indices = indices
        """Numbers of the records in the session."""

    @property
    def rows(self) -> NDArray[np.void]:
        """The records' rows of the table."""
        return self._table[self.indices]

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[Item]:
        return (self._make(self._session, int(index)) for index in self.indices)

    def __getitem__(self, part: int | slice) -> Any:
        """One record, or a selection of some."""
        if isinstance(part, slice):
            return Selection(self._session, self.indices[part], self._table, self._make)
        return self._make(self._session, int(self.indices[part]))

    def to_xarray(self) -> xarray.Dataset:
        """The records as an xarray dataset; samples or images are read when they are looked at.

        Raises:
            PolfuseError: the package xarray is not installed, or the audio records are not of one length.
        """
        view = view_module()
        make = view.audio_dataset if self._make is AudioRecord else view.frames_dataset
        dataset: xarray.Dataset = make(self._session, self.indices)
        return dataset


def view_module() -> ModuleType:
    """The module that makes xarray datasets. Raises :class:`PolfuseError` where xarray is not installed."""
    try:
        from polfuse_lab.session import xarray_view
    except ImportError as error:
        raise PolfuseError(
            f"needs the package xarray ({error})", where="to_xarray", advice="run 'pip install xarray'"
        ) from error
    return xarray_view


def select_audio(
    session: Session,
    *,
    channel: ChannelChoice = None,
    position: PositionChoice = None,
    time: TimeChoice = None,
    latest: bool = False,
) -> Selection[AudioRecord]:
    """Choose audio records; see :meth:`Session.select`."""
    rows = session.sweeps
    chosen = _in_time(rows, time, session)
    if channel is not None:
        chosen &= np.isin(rows["channel"], [int(item) for item in _channels(channel, session)])
    if position is not None:
        chosen &= _at_positions(rows["position"], position)
    if latest:
        chosen &= _latest(rows)
    return Selection(session, np.flatnonzero(chosen), rows, AudioRecord)


def select_frames(
    session: Session,
    *,
    angle_deg: float | Iterable[float] | None = None,
    time: TimeChoice = None,
    dark: bool | None = None,
) -> Selection[FrameRecord]:
    """Choose camera frames; see :meth:`Session.select_frames`."""
    rows = session.frames
    chosen = _in_time(rows, time, session)
    if angle_deg is not None:
        wanted = np.atleast_1d(np.asarray(angle_deg if isinstance(angle_deg, (int, float)) else list(angle_deg)))
        away = np.abs(np.degrees(rows["angle_rad"])[:, None] - wanted[None, :])
        chosen &= (away <= ANGLE_TOLERANCE_DEG).any(axis=1)
    if dark is not None:
        chosen &= rows["dark"] == dark
    return Selection(session, np.flatnonzero(chosen), rows, FrameRecord)


def _in_time(rows: NDArray[np.void], time: TimeChoice, session: Session) -> NDArray[np.bool_]:
    chosen = np.ones(len(rows), bool)
    if time is None:
        return chosen
    since, until = time
    # In nanoseconds: seconds in floating point would lose the edges.
    if since is not None:
        chosen &= rows["t_host_ns"] >= session.first_host_ns + round(since * 1e9)
    if until is not None:
        chosen &= rows["t_host_ns"] < session.first_host_ns + round(until * 1e9)
    return chosen


def _channels(channel: Channel | str | Iterable[Channel | str], session: Session) -> list[Channel]:
    items = [channel] if isinstance(channel, (Channel, str)) else list(channel)
    try:
        return [item if isinstance(item, Channel) else Channel[item.upper()] for item in items]
    except (KeyError, AttributeError) as error:
        names = ", ".join(item.name for item in Channel)
        raise PolfuseError(
            f"there is no channel {error}", where=str(session.path), advice=f"choose from {names}"
        ) from error


def _at_positions(found: NDArray[np.int32], wanted: int | slice | Iterable[int]) -> NDArray[np.bool_]:
    if isinstance(wanted, slice):
        last = int(found.max()) + 1 if len(found) else 0
        wanted = range(*wanted.indices(last))
    return np.isin(found, [wanted] if isinstance(wanted, int) else list(wanted))


def _latest(rows: NDArray[np.void]) -> NDArray[np.bool_]:
    """The latest attempt at each position and channel that did not have to be taken again."""
    newest: dict[tuple[int, int], int] = {}
    for index, row in enumerate(rows):
        if not int(row["flags"]) & int(SUPERSEDED):
            newest[int(row["position"]), int(row["channel"])] = index
    chosen = np.zeros(len(rows), bool)
    chosen[list(newest.values())] = True
    return chosen
