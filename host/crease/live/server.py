"""The page of a running loop, served to this machine alone: one address with a token in it, nothing else answers."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
from collections.abc import Callable
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

import numpy as np

from crease.base.errors import CreaseError
from crease.live.session import Session

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

HOST = "127.0.0.1"
VIEWS_S = 60.0
CATCH_UP_S = 0.25
"""Views that are late by less are sent all the same: 60 a second is what a page can count on."""
BEHIND_BYTES = 1 << 20
"""A page that lags this far behind is left out until it has caught up."""
MESSAGE_BYTES = 4096
"""Longest that a page may say."""
FAR_M = 10.0


def _answer(status: HTTPStatus, kind: str, body: bytes) -> Response:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    fields = {
        "Content-Type": f"{kind}; charset=utf-8",
        "Content-Length": str(len(body)),
        "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "Connection": "close",
    }
    return Response(status.value, status.phrase, Headers(fields), body)


class Server:
    """Serves `page(port, token)` and the views of a session, 60 a second, to whoever knows the token."""

    def __init__(self, session: Session, page: Callable[[str], str], port: int = 0) -> None:
        """page: makes the page from the address of its socket. port: 0 takes a free one."""
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self.views = 0
        """Views sent, counted once for all pages."""
        self._page, self._port = page, port
        self._text = b""
        self.address = ""
        """Where the page is; known when `serve` has called `ready`."""

    async def serve(self, ready: Callable[[str], None], seconds: float | None = None) -> None:
        """Serve until cancelled, or for some seconds.   Errors: CreaseError when the port cannot be had."""
        try:
            from websockets.asyncio.server import serve
        except ImportError as error:
            raise CreaseError(
                "view --live needs the package websockets: pip install websockets"
            ) from error
        try:
            server = await serve(
                self._talk,
                HOST,
                self._port,
                process_request=self._request,
                compression=None,
                max_size=MESSAGE_BYTES,
            )
        except OSError as error:
            raise CreaseError(
                f"port {self._port}: cannot be had: {error.strerror}; give another with --port"
            ) from error
        async with server:
            self._port = int(server.sockets[0].getsockname()[1])
            self.address = f"http://{HOST}:{self._port}/{self.token}/"
            self._text = self._page(self._socket()).encode("utf-8")
            self.session.start()
            ready(self.address)
            beat = asyncio.create_task(self._beat(server))
            try:
                await asyncio.wait({beat}, timeout=seconds)
            finally:
                beat.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await beat

    def _socket(self) -> str:
        return f"ws://{HOST}:{self._port}/{self.token}/live"

    def _request(self, _: ServerConnection, request: Request) -> Response | None:
        """The page, the socket (None: go on), or nothing. Another name for this machine is another's trick."""
        host = f"{HOST}:{self._port}"
        known = request.headers.get("Host") == host
        origin = request.headers.get("Origin")
        path = request.path.encode("utf-8", "replace")
        at = [f"/{self.token}/".encode(), f"/{self.token}/live".encode()]
        page, socket = (secrets.compare_digest(path, one) for one in at)
        if known and page:
            return _answer(HTTPStatus.OK, "text/html", self._text)
        if known and socket and origin == f"http://{host}":
            return None
        return _answer(
            HTTPStatus.FORBIDDEN, "text/plain", b"the address of the page is what crease said\n"
        )

    async def _talk(self, connection: ServerConnection) -> None:
        """What pages say: {"hand": [x, y, z]} in m, or {"hand": null}. Anything else ends the talk."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            async for message in connection:
                try:
                    self._obey(json.loads(message))
                except (ValueError, KeyError, TypeError):
                    await connection.close(1008, "say {hand: [x, y, z]}")
                    return

    def _obey(self, said: Any) -> None:
        hand = said["hand"]
        if hand is None:
            self.session.hand_m(None)
            return
        place = np.array([float(v) for v in hand])
        if place.shape != (3,) or not (np.abs(place) < FAR_M).all():
            raise ValueError
        self.session.hand_m(place)

    async def _beat(self, server: Any) -> None:
        """A view each sixtieth of a second, to those who keep up."""
        clock = asyncio.get_running_loop()
        due_s = clock.time()
        while self.session.trouble is None:
            due_s = max(due_s + 1.0 / VIEWS_S, clock.time() - CATCH_UP_S)
            await asyncio.sleep(max(0.0, due_s - clock.time()))
            listening = [
                c for c in server.connections if c.transport.get_write_buffer_size() < BEHIND_BYTES
            ]
            if not listening:
                continue
            from websockets.asyncio.server import broadcast

            broadcast(listening, json.dumps(self.session.view(), separators=(",", ":")))
            self.views += 1
