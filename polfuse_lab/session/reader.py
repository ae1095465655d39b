"""Read a session file: complete, being written at this moment, or left by a writer that was killed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import h5py
import hdf5plugin  # noqa: F401 - registers the filters that audio and images are stored with
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError, first_line
from polfuse_lab.rig import Rig, Waveform, parse_model
from polfuse_lab.session import layout, versions
from polfuse_lab.session.opening import damaged, open_file
from polfuse_lab.session.selection import (
    AudioRecord,
    ChannelChoice,
    FrameRecord,
    PositionChoice,
    Selection,
    TimeChoice,
    select_audio,
    select_frames,
    view_module,
)
from polfuse_lab.session.sync import SessionSync

if TYPE_CHECKING:
    import xarray

    from polfuse_lab.plans import Plan
    from polfuse_lab.plans.steps import Step

Table = NDArray[np.void]


def open_session(path: Path | str, *, left_behind: bool = False) -> Session:
    """Open a session for reading.

    Args:
        path: the file, finished or ``.partial``.
        left_behind: nobody writes it any more (see :mod:`polfuse_lab.session.unflagged`).

    Raises:
        PolfuseError: there is no such file, it is not a session, it is of a newer version, or it is damaged.
    """
    path = Path(path)
    file = open_file(path, left_behind=left_behind)
    try:
        schema = file.attrs.get("schema")
        version = int(file.attrs.get("version", 0))
        if schema != layout.SCHEMA:
            raise PolfuseError(
                "is an HDF5 file but not a PolFuse session", where=str(path), advice="check the file's name"
            )
        if version > layout.VERSION:
            raise PolfuseError(
                f"is of session version {version}, newer than {layout.VERSION} which this program knows",
                where=str(path),
                advice="update PolFuse Lab",
            )
        return Session(path, file)
    except PolfuseError:
        file.close()
        raise
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        file.close()
        raise damaged(path, error) from error


class Session:
    """An open session. Tables are read when first used; :meth:`refresh` reads what has been added since.

    Rows whose samples or image never reached the file (the writer was killed between the two) are left out, and
    counted by :attr:`missing_records`.
    """

    def __init__(self, path: Path, file: h5py.File) -> None:
        self.path = path
        self.schema = f"{layout.SCHEMA}/{int(file.attrs['version'])}"
        """Schema and version, ``"polfuse-session/1"``."""
        self._file = file
        self.config: dict[str, Any] = json.loads(bytes(file["config"][:]))
        """The snapshot taken before the first record (see :mod:`polfuse_lab.session.layout`)."""
        self._state = file["state"][0]

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file. Idempotent."""
        self._file.close()

    def refresh(self) -> None:
        """Forget the tables read so far, so that records added meanwhile are seen (for a file being written)."""
        for name in ("state", "audio", "images", *layout.TABLES):
            if name in self._file and self._file.swmr_mode:
                self._file[name].id.refresh()
        self._state = self._file["state"][0]
        for name in (*layout.TABLES, "first_host_ns", "sync"):
            self.__dict__.pop(name, None)

    @property
    def state(self) -> str:
        """``"finished"``, ``"aborted"``, ``"failed"``, ``"engine lost"``; ``"recording"`` when it was never closed."""
        return bytes(self._state["state"]).decode()

    @property
    def reason(self) -> str:
        """Why it ended so, one sentence."""
        return bytes(self._state["reason"]).decode()

    @property
    def samples_lost(self) -> int:
        """Audio frames known to be lost, as counted at the end (or from the records where there was no end)."""
        if self.state == "recording":
            return int(self.sweeps["lost"].sum())
        return int(self._state["samples_lost"])

    @property
    def frames_lost(self) -> int:
        """Camera frames known to be lost or incomplete."""
        if self.state == "recording":
            return int(self.frames["lost_before"].sum() + self.frames["incomplete"].sum())
        return int(self._state["frames_lost"])

    @property
    def complete(self) -> bool:
        """Whether everything that was to be recorded is here: finished, closed cleanly, no record missing."""
        return self.state == "finished" and self.missing_records == 0

    @property
    def rig_toml(self) -> str | None:
        """Text of the rig file, None for foreign recordings."""
        text: str | None = self.config["rig_toml"]
        return text

    @property
    def plan_toml(self) -> str | None:
        """Text of the plan file, None for foreign recordings."""
        text: str | None = self.config["plan_toml"]
        return text

    @cached_property
    def rig(self) -> Rig | None:
        """The rig, None for foreign recordings. Raises :class:`PolfuseError` where this version cannot read it."""
        return None if self.rig_toml is None else parse_model(self.rig_toml, Rig, f"{self.path}:rig.toml")

    @cached_property
    def plan(self) -> Plan | None:
        """The plan, None for foreign recordings. Raises :class:`PolfuseError` where this version cannot read it."""
        from polfuse_lab.plans import parse_plan

        return None if self.plan_toml is None else parse_plan(self.plan_toml, f"{self.path}:plan.toml")

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The steps that were planned; none for foreign recordings.

        Raises:
            PolfuseError: they cannot be read by this version.
        """
        from polfuse_lab.plans.step_json import steps_from_plain
        from polfuse_lab.plans.steps import StartTurn

        recorded = self.config["extra"].get(layout.STEPS)
        if recorded is not None:
            try:
                return steps_from_plain(recorded)
            except ValueError as error:
                raise PolfuseError(
                    f"its steps cannot be read by this version ({error})",
                    where=str(self.path),
                    advice="open it with the version that recorded it",
                ) from error
        if self.plan is None:
            return ()
        mosaic = self.rig is not None and self.rig.has_mosaic
        # Sessions that do not hold their steps are older than turns that are begun early.
        return tuple(step for step in self.plan.steps(mosaic=mosaic) if not isinstance(step, StartTurn))

    @cached_property
    def waveform(self) -> Waveform:
        """The radar's ramp."""
        return Waveform.model_validate(self.config["waveform"])

    @property
    def sample_rate_hz(self) -> float:
        """Nominal sample rate of the audio, Hz."""
        return float(self.config["sample_rate_hz"])

    @cached_property
    def sweeps(self) -> Table:
        """One row for each audio record, dtype :data:`polfuse_lab.session.layout.SWEEPS`."""
        rows = self._table("sweeps")
        whole: Table = rows[rows["first_sample"] + rows["samples"] <= self._rows("audio")]
        return whole

    @cached_property
    def frames(self) -> Table:
        """One row for each camera frame, dtype :data:`polfuse_lab.session.layout.FRAMES`."""
        return self._table("frames")[: self._rows("images")]

    @property
    def missing_records(self) -> int:
        """Rows of tables left out since what they point at is not in the file."""
        found = len(self.sweeps) + len(self.frames)
        return self._rows("sweeps") + self._rows("frames") - found

    @cached_property
    def trolley(self) -> Table:
        """Trolley fixes: x_m, sd_m, moving, t_host_ns, state, record (during which it was taken, else -1)."""
        return self._table("trolley")

    @cached_property
    def switches(self) -> Table:
        """Switch states: transmit, receive, verified, t_host_ns, record (during which it was taken, else -1)."""
        return self._table("switches")

    @cached_property
    def polarizer(self) -> Table:
        """Polarizer fixes: angle_rad, sd_rad, moving, t_host_ns, record (frame during which it was taken, else -1)."""
        return self._table("polarizer")

    @cached_property
    def source_polarizer(self) -> Table:
        """Fixes of the light source's polarizer, as :attr:`polarizer`; empty where there is none."""
        return self._table("source_polarizer")

    @cached_property
    def clocks(self) -> Table:
        """Clock fixes: device, t_device_s, t_host_ns, round_trip_ns."""
        return self._table("clocks")

    @cached_property
    def notes(self) -> Table:
        """The operator's notes: text (UTF-8), t_host_ns."""
        return self._table("notes")

    @cached_property
    def events(self) -> Table:
        """What the scheduler did and noticed: kind, text (UTF-8), t_host_ns."""
        return self._table("events")

    @cached_property
    def sync(self) -> SessionSync:
        """When each record was, on one clock for all devices, and how well that is known."""
        return SessionSync(self)

    def audio(self, index: int) -> NDArray[Any]:
        """Samples of audio record ``index``: (samples, channels), exactly as sampled.

        Raises:
            IndexError: there is no such record.
            PolfuseError: its samples cannot be read from the file.
        """
        row = self.sweeps[_index(index, self.sweeps, "audio record")]
        first = int(row["first_sample"])
        return self._read("audio", slice(first, first + int(row["samples"])), f"audio record {index}")

    def frame(self, index: int) -> NDArray[Any]:
        """Image of frame ``index``: (rows, columns), counts as delivered by the camera. Raises as :meth:`audio`."""
        return self._read("images", _index(index, self.frames, "frame"), f"frame {index}")

    def audio_part(self, index: int, part: slice) -> NDArray[Any]:
        """Some samples of audio record ``index``; only these are read. Raises as :meth:`audio`."""
        row = self.sweeps[_index(index, self.sweeps, "audio record")]
        start, stop, step = part.indices(int(row["samples"]))
        first = int(row["first_sample"])
        if step < 0:
            return self._read("audio", slice(first, first + int(row["samples"])), f"audio record {index}")[part]
        return self._read("audio", slice(first + start, first + max(start, stop), step), f"audio record {index}")

    @cached_property
    def first_host_ns(self) -> int:
        """Host time of the first audio record or frame: where the session's own time begins."""
        times = [int(table["t_host_ns"].min()) for table in (self.sweeps, self.frames) if len(table)]
        return min(times, default=0)

    def select(
        self,
        *,
        channel: ChannelChoice = None,
        position: PositionChoice = None,
        time: TimeChoice = None,
        latest: bool = False,
    ) -> Selection[AudioRecord]:
        """Choose audio records without reading their samples.

        Args:
            channel: a channel or its name, or several.
            position: a position along the rail (from 0), a slice of them, or several.
            time: (from, to) in seconds since the first record, by when a record began; None for an open end.
            latest: only the latest good attempt at each position and channel.

        Raises:
            PolfuseError: there is no such channel.
        """
        return select_audio(self, channel=channel, position=position, time=time, latest=latest)

    def select_frames(
        self, *, angle_deg: float | Iterable[float] | None = None, time: TimeChoice = None, dark: bool | None = None
    ) -> Selection[FrameRecord]:
        """Choose camera frames without reading their images.

        Args:
            angle_deg: angle of the polarizer (within half a degree), or several, degrees.
            time: as in :meth:`select`.
            dark: only frames with (or without) the lens covered.
        """
        return select_frames(self, angle_deg=angle_deg, time=time, dark=dark)

    def stored_bytes(self) -> dict[str, tuple[int, int]]:
        """Bytes of each dataset: as stored in the file, and what its values take uncompressed.

        Audio counts its records' samples; what fills up their last chunks is left out.
        """
        sizes = {name: (int(item.id.get_storage_size()), int(item.nbytes)) for name, item in self._file.items()}
        frame = int(self._file["audio"].dtype.itemsize * self._file["audio"].shape[1])
        return sizes | {"audio": (sizes["audio"][0], int(self.sweeps["samples"].sum()) * frame)}

    def to_xarray(self) -> xarray.Dataset:
        """All audio records and frames as one xarray dataset; samples and images are read when they are looked at.

        Variables ``audio`` (record, sample, input) and ``image`` (frame, row, column), with coordinates and units.

        Raises:
            PolfuseError: the package xarray is not installed, or the audio records are not of one length.
        """
        dataset: xarray.Dataset = view_module().session_dataset(self)
        return dataset

    def _table(self, name: str) -> Table:
        if name not in self._file and name in versions.ADDED_TABLES:
            return versions.missing_table(name)
        return versions.upgraded(name, np.asarray(self._read(name, slice(None), f"table {name}")))

    def _rows(self, name: str) -> int:
        return int(self._file[name].shape[0]) if name in self._file else 0

    def _read(self, name: str, selection: slice | int, what: str) -> NDArray[Any]:
        try:
            values: NDArray[Any] = self._file[name][selection]
        except (OSError, RuntimeError, KeyError) as error:
            raise PolfuseError(
                f"{what} cannot be read ({first_line(error)})",
                where=str(self.path),
                advice="the file is damaged there; use another copy",
            ) from error
        return values


def _index(index: int, rows: Sequence[Any] | Table, what: str) -> int:
    if not -len(rows) <= index < len(rows):
        raise IndexError(f"{what} {index} of {len(rows)}")
    return index % len(rows)
