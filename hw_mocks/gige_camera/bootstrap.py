"""Bootstrap registers of GigE Vision: addresses, bits and status codes (GigE Vision 2.0, sections 16 and 28)."""

from __future__ import annotations

import enum

GVCP_PORT = 3956


class Status(enum.IntEnum):
    """Status codes of GVCP and GVSP."""

    SUCCESS = 0x0000
    NOT_IMPLEMENTED = 0x8001
    INVALID_PARAMETER = 0x8002
    INVALID_ADDRESS = 0x8003
    WRITE_PROTECT = 0x8004
    BAD_ALIGNMENT = 0x8005
    ACCESS_DENIED = 0x8006
    BUSY = 0x8007
    PACKET_UNAVAILABLE = 0x800C
    DATA_OVERRUN = 0x800D
    INVALID_HEADER = 0x800E
    ERROR = 0x8FFF


class RegisterError(Exception):
    """A register cannot be read or written; ``status`` says why."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


class Bootstrap(enum.IntEnum):
    """Addresses."""

    VERSION = 0x0000
    DEVICE_MODE = 0x0004
    MAC_HIGH = 0x0008
    MAC_LOW = 0x000C
    IP_CONFIGURATIONS = 0x0010
    IP_CONFIGURATION = 0x0014
    CURRENT_IP = 0x0024
    CURRENT_MASK = 0x0034
    CURRENT_GATEWAY = 0x0044
    VENDOR = 0x0048
    MODEL = 0x0068
    DEVICE_VERSION = 0x0088
    MANUFACTURER_INFO = 0x00A8
    SERIAL = 0x00D8
    USER_NAME = 0x00E8
    FIRST_URL = 0x0200
    SECOND_URL = 0x0400
    INTERFACES = 0x0600
    LINK_SPEED = 0x0670
    MESSAGE_CHANNELS = 0x0900
    STREAM_CHANNELS = 0x0904
    ACTION_SIGNALS = 0x0908
    STREAM_CAPABILITY = 0x092C
    GVCP_CAPABILITY = 0x0934
    HEARTBEAT_TIMEOUT_MS = 0x0938
    TICK_HZ_HIGH = 0x093C
    TICK_HZ_LOW = 0x0940
    TIMESTAMP_CONTROL = 0x0944
    TIMESTAMP_HIGH = 0x0948
    TIMESTAMP_LOW = 0x094C
    GVCP_CONFIGURATION = 0x0954
    PENDING_TIMEOUT_MS = 0x0958
    SWITCHOVER_KEY = 0x095C
    GVSP_CONFIGURATION = 0x0960
    CONTROL_PRIVILEGE = 0x0A00
    PRIMARY_PORT = 0x0A04
    PRIMARY_IP = 0x0A14
    STREAM_PORT = 0x0D00
    STREAM_PACKET_SIZE = 0x0D04
    STREAM_PACKET_DELAY = 0x0D08
    STREAM_IP = 0x0D18
    STREAM_SOURCE_PORT = 0x0D1C


DISCOVERY_SIZE = 0x00F8
"""Bytes of the discovery acknowledge: the registers from 0 on."""

STRING_SIZES = {
    Bootstrap.VENDOR: 32,
    Bootstrap.MODEL: 32,
    Bootstrap.DEVICE_VERSION: 32,
    Bootstrap.MANUFACTURER_INFO: 48,
    Bootstrap.SERIAL: 16,
    Bootstrap.USER_NAME: 16,
    Bootstrap.FIRST_URL: 512,
    Bootstrap.SECOND_URL: 512,
}
"""Bytes of the registers that hold text."""

# Bits, counted from the least significant (the standard counts from the other end).
CAPABILITY_CONCATENATION = 1 << 0
CAPABILITY_WRITE_MEMORY = 1 << 1
CAPABILITY_RESEND = 1 << 2
CAPABILITY_PENDING_ACK = 1 << 5
CAPABILITY_SWITCHOVER = 1 << 21
CAPABILITY_TEST_PACKET = 1 << 25
CAPABILITY_PRIMARY_SOCKET = 1 << 27
CAPABILITY_LINK_SPEED = 1 << 28
CAPABILITY_HEARTBEAT_DISABLE = 1 << 29
CAPABILITY_SERIAL = 1 << 30
CAPABILITY_USER_NAME = 1 << 31

STREAM_SOURCE_PORT_CAPABILITY = 1 << 31
STREAM_64_BIT_CAPABILITY = 1 << 30

HEARTBEAT_DISABLED = 1 << 0
PENDING_ACK_ENABLED = 1 << 2

LATCH_TIMESTAMP = 1 << 1
RESET_TIMESTAMP = 1 << 0

EXCLUSIVE = 1 << 0
CONTROL = 1 << 1
SWITCHOVER_ENABLED = 1 << 2

FIRE_TEST_PACKET = 1 << 31
DO_NOT_FRAGMENT = 1 << 30
PACKET_SIZE_MASK = 0xFFFF

BLOCK_ID_64 = 1 << 30

UTF8_BIG_ENDIAN = 0x80000001
