# SPDX-License-Identifier: Apache-2.0
"""A browser of a live view, as tests need one."""

import contextlib
import json
import time

import aiohttp

LIMIT_S = 120.0


class Watcher:
    """A browser's WebSocket: newest state, all events, answers."""

    def __init__(self, connection):
        self.connection = connection
        self.states, self.events, self.last, self.hello = 0, [], {}, None
        self._count = 0

    async def until(self, condition, limit_s=LIMIT_S):
        """Receive until the condition on (watcher, message) holds; returns that message."""
        deadline = time.monotonic() + limit_s
        while True:
            left_s = deadline - time.monotonic()
            assert left_s > 0.0, f"waited {limit_s} s; last: {self.last}, {self.events}"
            message = await self.connection.receive(left_s)
            assert message.type == aiohttp.WSMsgType.TEXT, f"closed; last: {self.last}"
            content = json.loads(message.data)
            if content["type"] == "state":
                self.states, self.last = self.states + 1, content
            elif content["type"] == "event":
                self.events.append(content)
            elif content["type"] == "hello":
                self.hello = content
            if condition(content):
                return content

    async def until_state(self, condition):
        """Receive until a state fulfils the condition."""
        return await self.until(lambda m: m["type"] == "state" and condition(m))

    async def ask(self, **request):
        """Send a request; its answer."""
        self._count += 1
        number = self._count
        await self.connection.send_str(json.dumps({"id": number, **request}))
        return await self.until(lambda m: m["type"] == "answer" and m["id"] == number)

    async def command(self, token, name, **args):
        """Send a command; its answer."""
        return await self.ask(type="command", token=token, name=name, args=args)


@contextlib.asynccontextmanager
async def watching(url, **options):
    """A browser at a page that has said hello."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{url}ws", max_msg_size=0, **options) as connection,
    ):
        watcher = Watcher(connection)
        await watcher.until(lambda m: m["type"] == "hello")
        yield watcher


def read_until(stream, words):
    """First line for each of the words at a line's beginning, by word."""
    values = {}
    while len(values) < len(words):
        line = stream.readline()
        assert line, f"ended before {words} were said; found {values}"
        for word in words:
            if line.startswith(f"{word}: "):
                values[word] = line.split(": ", 1)[1].split()[0]
    return values
