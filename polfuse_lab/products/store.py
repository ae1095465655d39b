"""The products file: one HDF5 group per stage of processing, each with arrays, settings and provenance.

Layout, readable by any HDF5 program::

    /                       attributes: schema = "polfuse-products", version = 1
    /<stage>/arrays/<name>  one data set per array, attribute "unit" where it has one
    /<stage>/settings       JSON text
    /<stage>/provenance     JSON text

A stage is replaced as a whole: the file is written anew beside the old one, flushed to the disk and then renamed, so
that whoever is interrupted (or killed) leaves the old file untouched. Arrays hold nothing but numbers: two runs on the
same input give the same bytes; only the provenance tells when and where.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from polfuse_lab.errors import PolfuseError, first_line
from polfuse_lab.plain import plain
from polfuse_lab.products.lock import exclusive
from polfuse_lab.products.provenance import arrays_sha256, circumstances, describe_inputs

SCHEMA = "polfuse-products"
VERSION = 1

MADE_BY = {
    "ranging": "polfuse focus SESSION.h5 -o PRODUCTS.h5",
    "focus": "polfuse focus SESSION.h5 -o PRODUCTS.h5",
    "calibration": "polfuse calibrate PRODUCTS.h5 --target trihedral",
    "polarimetry": "polfuse calibrate PRODUCTS.h5 --target trihedral",
    "analysis": "polfuse analyse PRODUCTS.h5",
    "matrices": "polfuse import DIR -o PRODUCTS.h5 --as polsarpro",
    "optics": "polfuse optics SESSION.h5 -o PRODUCTS.h5",
    "raytrace": "polfuse raytrace SCENE.toml -o PRODUCTS.h5",
    "simulation": "polfuse simulate SCENE.toml -o PRODUCTS.h5",
    "history": "polfuse simulate SCENE.toml -o PRODUCTS.h5, with a body that moves",
    "exposures": "polfuse simulate SCENE.toml -o PRODUCTS.h5, with a body that moves and camera.exposure_interval_s",
    "active_optics": "polfuse optics SESSION.h5 -o PRODUCTS.h5",
    "flat": "polfuse optics SESSION.h5 -o PRODUCTS.h5 --as flat",
    "linearity": "polfuse optics SESSION.h5 -o PRODUCTS.h5 --as linearity",
    "analyser": "polfuse optics SESSION.h5 -o PRODUCTS.h5 --as analyser",
    "camera": "polfuse optics BOARDS -o PRODUCTS.h5 --as camera",
    "motion": "polfuse motion SESSION.h5 -o PRODUCTS.h5",
    "moving": "polfuse motion FLIGHT.npz -o PRODUCTS.h5",
    "fusion": "polfuse fuse PRODUCTS.h5",
}
"""The command that makes each stage."""

Array = np.ndarray[Any, Any]


def is_products(path: Path | str) -> bool:
    """Whether a file is a products file; False for anything else, also what cannot be read."""
    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("schema") == SCHEMA)
    except OSError:
        return False


class Products:
    """A products file. Nothing is held open between calls, so several programs may read while one writes."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)

    def write(
        self,
        stage: str,
        arrays: Mapping[str, Array],
        *,
        settings: Mapping[str, Any],
        inputs: Sequence[Path | str],
        units: Mapping[str, str],
    ) -> None:
        """Write or replace one stage; the file is made if it is not there.

        Args:
            stage: name of the stage, such as ``"focus"``.
            arrays: numeric arrays by name, any shape.
            settings: what the stage was made with; anything that JSON can hold (NumPy values and paths are converted).
            inputs: the files that the stage was made from; this file itself may be among them.
            units: unit of each array that has one (``"m"``, ``"sqrt(m^2)"``).

        Raises:
            PolfuseError: a bad name or array, an input that cannot be read, no space, or another writer at work.
        """
        converted = self._checked(stage, arrays, units)
        with exclusive(self.path):
            own = self.path.resolve()
            provenance = {
                "stage": stage,
                "inputs": describe_inputs(item for item in inputs if Path(item).resolve() != own),
                "stages": self._stage_hashes(stage) if any(Path(i).resolve() == own for i in inputs) else {},
                "settings": plain(settings),
                "sha256": arrays_sha256(converted),
                **circumstances(),
            }
            fresh = self.path.with_name(f"{self.path.name}.new")
            try:
                with h5py.File(fresh, "w", track_order=True) as new:
                    self._fill(new, stage, converted, plain(settings), provenance, units)
                with fresh.open("rb+") as stream:
                    os.fsync(stream.fileno())
                os.replace(fresh, self.path)
            except (OSError, RuntimeError) as error:
                # HDF5 tells of a full disk as RuntimeError when it flushes.
                raise PolfuseError(
                    f"stage '{stage}' could not be written ({error})",
                    where=str(self.path),
                    advice="check the space on the disk and that the folder may be written; the old file is untouched",
                ) from error
            finally:
                fresh.unlink(missing_ok=True)

    def adopt(
        self,
        fresh: Path,
        settings: Mapping[str, Mapping[str, Any]],
        *,
        inputs: Sequence[Path | str],
        scratch: str | None = None,
    ) -> None:
        """Make a file that holds some stages' arrays (written piece by piece) this products file, in one step.

        It is given their settings and provenance and the other stages of this file. Arrays are never in memory whole.

        Args:
            fresh: an HDF5 file beside this one, with ``<stage>/arrays/<name>``; it is renamed.
            settings: of each of its stages.
            inputs: the files that the stages were made from.
            scratch: a group of it that is no stage, taken out last.

        Raises:
            PolfuseError: an input that cannot be read, no space, or another writer at work; the old file is untouched.
        """
        with exclusive(self.path):
            described = describe_inputs(inputs)
            try:
                with h5py.File(fresh, "r+") as new:
                    new.attrs["schema"], new.attrs["version"] = SCHEMA, VERSION
                    for name in set(new) - set(settings) - {scratch}:
                        del new[name]  # copied by an earlier attempt
                    for stage, values in settings.items():
                        provenance = {
                            "stage": stage,
                            "inputs": described,
                            "stages": {},
                            "settings": plain(values),
                            "sha256": arrays_sha256(dict(new[stage]["arrays"])),
                            **circumstances(),
                        }
                        self._tell(new[stage], plain(values), provenance)
                    for name in self.stages():
                        if name not in new:
                            with self._open() as old:
                                old.copy(name, new)
                    if scratch is not None:
                        del new[scratch]
                with fresh.open("rb+") as stream:
                    os.fsync(stream.fileno())
                os.replace(fresh, self.path)
            except (OSError, RuntimeError) as error:
                raise PolfuseError(
                    f"stages {', '.join(settings)} could not be written ({error})",
                    where=str(self.path),
                    advice="check the space on the disk and that the folder may be written; the old file is untouched",
                ) from error

    def read(self, stage: str) -> dict[str, Array]:
        """All arrays of a stage by name. Raises :class:`PolfuseError` when it is missing, naming what makes it."""
        with self._stage(stage) as group:
            return {name: item[()] for name, item in group["arrays"].items()}

    def units(self, stage: str) -> dict[str, str]:
        """Unit of each array of a stage that has one. Raises as :meth:`read`."""
        with self._stage(stage) as group:
            return {name: str(item.attrs["unit"]) for name, item in group["arrays"].items() if "unit" in item.attrs}

    def settings(self, stage: str) -> dict[str, Any]:
        """What a stage was made with. Raises as :meth:`read`."""
        return self._json(stage, "settings")

    def provenance(self, stage: str) -> dict[str, Any]:
        """Where a stage comes from. Raises as :meth:`read`.

        Keys: ``inputs`` (path, bytes, sha256 of each file), ``stages`` (sha256 of the stages of this file that it was
        made from), ``settings``, ``sha256`` (of its own arrays), ``versions``, ``time_utc``, ``host``, ``system``.
        """
        return self._json(stage, "provenance")

    def stages(self) -> list[str]:
        """Names of the stages present, in the order in which they were first written; empty without a file."""
        if not self.path.exists():
            return []
        with self._open() as file, self._readable("list of stages"):
            return list(file)

    def _checked(self, stage: str, arrays: Mapping[str, Array], units: Mapping[str, str]) -> dict[str, Array]:
        for name in (stage, *arrays):
            if not name or "/" in name or name.startswith("."):
                raise PolfuseError(f"{name!r} is no name", where=str(self.path), advice="use letters, digits and '_'")
        if unknown := set(units) - set(arrays):
            raise PolfuseError(
                f"units are given for {', '.join(sorted(unknown))}, which stage '{stage}' has not",
                where=str(self.path),
                advice="name the arrays that are written",
            )
        converted = {name: np.asarray(array) for name, array in arrays.items()}
        for name, array in converted.items():
            if array.dtype.kind not in "biufc":
                raise PolfuseError(
                    f"array '{name}' of stage '{stage}' holds {array.dtype}, not numbers",
                    where=str(self.path),
                    advice="put texts into the settings",
                )
        return converted

    def _fill(
        self,
        new: h5py.File,
        stage: str,
        arrays: Mapping[str, Array],
        settings: Any,
        provenance: Mapping[str, Any],
        units: Mapping[str, str],
    ) -> None:
        new.attrs["schema"] = SCHEMA
        new.attrs["version"] = VERSION
        present = self.stages()
        for name in present if stage in present else [*present, stage]:
            if name != stage:
                with self._open() as old:
                    old.copy(name, new)
                continue
            group = new.create_group(f"{name}/arrays", track_order=True)
            for key, array in arrays.items():
                group.create_dataset(key, data=array)
                if key in units:
                    group[key].attrs["unit"] = units[key]
            self._tell(new[name], settings, provenance)

    @staticmethod
    def _tell(group: h5py.Group, settings: Any, provenance: Mapping[str, Any]) -> None:
        # Data sets, for HDF5 limits attributes to 64 KiB.
        for name, values in (("settings", settings), ("provenance", provenance)):
            if name in group:
                del group[name]
            # Of one length: strings of any length lie in a heap of HDF5's in which damage is read without an end.
            group[name] = np.bytes_(json.dumps(values))

    def _stage_hashes(self, writing: str) -> dict[str, str]:
        return {name: self.provenance(name)["sha256"] for name in self.stages() if name != writing}

    def _json(self, stage: str, name: str) -> dict[str, Any]:
        with self._stage(stage) as group:
            values: dict[str, Any] = json.loads(group[name].asstr()[()])
            return values

    @contextmanager
    def _stage(self, stage: str) -> Iterator[h5py.Group]:
        advice = f"make it with '{MADE_BY[stage]}'" if stage in MADE_BY else "look at its stages"
        if not self.path.exists():
            raise PolfuseError(f"there is no such products file (stage '{stage}')", where=str(self.path), advice=advice)
        with self._open() as file, self._readable(f"stage '{stage}'"):
            if stage not in file:
                present = ", ".join(file) or "none"
                raise PolfuseError(f"has no stage '{stage}' (present: {present})", where=str(self.path), advice=advice)
            yield file[stage]

    @contextmanager
    def _open(self) -> Iterator[h5py.File]:
        try:
            file = h5py.File(self.path, "r")
        except BlockingIOError as error:
            raise PolfuseError(
                "is open for writing in another program", where=str(self.path), advice="close it there and try again"
            ) from error
        except OSError as error:
            raise PolfuseError(
                f"cannot be read as HDF5 ({first_line(error)})",
                where=str(self.path),
                advice="check that it is a products file, or make it again with 'polfuse focus'",
            ) from error
        with file:
            with self._readable("version"):
                schema, version = file.attrs.get("schema"), int(file.attrs.get("version", 0))
            if schema != SCHEMA:
                raise PolfuseError(
                    f"is no products file (schema {schema!r})",
                    where=str(self.path),
                    advice="give the file that 'polfuse focus' wrote",
                )
            if version > VERSION:
                raise PolfuseError(
                    f"was written by a newer program (version {version}, known: {VERSION})",
                    where=str(self.path),
                    advice="update polfuse-lab",
                )
            yield file

    @contextmanager
    def _readable(self, what: str) -> Iterator[None]:
        """Reading only: what damaged bytes lead HDF5, h5py and JSON to is told as damage."""
        try:
            yield
        except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
            raise PolfuseError(
                f"its {what} cannot be read ({first_line(error)})",
                where=str(self.path),
                advice="the file is damaged there; use another copy, or make it again",
            ) from error
