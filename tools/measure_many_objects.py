#!/usr/bin/env python3
"""Memory and time of SAM 2.1 with hundreds of objects in one video: the synthetic room, prompted with ground truth.

    cargo build --profile dist --features networks
    python tools/measure_many_objects.py --weights ../shared/golden/sam2/sam2_mini.pt

Runs `splatseg run` once for each method and value of `sam2.max_absent_frames`, the first of which (0) never deactivates
an object. Prints a Markdown table: objects at the end, number of objects tracked by the network in the last frame, mean
time of a frame in the first and the last quarter of the run (all stages except the segmenter), and peak memory. The
miniature network is random: its masks are meaningless, and it classifies hardly any object as absent. With
`--score-bias -50` (`pip install torch`) it classifies every tracked object as absent, so that all are deactivated, as
are objects out of view with a trained network. `--keep FOLDER` keeps the results, with the curve of each run in
`summary.json`.
"""

import argparse
import json
import os
import re
import subprocess
import tempfile
from pathlib import Path


def run(arguments, method, settings, out):
    """The summary of a run, and the numbers of objects in the log of each frame."""
    scene = f"synthetic:frames={arguments.frames},seed=0,width=320,height=240,objects={arguments.objects}"
    command = [arguments.splatseg, "run", scene, "--out", out, "--method", method, "--prompts", "ground-truth"]
    command += ["--tracker-weights", arguments.weights]
    settings = {"min_area": 10, "sam2.image_size": arguments.image_size} | settings
    for key, value in settings.items():
        command += ["--set", f"{key}={value}"]
    log = subprocess.run(
        [str(part) for part in command],
        env=os.environ | {"RUST_LOG": "warn,splatseg_tracking=debug"},
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        check=False,
    )
    if log.returncode != 0:
        raise SystemExit(log.stderr[-2000:])
    counts = [(int(all), int(followed)) for all, followed in re.findall(r"objects=(\d+) followed=(\d+)", log.stderr)]
    return json.loads((out / "summary.json").read_text()), counts


def with_score_bias(weights, bias, out):
    """Writes the checkpoint with another bias of the object score."""
    import torch

    checkpoint = torch.load(weights, weights_only=True)
    checkpoint["model"]["sam_mask_decoder.pred_obj_score_head.layers.2.bias"] += bias
    torch.save(checkpoint, out)
    return out


def row(method, settings, summary, counts):
    times = [point["ms"] for point in summary["curve"]]
    quarter = max(1, len(times) // 4)
    first, last = (sum(part) / len(part) for part in (times[:quarter], times[-quarter:]))
    name = ", ".join(f"{key}={value}" for key, value in settings.items())
    (objects, followed) = counts[-1]
    return (
        f"| {method} | {name} | {objects} | {followed} | {first:.0f} | {last:.0f} | {summary['peak_memory_mb']:.0f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--splatseg", default="target/dist/splatseg", help="the program")
    parser.add_argument("--weights", required=True, help="checkpoint of SAM 2.1")
    parser.add_argument("--objects", type=int, default=300)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--image-size", type=int, default=256)
    parser.add_argument("--methods", nargs="+", default=["sam2", "sam2-splat"])
    parser.add_argument("--absent", type=int, nargs="+", default=[0, 16], help="values of sam2.max_absent_frames")
    parser.add_argument("--chunks", type=int, nargs="+", default=[4], help="values of sam2.objects_per_chunk")
    parser.add_argument("--score-bias", type=float, default=0.0, help="added to the network's object scores")
    parser.add_argument("--keep", type=Path, help="folder for the results")
    arguments = parser.parse_args()
    print(
        "| method | settings | objects | tracked in the last frame | ms, first quarter | ms, last quarter | peak MB |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory(prefix="splatseg-objects-") as folder:
        if arguments.score_bias:
            arguments.weights = with_score_bias(arguments.weights, arguments.score_bias, Path(folder) / "weights.pt")
        for method in arguments.methods:
            for chunk in arguments.chunks:
                for absent in arguments.absent:
                    settings = {"sam2.max_absent_frames": absent, "sam2.objects_per_chunk": chunk}
                    out = (arguments.keep or Path(folder)) / f"{method}-{absent}-{chunk}"
                    print(row(method, settings, *run(arguments, method, settings, out)), flush=True)


if __name__ == "__main__":
    main()
