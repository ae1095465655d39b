"""The antennas of a rig as focusing needs them: who transmits and who receives, and from where."""

from __future__ import annotations

from collections.abc import Sequence

from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Rig
from processing.radar.antenna import AntennaPair

CHANNELS = ("HH", "HV", "VH", "VV")


def antenna_pairs(rig: Rig | None, channels: Sequence[str]) -> tuple[AntennaPair, ...] | None:
    """Phase centres of each channel's antennas, as the rig file tells them.

    Args:
        rig: the rig; None where a session has none.
        channels: names, transmit-then-receive.

    Returns:
        One pair for each channel; None where all antennas are in one place, the recorded one.
    """
    centres = None if rig is None else rig.geometry.phase_centres
    if centres is None:
        return None
    transmit = {"H": centres.transmit_h_m, "V": centres.transmit_v_m}
    receive = {"H": centres.receive_h_m, "V": centres.receive_v_m}
    pairs = tuple(AntennaPair(transmit[name[0]], receive[name[1]]) for name in channels)
    return None if all(pair == AntennaPair() for pair in pairs) else pairs


def check_method(rig: Rig | None, method: str) -> None:
    """Refuse range migration and polar format where the rig's antennas are apart.

    Raises:
        PolfuseError: one of them is asked for, which take both antennas to be in one place.
    """
    names = {"rma": "range migration", "pfa": "polar format"}
    if method in names and antenna_pairs(rig, CHANNELS) is not None:
        raise PolfuseError(
            f"{names[method]} takes the antennas to be in one place, and geometry.phase_centres puts them apart",
            where="method",
            advice="focus by back-projection (bp or ffbp), or leave the method out",
        )
