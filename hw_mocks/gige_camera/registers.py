"""The camera's memory: the standard's bootstrap registers, its own features, and its description."""

from __future__ import annotations

import ipaddress
import threading
from collections.abc import Callable, Mapping, Sequence

from hw_mocks.gige_camera import bootstrap as gev
from hw_mocks.gige_camera import xml
from hw_mocks.gige_camera.bootstrap import Bootstrap, RegisterError, Status
from hw_mocks.gige_camera.features import Feature

WORD = 4
_MEMORY_END = 1 << 32

_CAPABILITY = (
    gev.CAPABILITY_CONCATENATION
    | gev.CAPABILITY_WRITE_MEMORY
    | gev.CAPABILITY_RESEND
    | gev.CAPABILITY_PENDING_ACK
    | gev.CAPABILITY_SWITCHOVER
    | gev.CAPABILITY_TEST_PACKET
    | gev.CAPABILITY_PRIMARY_SOCKET
    | gev.CAPABILITY_LINK_SPEED
    | gev.CAPABILITY_HEARTBEAT_DISABLE
    | gev.CAPABILITY_SERIAL
    | gev.CAPABILITY_USER_NAME
)
_HEARTBEAT_MS = 3000
_WRITABLE = (
    Bootstrap.HEARTBEAT_TIMEOUT_MS,
    Bootstrap.TIMESTAMP_CONTROL,
    Bootstrap.GVCP_CONFIGURATION,
    Bootstrap.SWITCHOVER_KEY,
    Bootstrap.GVSP_CONFIGURATION,
    Bootstrap.CONTROL_PRIVILEGE,
    Bootstrap.STREAM_PORT,
    Bootstrap.STREAM_PACKET_SIZE,
    Bootstrap.STREAM_PACKET_DELAY,
    Bootstrap.STREAM_IP,
)
_LEAST_PACKET, _GREATEST_PACKET = 576, 65_532


class Registers:
    """Memory of 32-bit big-endian words with limits, hooks and read-only places. Thread-safe.

    Args:
        features: table of features.
        texts: content of the bootstrap registers that hold text, but the URLs.
        address: IPv4 address of the camera.
        tick_hz: ticks per second of its clock.
        packet_size: stream packet size at power-up, bytes with IP and UDP headers.
        zip_first: whether the first URL is that of the zipped description (the second is always the plain one).
    """

    def __init__(
        self,
        features: Sequence[Feature],
        texts: Mapping[Bootstrap, str],
        *,
        address: str,
        tick_hz: int,
        packet_size: int,
        zip_first: bool,
    ) -> None:
        self._lock = threading.RLock()
        self._features = {feature.name: feature for feature in features if not feature.chunk}
        self._at = {
            word: feature
            for feature in self._features.values()
            if feature.own
            for word in range(feature.address, feature.address + feature.length, WORD)
        }
        self._texts = dict(texts)
        self._address = ipaddress.IPv4Address(address)
        self._tick_hz, self._packet_size, self._zip_first = tick_hz, packet_size, zip_first
        plain = xml.describe(features, texts[Bootstrap.VENDOR], texts[Bootstrap.MODEL])
        packed = xml.zipped(plain, "polfuse_camera.xml")
        self._plain_at = xml.DESCRIPTION_ADDRESS
        self._packed_at = self._plain_at + -(-len(plain) // 0x10000) * 0x10000
        self._blobs = ((self._plain_at, plain), (self._packed_at, packed))
        self._words: dict[int, int] = {}
        self._writable: set[int] = set()
        self.readers: dict[int, Callable[[], int]] = {}
        """Words that are made when they are read."""
        self.hooks: dict[int, Callable[[int], None]] = {}
        """What happens after a word was written; it may raise :class:`RegisterError`."""
        self.frozen: Callable[[], bool] = lambda: False
        """Whether features that fix the stream's shape are locked."""
        self.power_up()

    @property
    def description(self) -> bytes:
        """The GenICam description, plain."""
        return self._blobs[0][1]

    def power_up(self) -> None:
        """Set everything as after switching on. A name given by the user stays, as in a real camera."""
        with self._lock:
            user = {
                word: self._words[word]
                for word in range(Bootstrap.USER_NAME, Bootstrap.USER_NAME + 16, WORD)
                if word in self._words
            }
            self._words = dict.fromkeys(range(0, gev.DISCOVERY_SIZE, WORD), 0)
            self._writable = {int(word) for word in _WRITABLE}
            self._set_up_bootstrap()
            for feature in self._features.values():
                if feature.own:
                    self._words.update(dict.fromkeys(range(feature.address, feature.address + feature.length, WORD), 0))
                    if feature.writable:
                        self._writable.update(range(feature.address, feature.address + feature.length, WORD))
            self.load_defaults()
            self._words.update(user)

    def load_defaults(self) -> None:
        """Set the camera's own features as at power-up."""
        for feature in self._features.values():
            if feature.own and isinstance(feature.default, (int, float)):
                self._store(feature.address, feature.encode(feature.default))

    def _set_up_bootstrap(self) -> None:
        serial = self._texts[Bootstrap.SERIAL]
        mask = 0xFF000000 if self._address.is_loopback else 0xFFFFFF00
        values = {
            Bootstrap.VERSION: 0x00020000,
            Bootstrap.DEVICE_MODE: gev.UTF8_BIG_ENDIAN,
            # A locally administered address that two cameras of different serial numbers hardly share.
            Bootstrap.MAC_HIGH: 0x0200,
            Bootstrap.MAC_LOW: int.from_bytes(serial.encode()[-4:].rjust(4, b"\0"), "big"),
            Bootstrap.IP_CONFIGURATIONS: 0x00000007,
            Bootstrap.IP_CONFIGURATION: 0x00000005,
            Bootstrap.CURRENT_IP: int(self._address),
            Bootstrap.CURRENT_MASK: mask,
            Bootstrap.CURRENT_GATEWAY: 0,
            Bootstrap.INTERFACES: 1,
            Bootstrap.LINK_SPEED: 1000,
            Bootstrap.MESSAGE_CHANNELS: 0,
            Bootstrap.STREAM_CHANNELS: 1,
            Bootstrap.ACTION_SIGNALS: 0,
            Bootstrap.STREAM_CAPABILITY: gev.STREAM_SOURCE_PORT_CAPABILITY | gev.STREAM_64_BIT_CAPABILITY,
            Bootstrap.GVCP_CAPABILITY: _CAPABILITY,
            Bootstrap.HEARTBEAT_TIMEOUT_MS: _HEARTBEAT_MS,
            Bootstrap.TICK_HZ_HIGH: self._tick_hz >> 32,
            Bootstrap.TICK_HZ_LOW: self._tick_hz & 0xFFFFFFFF,
            Bootstrap.TIMESTAMP_CONTROL: 0,
            Bootstrap.TIMESTAMP_HIGH: 0,
            Bootstrap.TIMESTAMP_LOW: 0,
            Bootstrap.GVCP_CONFIGURATION: 0,
            Bootstrap.PENDING_TIMEOUT_MS: 200,
            Bootstrap.SWITCHOVER_KEY: 0,
            Bootstrap.GVSP_CONFIGURATION: 0,
            Bootstrap.CONTROL_PRIVILEGE: 0,
            Bootstrap.PRIMARY_PORT: 0,
            Bootstrap.PRIMARY_IP: 0,
            Bootstrap.STREAM_PORT: 0,
            Bootstrap.STREAM_PACKET_SIZE: self._packet_size,
            Bootstrap.STREAM_PACKET_DELAY: 0,
            Bootstrap.STREAM_IP: 0,
            Bootstrap.STREAM_SOURCE_PORT: 0,
        }
        self._words.update({int(address): value for address, value in values.items()})
        plain = xml.url("xml", self._plain_at, len(self._blobs[0][1]))
        packed = xml.url("zip", self._packed_at, len(self._blobs[1][1]))
        first, second = (packed, plain) if self._zip_first else (plain, plain)
        texts = {**self._texts, Bootstrap.FIRST_URL: first, Bootstrap.SECOND_URL: second}
        for address, size in gev.STRING_SIZES.items():
            # One byte at least ends the text.
            self._store(int(address), texts.get(address, "").encode()[: size - 1].ljust(size, b"\0"))
        self._writable.update(range(Bootstrap.USER_NAME, Bootstrap.USER_NAME + 16, WORD))

    # Access by address, as clients have it.

    def read(self, address: int, size: int) -> bytes:
        """Content of memory.

        Raises:
            RegisterError: address or size are not multiples of 4, or nothing is there.
        """
        if address % WORD or size % WORD:
            raise RegisterError(Status.BAD_ALIGNMENT)
        with self._lock:
            for start, content in self._blobs:
                end = start + -(-len(content) // WORD) * WORD
                if start <= address < end:
                    if address + size > end:
                        raise RegisterError(Status.INVALID_ADDRESS)
                    return content[address - start : address - start + size].ljust(size, b"\0")
            return b"".join(self._word(word).to_bytes(WORD, "big") for word in range(address, address + size, WORD))

    def write(self, address: int, content: bytes) -> None:
        """Write memory; all of it or nothing.

        Raises:
            RegisterError: bad alignment, nothing there, read-only, locked while frames are taken, or a value that a
                feature does not take.
        """
        if address % WORD or len(content) % WORD or not content:
            raise RegisterError(Status.BAD_ALIGNMENT)
        with self._lock:
            words = range(address, min(address + len(content), _MEMORY_END), WORD)
            for word in words:
                if word not in self._words:
                    blob = any(start <= word < start + len(content) for start, content in self._blobs)
                    raise RegisterError(Status.WRITE_PROTECT if blob else Status.INVALID_ADDRESS)
                if word not in self._writable:
                    raise RegisterError(Status.WRITE_PROTECT)
            before = {word: self._words[word] for word in words}
            self._store(address, content)
            try:
                for feature in dict.fromkeys(self._at[word] for word in words if word in self._at):
                    self._check(feature)
                for word in words:
                    self._words[word] = _allowed(word, self._words[word])
                    if word in self.hooks:
                        self.hooks[word](self._words[word])
            except RegisterError:
                self._words.update(before)
                raise

    def _check(self, feature: Feature) -> None:
        if feature.frozen and self.frozen():
            raise RegisterError(Status.BUSY)
        value = feature.decode(self._content(feature))
        high = feature.high
        if isinstance(high, str):
            first, second = high.split(" - ")
            high = self.value(first) - self.value(second)
        if feature.kind == "enumeration":
            good = value in feature.symbols.values()
        elif feature.kind in ("integer", "float"):
            stepped = feature.kind == "float" or (value - feature.low) % feature.step == 0
            # NaN fails every comparison.
            good = feature.low <= value <= high and stepped
        else:
            good = value in (0, 1)
        if not good:
            raise RegisterError(Status.INVALID_PARAMETER)

    # Access by name, as the camera itself has it.

    def value(self, name: str) -> float:
        """A feature's value."""
        with self._lock:
            feature = self._features[name]
            value = feature.decode(self._content(feature))
            if feature.bits is not None:
                low, high = feature.bits
                value = (int(value) >> low) & ((1 << (high - low + 1)) - 1)
            return value

    def number(self, address: int) -> int:
        """A word's value."""
        with self._lock:
            return self._word(address)

    def put(self, address: int, value: int) -> None:
        """Set a word, read-only ones too, without limits and hooks."""
        with self._lock:
            self._words[int(address)] = value & 0xFFFFFFFF

    def address_of(self, name: str) -> int:
        """Where a feature's register is."""
        return self._features[name].address

    def _content(self, feature: Feature) -> bytes:
        words = range(feature.address, feature.address + feature.length, WORD)
        return b"".join(self._word(word).to_bytes(WORD, "big") for word in words)

    def _word(self, word: int) -> int:
        if word in self.readers:
            return self.readers[word]() & 0xFFFFFFFF
        try:
            return self._words[int(word)]
        except KeyError:
            raise RegisterError(Status.INVALID_ADDRESS) from None

    def _store(self, address: int, content: bytes) -> None:
        for offset in range(0, len(content), WORD):
            self._words[address + offset] = int.from_bytes(content[offset : offset + WORD], "big")


def _allowed(word: int, value: int) -> int:
    """What a bootstrap register makes of a value written to it."""
    if word == Bootstrap.HEARTBEAT_TIMEOUT_MS:
        return max(value, 500)
    if word == Bootstrap.STREAM_PACKET_SIZE:
        size = min(max(value & gev.PACKET_SIZE_MASK, _LEAST_PACKET), _GREATEST_PACKET) // WORD * WORD
        return (value & (gev.FIRE_TEST_PACKET | gev.DO_NOT_FRAGMENT)) | size
    if word == Bootstrap.STREAM_PORT:
        return value & 0xFFFF
    if word == Bootstrap.SWITCHOVER_KEY:
        return value & 0xFFFF
    if word == Bootstrap.GVCP_CONFIGURATION:
        return value & (gev.HEARTBEAT_DISABLED | gev.PENDING_ACK_ENABLED)
    if word == Bootstrap.GVSP_CONFIGURATION:
        return value & gev.BLOCK_ID_64
    return value
