#!/usr/bin/env python3
"""Makes the animation at the top of the README: the page of a run, with its map turning and an object selected.

    python tools/make_page_animation.py ../shared/data/rooms/dev-a --object 59 --stills docs/images

Runs `splatseg run` on the scene, opens its page in a headless Chromium, and puts screenshots together with Pillow. The
scene's z axis must point up. `--stills FOLDER` also writes the two pictures of docs/TUTORIAL.md.
"""

import argparse
import base64
import io
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

SIZE = (1280, 800)
# Of the animation, which is reduced to this width.
WIDTH = 840
STILL_SIZE = (1024, 640)
FRAMES_PER_SECOND = 8
SECONDS = 12
# An object is selected in this part of the animation.
SELECTED = (0.35, 0.85)


class Browser:
    """A headless Chromium, driven over the DevTools protocol: JSON messages, each ended by a zero byte, on its
    descriptors 3 and 4."""

    def __init__(self, profile):
        to_browser, self.write = os.pipe()
        self.read, from_browser = os.pipe()
        flags = "--headless --no-sandbox --remote-debugging-pipe --no-first-run --disable-quic --hide-scrollbars"
        self.process = subprocess.Popen(
            [
                "sh",
                "-c",
                f'exec chromium "$@" 3<&{to_browser} 4>&{from_browser}',
                "sh",
                *flags.split(),
                f"--user-data-dir={profile}",
            ],
            pass_fds=(to_browser, from_browser),
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self.received = b""
        self.count = 0
        self.session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        size = {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def call(self, method, **parameters):
        """The result of a command; events in between are ignored."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.received:
                part = os.read(self.read, 1 << 20)
                if not part:
                    sys.exit("the browser has ended")
                self.received += part
            answer, self.received = self.received.split(b"\0", 1)
            answer = json.loads(answer)
            if answer.get("id") == self.count:
                if "error" in answer:
                    sys.exit(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def evaluate(self, expression):
        result = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            sys.exit(f"{expression}: {result['exceptionDetails']['exception'].get('description')}")
        return result["result"].get("value")

    def screenshot(self):
        return Image.open(io.BytesIO(base64.b64decode(self.call("Page.captureScreenshot")["data"]))).convert("RGB")


def orbit(objects):
    """A function from a turn (0 to 1) to the page's view of the map, as `x,y,z` of the eye and of the point it looks at."""
    boxes = [item["shape"]["axis_aligned_box"] for item in objects if item.get("shape")]
    low = [statistics.quantiles([box["min"][axis] for box in boxes], n=20)[0] for axis in range(3)]
    high = [statistics.quantiles([box["max"][axis] for box in boxes], n=20)[-1] for axis in range(3)]
    middle = [(a + b) / 2 for a, b in zip(low, high)]
    distance = 1.15 * math.dist(low, high)

    def view(turn):
        angle = 2 * math.pi * turn
        eye = [
            middle[0] + 0.72 * distance * math.cos(angle),
            middle[1] + 0.72 * distance * math.sin(angle),
            middle[2] + 0.6 * distance,
        ]
        return ",".join(f"{value:.3f}" for value in eye + middle)

    return view


def pictures(browser, page, view, chosen, frame_count):
    """The screenshots of the animation."""
    count = FRAMES_PER_SECOND * SECONDS
    for index in range(count):
        part = index / count
        state = {"frame": int(part * frame_count), "view": view(0.1 + 0.6 * part)}
        if SELECTED[0] <= part < SELECTED[1]:
            state["object"] = chosen
        yield shot(browser, page, state)


def shot(browser, page, state):
    """The page in a state of its address, once it is drawn."""
    hash_ = "&".join(f"{name}={value}" for name, value in state.items())
    if browser.evaluate("location.protocol") != "file:":
        browser.call("Page.navigate", url=f"file://{page}#{hash_}")
    else:
        browser.evaluate("delete document.documentElement.dataset.ready")
        browser.evaluate(f"location.hash = {json.dumps(hash_)}")
    drawn = "document.documentElement?.dataset.ready === 'yes'"
    wait = f"""new Promise((resolve) => {{
        const look = () => ({drawn} ? requestAnimationFrame(() => requestAnimationFrame(resolve)) : setTimeout(look, 20));
        look();
    }})"""
    browser.evaluate(wait)
    return browser.screenshot()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--object", type=int, required=True, help="id of the object that is selected")
    parser.add_argument("--splatseg", default="target/release/splatseg")
    parser.add_argument("--out", type=Path, default=Path("docs/images/page.webp"))
    parser.add_argument("--run", type=Path, help="folder of a run that exists, in place of a new one")
    parser.add_argument("--stills", type=Path, help="folder for single pictures")
    parser.add_argument("--quality", type=int, default=45)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = (arguments.run or Path(folder) / "run").resolve()
        if not arguments.run:
            subprocess.run([arguments.splatseg, "run", arguments.scene, "--out", run], check=True)
        objects = json.loads((run / "objects.json").read_text())["objects"]
        frame_count = json.loads((run / "summary.json").read_text())["frames"]
        browser = Browser(Path(folder) / "profile")
        view = orbit(objects)
        shots = list(pictures(browser, run / "index.html", view, arguments.object, frame_count))
        if arguments.stills:
            arguments.stills.mkdir(parents=True, exist_ok=True)
            for name, picture in [("page", shots[0]), ("object", shots[len(shots) // 2])]:
                small = picture.resize(STILL_SIZE, Image.Resampling.LANCZOS)
                small.save(arguments.stills / f"tutorial-{name}.jpg", quality=80, optimize=True)
        browser.process.kill()
    height = round(WIDTH * SIZE[1] / SIZE[0])
    small = [shot.resize((WIDTH, height), Image.Resampling.LANCZOS) for shot in shots]
    duration = round(1000 / FRAMES_PER_SECOND)
    small[0].save(
        arguments.out,
        save_all=True,
        append_images=small[1:],
        duration=duration,
        loop=0,
        quality=arguments.quality,
        method=6,
    )
    print(f"{arguments.out}: {len(small)} frames, {SECONDS} s, {arguments.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
