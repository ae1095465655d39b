"""What a job is to do: a command of ``polfuse``, the files that it reads and where what it makes goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

PathLike = Path | str


@dataclass(frozen=True)
class Made:
    """A word of the command that names something which the job makes or changes."""

    path: Path
    """Where it goes, absolute."""
    how: Literal["changed", "replaced", "new"] = "replaced"
    """``"changed"``: a products file, whose other stages stay; ``"new"``: it must not be there."""


Word = str | Made


@dataclass(frozen=True)
class JobSpec:
    """One job, before it is begun."""

    kind: str
    """The command's name."""
    title: str
    """For a list of jobs."""
    words: tuple[Word, ...]
    """The command after ``polfuse``; what is made is a :class:`Made`."""
    inputs: tuple[Path, ...] = ()
    """Files that it reads, by whose size its time is expected."""


def command(words: Sequence[str | Made], *, title: str = "", inputs: Sequence[PathLike] = ()) -> JobSpec:
    """Any command of ``polfuse``; it is given ``--json``.

    Args:
        words: the command after ``polfuse``; a :class:`Made` for each path that it writes.
        title: for a list of jobs; the command where left out.
        inputs: files that it reads.
    """
    shown = " ".join(str(word.path.name if isinstance(word, Made) else word) for word in words)
    kind = str(words[0])
    return JobSpec(kind, title or shown, tuple(words), tuple(Path(path).absolute() for path in inputs))


def focus(
    session: PathLike,
    products: PathLike,
    *,
    method: str = "auto",
    tolerance_db: float = -50.0,
    x_m: tuple[float, float] | None = None,
    y_m: tuple[float, float] | None = None,
    pixel_m: tuple[float, float] | None = None,
    sky: PathLike | None = None,
    target: str | None = None,
    autofocus: str | None = None,
    memory: str | None = None,
    **options: Any,
) -> JobSpec:
    """``polfuse focus``; other options by the command's own names (``window``, ``aperture``, ``oversampling`` …)."""
    words: list[Word] = ["focus", _read(session), "-o", _changed(products), f"--method={method}"]
    words += _options(tolerance_db=tolerance_db, sky=sky, target=target, memory=memory, **options)
    words += [
        f"--{name}={pair[0]!r},{pair[1]!r}" for name, pair in (("x", x_m), ("y", y_m), ("pixel", pixel_m)) if pair
    ]
    if autofocus is not None:
        words += ["--autofocus", f"--autofocus-method={autofocus}"]
    return JobSpec("focus", f"Focus {Path(session).name}", tuple(words), _inputs(session))


def optics(session: PathLike, products: PathLike, **options: Any) -> JobSpec:
    """``polfuse optics``."""
    words = ["optics", _read(session), "-o", _changed(products), *_options(**options)]
    return JobSpec("optics", f"Polarization of {Path(session).name}", tuple(words), _inputs(session))


def calibrate(products: PathLike, *, target: str, at: tuple[float, float], **options: Any) -> JobSpec:
    """``polfuse calibrate``; ``check_at`` is a pair too."""
    given = dict(options)
    check_at = given.pop("check_at", None)
    words: list[Word] = ["calibrate", _changed(products), f"--target={target}", f"--at={at[0]!r},{at[1]!r}"]
    if check_at is not None:
        words.append(f"--check-at={check_at[0]!r},{check_at[1]!r}")
    words += _options(**given)
    return JobSpec("calibrate", f"Calibrate {Path(products).name}", tuple(words), _inputs(products))


def decompose(products: PathLike, method: str, *, folder: PathLike | None = None, **options: Any) -> JobSpec:
    """``polfuse decompose``."""
    words: list[Word] = ["decompose", _changed(products), f"--method={method}", *_options(**options)]
    if folder is not None:
        words += ["-o", _made(folder)]
    return JobSpec("decompose", f"Decompose {Path(products).name}: {method}", tuple(words), _inputs(products))


def fuse(products: PathLike, **options: Any) -> JobSpec:
    """``polfuse fuse``."""
    words = ["fuse", _changed(products), *_options(**options)]
    return JobSpec("fuse", f"Fuse {Path(products).name}", tuple(words), _inputs(products))


def report(products: PathLike, page: PathLike, **options: Any) -> JobSpec:
    """``polfuse report``."""
    words = ["report", _read(products), "-o", _made(page), *_options(**options)]
    return JobSpec("report", f"Report on {Path(products).name}", tuple(words), _inputs(products))


def export(source: PathLike, to: str, output: PathLike, **options: Any) -> JobSpec:
    """``polfuse export``."""
    words = ["export", _read(source), f"--to={to}", "-o", _made(output), *_options(**options)]
    return JobSpec("export", f"Export {Path(source).name} to {to}", tuple(words), _inputs(source))


def range_(session: PathLike, picture: PathLike | None = None, **options: Any) -> JobSpec:
    """``polfuse range``; the picture lies beside the session where nothing else is said."""
    path = Path(session)
    drawn = path.with_name(f"{path.stem}_range.png") if picture is None else picture
    words = ["range", _read(session), "-o", _made(drawn), *_options(**options)]
    return JobSpec("range", f"Ranges in {path.name}", tuple(words), _inputs(session))


def replay(session: PathLike, copy: PathLike, *, speed: float | None = None) -> JobSpec:
    """``polfuse replay`` into a copy; to watch a replay, see :class:`polfuse_lab.engine.ReplayClient`."""
    words = ["replay", _read(session), "-o", Made(Path(copy).absolute(), "new"), *_options(speed=speed)]
    return JobSpec("replay", f"Replay {Path(session).name}", tuple(words), _inputs(session))


def _read(path: PathLike) -> Word:
    return str(Path(path).absolute())


def _made(path: PathLike) -> Word:
    return Made(Path(path).absolute())


def _changed(path: PathLike) -> Word:
    return Made(Path(path).absolute(), "changed")


def _inputs(*paths: PathLike) -> tuple[Path, ...]:
    return tuple(Path(path).absolute() for path in paths)


def _options(**values: Any) -> list[Word]:
    """Options of a command: ``None`` is left out, a flag is ``--name`` or ``--no-name``, a list is given one by one."""
    words: list[Word] = []
    for name, value in values.items():
        option = f"--{name.rstrip('_').replace('_', '-')}"
        if value is None:
            continue
        if isinstance(value, bool):
            words.append(option if value else f"--no-{option[2:]}")
        elif isinstance(value, list):
            words += [f"{option}={part}" for part in value]
        elif isinstance(value, Path):
            words.append(f"{option}={value.absolute()}")
        else:
            # With "=", since a negative number would be taken for an option of its own.
            words.append(f"{option}={value}")
    return words
