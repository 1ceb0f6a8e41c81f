"""Calls each tool of `splatseg mcp` with the official client for Python. Exits with 1 if one of them does not answer.

pip install mcp
python tools/check_mcp.py PROGRAM map.ply [FOLDER FOR THE PICTURES]
"""

import asyncio
import base64
import sys
from pathlib import Path

from mcp import ClientSession, StdioServerParameters
from mcp.client.stdio import stdio_client


async def check(program: str, map_file: str, pictures: Path | None) -> None:
    server = StdioServerParameters(command=program, args=["mcp", map_file])
    async with stdio_client(server) as (read, write), ClientSession(read, write) as session:
        await session.initialize()
        tools = [tool.name for tool in (await session.list_tools()).tools]
        listed = await session.call_tool("list_objects", {"limit": 1})
        data = listed.model_dump(by_alias=True, mode="json")["structuredContent"]
        number = data["objects"][0]["id"]
        arguments = {
            "list_objects": {"limit": 3},
            "find_objects": {"words": "the largest"},
            "where_is": {"object": number},
            "what_is_near": {"object": number, "radius_m": 2.0},
            "what_changed": {},
            "picture_of": {"object": number},
            "plan_view": {"objects": [number]},
            "list_rooms": {},
            "route": {"from": number, "to": number},
        }
        assert sorted(tools) == sorted(arguments), tools
        for name, given in arguments.items():
            # The client itself checks the data against the tool's schema.
            result = (await session.call_tool(name, given)).model_dump(by_alias=True, mode="json")
            text = result["content"][0]["text"]
            has_no_floor = name in ("list_rooms", "route") and "are not known" in text
            assert not result["isError"] or has_no_floor, f"{name}: {text}"
            print(f"{name}: {text.splitlines()[0][:160]}")
            for image in result["content"][1:]:
                if pictures:
                    suffix = image["mimeType"].removeprefix("image/")
                    pictures.mkdir(parents=True, exist_ok=True)
                    (pictures / f"{name}.{suffix}").write_bytes(base64.b64decode(image["data"]))
        refused = (await session.call_tool("where_is", {"object": 4_000_000_000})).model_dump(
            by_alias=True, mode="json"
        )
        assert refused["isError"], refused
    print("all tools answer")


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    asyncio.run(check(sys.argv[1], sys.argv[2], Path(sys.argv[3]) if len(sys.argv) == 4 else None))
