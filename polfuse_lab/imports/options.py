"""Options of the command line that hold several values in one word, read into what the importers take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.positions import Wishes


def channel_list(text: str) -> tuple[Channel, ...]:
    """``"HH,HV"`` as channels. Raises :class:`PolfuseError` where a name is none."""
    try:
        return tuple(Channel[name.strip().upper()] for name in text.split(","))
    except KeyError as error:
        raise PolfuseError(
            f"there is no channel {error}", where="--channels", advice=f"choose from {', '.join(Channel.__members__)}"
        ) from error


def number_list(text: str, option: str) -> tuple[float, ...]:
    """``"0,45,90"`` as numbers. Raises :class:`PolfuseError` where one is none."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise PolfuseError(
            f"{text!r} is not a list of numbers", where=option, advice="write numbers with commas between them"
        ) from error


def wishes_of(
    channels: Sequence[Channel], positions: int | None, drop: Sequence[str], repeats: Sequence[str]
) -> dict[Channel, Wishes]:
    """What the user says about bursts, for each channel. Raises :class:`PolfuseError` where a word is not understood.

    Args:
        channels: channels of the files.
        positions: how many positions each file has.
        drop: words like ``"18"`` (of a single file), ``"HV:18"``, or several with commas.
        repeats: the same.
    """
    wishes = {channel: Wishes(positions) for channel in channels}
    for option, words in (("drop", drop), ("repeats", repeats)):
        for channel, number in (_burst(word, option, channels) for text in words for word in text.split(",")):
            wish = wishes[channel]
            wishes[channel] = replace(wish, **{option: getattr(wish, option) | {number}})
    return wishes


def _burst(word: str, option: str, channels: Sequence[Channel]) -> tuple[Channel, int]:
    name, colon, number = word.strip().rpartition(":")
    try:
        channel = Channel[name.upper()] if colon else channels[0]
        burst = int(number)
    except (KeyError, ValueError) as error:
        raise PolfuseError(
            f"{word!r} names no burst", where=f"--{option}", advice="write its number from 1, such as 18 or HV:18"
        ) from error
    if channel not in channels:
        raise PolfuseError(f"no file is of channel {channel.name}", where=f"--{option}", advice="correct the channel")
    if not colon and len(channels) > 1:
        raise PolfuseError(
            f"burst {burst} of which file?", where=f"--{option}", advice=f"write {channels[0].name}:{burst}"
        )
    return channel, burst
