# SPDX-License-Identifier: Apache-2.0

"""Count the bytes between a client and a server: a relay in a thread."""

from __future__ import annotations

import asyncio
import threading


class Relay:
    """Pass connections on to a server, and count.

    Attributes
    ----------
    address : str
        Where to connect instead, as tcp://host:port.
    received, sent : int
        Bytes that the clients received and sent.

    """

    def __init__(self, server: str):
        self._host, _, port = server.removeprefix('tcp://').rpartition(':')
        self._port = int(port)
        self.received = self.sent = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> Relay:
        self._thread.start()
        starting = asyncio.start_server(self._serve, '127.0.0.1', 0)
        self._server = asyncio.run_coroutine_threadsafe(starting, self._loop).result()
        self.address = f'tcp://127.0.0.1:{self._server.sockets[0].getsockname()[1]}'
        return self

    def __exit__(self, *error) -> None:
        self._loop.call_soon_threadsafe(self._server.close)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    async def _serve(self, from_client, to_client) -> None:
        from_server, to_server = await asyncio.open_connection(self._host, self._port)
        await asyncio.gather(
            self._pass(from_client, to_server, 'sent'),
            self._pass(from_server, to_client, 'received'),
        )

    async def _pass(self, reader, writer, what: str) -> None:
        try:
            while data := await reader.read(2**16):
                setattr(self, what, getattr(self, what) + len(data))
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass  # The other side has closed it.
        finally:
            writer.close()
