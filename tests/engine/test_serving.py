"""Clients that fall silent and come back: a laptop that slept, a stopped terminal, a processor that was busy."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest
import zmq

from polfuse_lab.engine import protocol
from polfuse_lab.engine.serving import LINGER_S, ClientServer

OUTCOME = protocol.Finished("finished", "", None, 1, 2, 3, 0, 0, None, 4.0, [])
SILENCE_S = 0.3


class Server(ClientServer):
    """Tells nothing, obeys nothing."""

    def _decode(self, content: bytes) -> protocol.ClientMessage:
        return protocol.decode_client(content)

    def _obey(self, message: Any) -> str | None:
        return "obeyed"

    def _states(self) -> dict[bytes, Any]:
        return {}

    @property
    def attached(self) -> int:
        return len(self._clients)


class Guest:
    """A client's bare socket."""

    def __init__(self, server: Server) -> None:
        self._socket = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.connect(server.endpoint)

    def say(self, message: Any) -> None:
        self._socket.send(protocol.encode(message))

    def hear(self) -> Any:
        assert self._socket.poll(5000), "nothing was heard"
        return protocol.decode_engine(self._socket.recv())

    def close(self) -> None:
        self._socket.close()


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@pytest.fixture
def server(tmp_path, monkeypatch):
    monkeypatch.setattr(protocol, "SILENCE_S", SILENCE_S)
    made = Server(tmp_path, protocol.Request("", "", "", "", "", token="secret", transport="tcp"))
    made.start()
    yield made
    made.end(OUTCOME)


@pytest.fixture
def guest(server):
    made = Guest(server)
    made.say(protocol.Attach(protocol.PROTOCOL_VERSION, "secret"))
    until(lambda: server.attached == 1)
    yield made
    made.close()


def test_a_client_that_comes_back_is_still_attached(server, guest):
    until(lambda: server.attached == 0)
    guest.say(protocol.Pause())
    assert guest.hear() == protocol.Refused("obeyed")  # not "attach first"
    assert server.attached == 1


def test_the_last_word_reaches_a_silent_client(server, guest):
    until(lambda: server.attached == 0)
    server.end(OUTCOME)
    assert guest.hear() == OUTCOME


def test_a_client_that_left_is_not_waited_for(server, guest):
    guest.say(protocol.Detach())
    until(lambda: server.attached == 0)
    began = time.monotonic()
    server.end(OUTCOME)
    assert time.monotonic() - began < LINGER_S / 2


def test_who_never_attached_is_refused(server, guest):
    stranger = Guest(server)
    stranger.say(protocol.Pause())
    assert stranger.hear() == protocol.Refused("attach first")
    stranger.close()
