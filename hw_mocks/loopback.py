"""Addresses of the simulated rig's own services: loopback only, with a token that strangers do not know."""

from __future__ import annotations

import hmac
import secrets
import socket
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

from drivers.errors import DeviceLost, DeviceRefused

HOST = "127.0.0.1"
MAX_LINE = 512


@dataclass(frozen=True)
class Address:
    """Where a service of the simulated rig listens, written ``tcp://127.0.0.1:PORT?token=TOKEN``."""

    port: int
    token: str

    @property
    def url(self) -> str:
        """The address as one string, for a rig file."""
        return f"tcp://{HOST}:{self.port}?token={self.token}"

    @classmethod
    def parse(cls, url: str) -> Address:
        """Read an address.

        Raises:
            DeviceRefused: it is not ``tcp://127.0.0.1:PORT?token=TOKEN``; other hosts are never contacted.
        """
        try:
            parts = urlsplit(url)
            port, tokens = parts.port, parse_qs(parts.query).get("token", [])
        except ValueError:
            parts, port, tokens = urlsplit(""), None, []
        if parts.scheme != "tcp" or parts.hostname != HOST or not port or len(tokens) != 1 or not tokens[0].isalnum():
            raise DeviceRefused(
                f"{url!r} is no address of a simulated rig (tcp://{HOST}:PORT?token=TOKEN)",
                where="simulated rig",
                advice="copy the address that 'polfuse sim' printed",
            )
        return cls(port, tokens[0])


def listen() -> tuple[socket.socket, Address]:
    """Open a listening socket on a free loopback port, with a fresh token."""
    server = socket.create_server((HOST, 0))
    return server, Address(server.getsockname()[1], secrets.token_hex(16))


def connect(address: Address, timeout_s: float, service: str) -> socket.socket:
    """Connect to a service; the token is sent by the caller as its first line's first word.

    Raises:
        DeviceLost: nobody listens there.
    """
    try:
        return socket.create_connection((HOST, address.port), timeout=timeout_s)
    except OSError as error:
        raise DeviceLost(
            f"the simulated rig's {service} does not answer ({error.strerror or error})",
            where=f"tcp://{HOST}:{address.port}",
            advice="start 'polfuse sim' again and use the rig file that it writes",
        ) from error


def token_matches(given: bytes, address: Address) -> bool:
    """Whether a caller knows the token (compared in constant time)."""
    return hmac.compare_digest(given, address.token.encode())
