"""Commented example files, written by ``polfuse init``: the thesis's rig, motorized or moved by hand, and its plans."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig.model import Rig
from polfuse_lab.rig.toml_model import parse_model

OTHER_PLANS = (
    "continuous_sar",
    "ranging",
    "doppler",
    "calibration_series",
    "polarizer_series",
    "active_optical",
    "custom",
)
"""Kinds of plan of which a small example is written into the folder ``plans``."""
MOTORIZED = {"rig": "rig.toml", "plan": "plan.toml", "sky": "sky.toml"} | {
    kind: f"plan_{kind}.toml" for kind in OTHER_PLANS
}
"""What is written (key of the result) and which file it comes from."""
BY_HAND = MOTORIZED | {"rig": "rig_by_hand.toml"}
"""The same rig without motors: trolley and polarizer are moved by hand when the program asks."""


def example_plan(kind: str) -> str:
    """The commented example of one kind of plan (``"plan"``, ``"sky"`` or one of :data:`OTHER_PLANS`)."""
    return files(__package__).joinpath(MOTORIZED[kind]).read_text(encoding="utf-8")


def thesis_rig() -> Rig:
    """The rig that ``polfuse init`` writes: the thesis's."""
    name = MOTORIZED["rig"]
    return parse_model(files(__package__).joinpath(name).read_text(encoding="utf-8"), Rig, name)


def write_examples(directory: Path | str, *, by_hand: bool = False, force: bool = False) -> dict[str, Path]:
    """Write a rig, two plans and a folder ``plans`` with one of each other kind into ``directory``, made if need be.

    Returns:
        The paths, by ``"rig"``, ``"plan"``, ``"sky"`` and the other kinds of plan.

    Raises:
        PolfuseError: one of the files is there already and ``force`` is not set (none is written then), or the
            directory cannot be written.
    """
    directory = Path(directory)
    names = {key: f"plans/{key}.toml" if key in OTHER_PLANS else source for key, source in MOTORIZED.items()}
    written = {key: directory / name for key, name in names.items()}
    if not force and (present := [names[key] for key, path in written.items() if path.exists()]):
        raise PolfuseError(
            f"holds {', '.join(present[:2])}{f' and {len(present) - 2} more' if present[2:] else ''} already",
            where=str(directory),
            advice="choose another directory, or add --force to overwrite",
        )
    try:
        (directory / "plans").mkdir(parents=True, exist_ok=True)
        for key, source in (BY_HAND if by_hand else MOTORIZED).items():
            text = files(__package__).joinpath(source).read_text(encoding="utf-8")
            written[key].write_text(text, encoding="utf-8")
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(directory), advice="check the path and its permissions"
        ) from error
    return written
