"""Commented example files, written by ``polfuse init``: the thesis's rig, motorized or moved by hand, and its plans."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from polfuse_lab.errors import PolfuseError

MOTORIZED = {"rig": "rig.toml", "plan": "plan.toml", "sky": "sky.toml"}
"""What is written (key of the result) and which file it comes from."""
BY_HAND = MOTORIZED | {"rig": "rig_by_hand.toml"}
"""The same rig without motors: trolley and polarizer are moved by hand when the program asks."""


def write_examples(directory: Path | str, *, by_hand: bool = False, force: bool = False) -> dict[str, Path]:
    """Write ``rig.toml``, ``plan.toml`` and ``sky.toml`` into ``directory``, which is made if it is not there.

    Returns:
        The paths, by ``"rig"``, ``"plan"`` and ``"sky"``.

    Raises:
        PolfuseError: one of the files is there already and ``force`` is not set (none is written then), or the
            directory cannot be written.
    """
    directory = Path(directory)
    written = {key: directory / MOTORIZED[key] for key in MOTORIZED}
    if not force and (present := [path.name for path in written.values() if path.exists()]):
        raise PolfuseError(
            f"holds {', '.join(present)} already",
            where=str(directory),
            advice="choose another directory, or add --force to overwrite",
        )
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for key, source in (BY_HAND if by_hand else MOTORIZED).items():
            text = files(__package__).joinpath(source).read_text(encoding="utf-8")
            written[key].write_text(text, encoding="utf-8")
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(directory), advice="check the path and its permissions"
        ) from error
    return written
