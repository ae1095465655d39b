"""The engine's socket: clients come, steer, and go; the run does not depend on them."""

from __future__ import annotations

import contextlib
import hmac
import os
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import zmq

from polfuse_lab.engine import protocol
from polfuse_lab.live import LivePipeline
from polfuse_lab.scheduler import Outcome, Scheduler

LINGER_S = 2.0
"""How long a finished engine waits for its clients to take note."""


@dataclass
class _Client:
    heard: float
    preview: int = 0
    """Number of the newest preview that it has been sent."""


class Server:
    """Serves clients in a thread of its own until :meth:`finish`."""

    def __init__(self, directory: Path, request: protocol.Request, scheduler: Scheduler, live: LivePipeline) -> None:
        self._token = request.token
        self._scheduler = scheduler
        self._live = live
        self._clients: dict[bytes, _Client] = {}
        self._met = False
        """Whether any client has ever attached: a run may end before the one that started it gets to the socket."""
        self._outcome: Outcome | None = None
        self._changed = threading.Event()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 500)
        self._socket.setsockopt(zmq.SNDHWM, 100)
        self.endpoint = _bind(self._socket, directory, request.transport)
        self._thread = threading.Thread(target=self._work, name="engine server", daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def changed(self) -> None:
        """The scheduler's state has changed: tell it without delay."""
        self._changed.set()

    def finish(self, outcome: Outcome) -> None:
        """Tell the outcome, wait until every client has left (a few seconds at most), and end."""
        self._outcome = outcome
        self._thread.join(LINGER_S + 8)
        if self._thread.is_alive():
            # ZeroMQ ends the process when a socket is closed under the thread that uses it.
            return
        self._socket.close()
        self._context.term()

    def _work(self) -> None:
        sent = 0.0
        finished: float | None = None
        while True:
            if self._socket.poll(20):
                self._receive()
            now = time.monotonic()
            self._forget(now)
            if self._outcome is not None:
                if finished is None:
                    finished = now
                    self._tell(_finished(self._outcome))
                if (self._met and not self._clients) or now - finished > LINGER_S:
                    return
            elif self._changed.is_set() or now - sent > protocol.STATUS_EVERY_S:
                self._changed.clear()
                sent = now
                self._tell_status()

    def _receive(self) -> None:
        try:
            identity, content = self._socket.recv_multipart(zmq.NOBLOCK)
        except (zmq.Again, ValueError):
            return
        try:
            message = protocol.decode_client(content)
        except msgspec.MsgspecError as error:
            self._send(identity, protocol.Refused(f"message not understood ({error})"))
            return
        if isinstance(message, protocol.Attach):
            self._attach(identity, message)
        elif identity not in self._clients:
            self._send(identity, protocol.Refused("attach first"))
        else:
            self._clients[identity].heard = time.monotonic()
            self._obey(identity, message)

    def _attach(self, identity: bytes, message: protocol.Attach) -> None:
        if message.version != protocol.PROTOCOL_VERSION:
            self._send(
                identity,
                protocol.Refused(f"the engine speaks protocol {protocol.PROTOCOL_VERSION}, not {message.version}"),
            )
        elif not hmac.compare_digest(message.token.encode(), self._token.encode()):
            self._send(identity, protocol.Refused("wrong token"))
        else:
            self._met = True
            self._clients[identity] = _Client(time.monotonic())
            if self._outcome is not None:
                self._send(identity, _finished(self._outcome))
            else:
                self._tell_status()

    def _obey(self, identity: bytes, message: protocol.ClientMessage) -> None:
        match message:
            case protocol.Abort(reason):
                self._scheduler.control.abort(reason)
            case protocol.Pause():
                self._scheduler.control.pause()
            case protocol.Resume():
                self._scheduler.control.resume()
            case protocol.AddNote(text):
                if not self._scheduler.note(text):
                    self._send(identity, protocol.Refused("the collect has ended: the note was not kept"))
            case protocol.Answer(ticket):
                if not self._scheduler.prompts.answer(ticket):
                    self._send(identity, protocol.Refused(f"prompt {ticket} is not open"))
            case protocol.Detach():
                del self._clients[identity]

    def _forget(self, now: float) -> None:
        for identity in [key for key, client in self._clients.items() if now - client.heard > protocol.SILENCE_S]:
            del self._clients[identity]

    def _tell_status(self) -> None:
        status = asdict(self._scheduler.status())
        prompts = [protocol.Prompt(ticket, text) for ticket, text in self._scheduler.prompts.open()]
        fields = {**status, "state": str(status["state"]), "warnings": list(status["warnings"]), "prompts": prompts}
        preview = self._live.preview
        for identity, client in list(self._clients.items()):
            fresh = None
            if preview is not None and preview.number > client.preview:
                client.preview = preview.number
                fresh = protocol.PreviewData(
                    preview.number,
                    preview.position,
                    preview.x_m,
                    preview.channel,
                    preview.step_m,
                    preview.level_db.astype("<f4").tobytes(),
                )
            self._send(identity, protocol.StatusEvent(**fields, preview=fresh))

    def _tell(self, message: protocol.EngineMessage) -> None:
        for identity in list(self._clients):
            self._send(identity, message)

    def _send(self, identity: bytes, message: protocol.EngineMessage) -> None:
        # A client that does not read loses events; the engine never waits for it.
        with contextlib.suppress(zmq.ZMQError):
            self._socket.send_multipart([identity, protocol.encode(message)], zmq.NOBLOCK)


def _finished(outcome: Outcome) -> protocol.Finished:
    fields = asdict(outcome)
    session = None if outcome.session is None else str(outcome.session)
    return protocol.Finished(**{**fields, "session": session, "warnings": list(outcome.warnings)})


def _bind(socket: zmq.Socket[bytes], directory: Path, transport: str) -> str:
    if transport == "ipc":
        endpoint = f"ipc://{directory / 'engine.sock'}"
        before = os.umask(0o177)
        try:
            socket.bind(endpoint)
        finally:
            os.umask(before)
        return endpoint
    return f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
