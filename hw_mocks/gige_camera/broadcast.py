"""Hearing clients that look for cameras by broadcast, on one interface only."""

from __future__ import annotations

import contextlib
import ipaddress
import socket

from hw_mocks.gige_camera.bootstrap import GVCP_PORT

_SIOCGIFADDR = 0x8915


def broadcast_socket(address: str) -> socket.socket | None:
    """A socket that hears broadcasts to GVCP's port on the interface with this address; None where that cannot be."""
    name = _interface_of(address)
    if name is None or not hasattr(socket, "SO_BINDTODEVICE"):
        return None
    hears = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        hears.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        hears.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, name.encode())
        hears.bind(("255.255.255.255", GVCP_PORT))
    except OSError:
        hears.close()
        return None
    return hears


def _interface_of(address: str) -> str | None:
    """Name of the interface that has this address; None where the system does not tell."""
    if ipaddress.IPv4Address(address).is_loopback:
        return "lo"
    try:
        import fcntl

        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            for _, name in socket.if_nameindex():
                with contextlib.suppress(OSError):
                    found = fcntl.ioctl(probe.fileno(), _SIOCGIFADDR, name.encode().ljust(256, b"\0"))
                    if socket.inet_ntoa(found[20:24]) == address:
                        return name
    except (ImportError, OSError, AttributeError):
        return None
    return None
