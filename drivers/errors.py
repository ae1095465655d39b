"""What can go wrong with a device, in words that a person in the field can act on."""

from __future__ import annotations


class DeviceError(Exception):
    """A device failed: what happened, at which device or port, and what to do about it.

    ``str(error)`` is one sentence for the operator; the three parts stay separate for logs and windows.
    """

    def __init__(self, what: str, *, where: str, advice: str) -> None:
        super().__init__(f"{where}: {what}; {advice}")
        self.what = what
        self.where = where
        self.advice = advice

    def __reduce__(self) -> tuple[object, ...]:
        # Errors cross process borders (camera, writer); the default reduction loses keyword arguments.
        return _rebuild, (type(self), self.what, self.where, self.advice)


def _rebuild(kind: type[DeviceError], what: str, where: str, advice: str) -> DeviceError:
    return kind(what, where=where, advice=advice)


class DeviceLost(DeviceError):
    """The device went away: unplugged, powered off, or its process ended. Reopening may bring it back."""


class DeviceTimeout(DeviceError):
    """The device is reachable but did not answer or finish in its time."""


class DeviceRefused(DeviceError):
    """The device answered that it will not do what was asked (alarm, range, busy, wrong state)."""


class DeviceBadAnswer(DeviceError):
    """The device answered something that its protocol does not contain."""
