#!/usr/bin/env python3
"""Watches `splatseg live --view` like many browsers, some of which are stopped, to see that no frame becomes slower.

    pip install websockets
    tools/watch_live.py 'http://127.0.0.1:8765/?token=…' --viewers 10 --stopped 1 --seconds 60
"""

import argparse
import asyncio
import json

from websockets.asyncio.client import connect


def kind(message):
    if isinstance(message, str):
        return json.loads(message).get("kind")
    length = int.from_bytes(message[:4], "little")
    return json.loads(message[4 : 4 + length]).get("kind")


async def watch(url, is_stopped, seconds, counts):
    """Counts messages by kind. A stopped viewer connects and reads nothing more."""
    async with connect(url, max_size=None, max_queue=1) as socket:
        if is_stopped:
            await asyncio.sleep(seconds)
            return
        try:
            async with asyncio.timeout(seconds):
                async for message in socket:
                    name = kind(message)
                    counts[name] = counts.get(name, 0) + 1
                    await socket.send("shown")
        except TimeoutError:
            pass


async def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("link", help="the link that the command prints")
    parser.add_argument("--viewers", type=int, default=10)
    parser.add_argument("--stopped", type=int, default=1, help="how many of them read nothing")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    url = options.link.replace("http://", "ws://").replace("/?", "/live?")
    counts = [{} for _ in range(options.viewers)]
    watchers = (
        watch(url, number < options.stopped, options.seconds, counts[number]) for number in range(options.viewers)
    )
    for outcome in await asyncio.gather(*watchers, return_exceptions=True):
        if outcome is not None:
            print(f"a viewer ended: {outcome!r}")
    for number, viewer in enumerate(counts):
        print(f"viewer {number}: {viewer or 'stopped'}")


asyncio.run(main())
