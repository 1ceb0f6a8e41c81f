#!/usr/bin/env python3
"""Compares times and peak memory of a network with ONNX Runtime, at the same image size, in one run.

Needs `pip install ultralytics onnx onnxscript onnxruntime` and our runner:
    cargo build --profile dist --package xtask
    python tools/compare_onnxruntime.py --xtask target/dist/xtask                    # FastSAM
    python tools/compare_onnxruntime.py --xtask target/dist/xtask --model affinity   # the learned segmenter's, 320x240

The weights are random, because a network's speed does not depend on them. The first run writes them to --folder as an
Ultralytics checkpoint and as ONNX. Each round starts a fresh process of each implementation, one after the other, so
that both run under the same conditions. A process runs once to warm up, then --passes times. Peak memory is VmHWM,
including loading.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

AFFINITY_SIZE = (240, 320)


def random_checkpoint(checkpoint: Path, name: str, size: int) -> None:
    """Writes a network of random weights as an Ultralytics checkpoint."""
    import torch
    from ultralytics.nn.tasks import SegmentationModel

    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    model = SegmentationModel(f"{name}.yaml", nc=1, verbose=False)
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.normal_(module.bias, std=0.2)
            torch.nn.init.normal_(module.running_mean, std=0.2)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
    model.names = {0: "object"}
    model.args = {"task": "segment", "imgsz": size, "data": None, "single_cls": True}
    model.task = "segment"
    torch.save({"model": model.half(), "ema": None, "train_args": model.args}, checkpoint)


def export_affinity(folder: Path) -> Path:
    """ONNX file of the learned segmenter's network from training/, with folded batch norms; made if it is missing."""
    graph = folder / "affinity.onnx"
    if not graph.exists():
        import torch
        from torch.fx.experimental.optimization import fuse

        sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "training"))
        from splatseg_training.network import AffinityNet

        folder.mkdir(parents=True, exist_ok=True)
        torch.manual_seed(0)
        network = fuse(AffinityNet().eval())
        torch.onnx.export(network, torch.rand(1, 8, *AFFINITY_SIZE), graph, opset_version=17, dynamo=False)
    return graph


def export(folder: Path, name: str, size: int) -> tuple[Path, Path]:
    """Checkpoint and ONNX file of a random network, made if they are missing."""
    checkpoint, graph = folder / f"{name}.pt", folder / f"{name}-{size}.onnx"
    if checkpoint.exists() and graph.exists():
        return checkpoint, graph
    from ultralytics import YOLO

    if not checkpoint.exists():
        random_checkpoint(checkpoint, name, size)
    exported = YOLO(checkpoint).export(format="onnx", imgsz=size, simplify=False, opset=17, device="cpu")
    os.replace(exported, graph)
    return checkpoint, graph


def memory_mib(field: str) -> float:
    """A field of /proc/self/status, e.g. VmHWM."""
    with open("/proc/self/status", encoding="ascii") as status:
        return next(int(line.split()[1]) / 1024 for line in status if line.startswith(field + ":"))


def run_onnxruntime(graph: Path, shape: tuple[int, ...], threads: int, passes: int) -> None:
    """Child process: prints its times and memory as JSON."""
    import numpy
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    before = memory_mib("VmHWM")
    session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    image = numpy.random.default_rng(0).random(shape, dtype=numpy.float32)
    feed = {session.get_inputs()[0].name: image}
    session.run(None, feed)
    times = []
    for _ in range(passes):
        start = time.perf_counter()
        session.run(None, feed)
        times.append(1e3 * (time.perf_counter() - start))
    print(json.dumps({"milliseconds": times, "peak_mib": memory_mib("VmHWM"), "before_mib": before}))


def child(command: list, environment: dict | None = None) -> dict:
    """Runs a command and parses the last line of its output as JSON."""
    result = subprocess.run(
        [str(part) for part in command],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, **(environment or {})},
    )
    if result.returncode != 0:
        sys.exit(f"{command[0]} failed:\n{result.stderr}")
    return json.loads(result.stdout.strip().splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--xtask", type=Path, default=Path("target/dist/xtask"))
    parser.add_argument("--folder", type=Path, default=Path("target/compare"), help="where the weights are kept")
    parser.add_argument("--model", default="yolov8x-seg", help="yolov8{n,s,m,l,x}-seg or affinity")
    parser.add_argument("--size", type=int, default=640, help="height and width of the image")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--passes", type=int, default=5)
    parser.add_argument("--onnxruntime-child", type=Path, help=argparse.SUPPRESS)
    settings = parser.parse_args()
    if settings.onnxruntime_child:
        shape = (1, 8, *AFFINITY_SIZE) if settings.model == "affinity" else (1, 3, settings.size, settings.size)
        run_onnxruntime(settings.onnxruntime_child, shape, settings.threads, settings.passes)
        return
    if settings.model == "affinity":
        graph = export_affinity(settings.folder)
        ours = [settings.xtask, "affinity-speed", settings.passes]
        size = f"{AFFINITY_SIZE[1]}×{AFFINITY_SIZE[0]}"
    else:
        checkpoint, graph = export(settings.folder, settings.model, settings.size)
        ours = [settings.xtask, "fastsam-speed", checkpoint, settings.size, settings.passes]
        size = f"{settings.size}×{settings.size}"
    results = {"splatseg": [], "ONNX Runtime": []}
    for _ in range(settings.rounds):
        flags = ["--model", settings.model, "--size", settings.size]
        flags += ["--passes", settings.passes, "--threads", settings.threads]
        results["ONNX Runtime"].append(child([sys.executable, __file__, "--onnxruntime-child", graph, *flags]))
        threads = {"RAYON_NUM_THREADS": str(settings.threads)}
        results["splatseg"].append(child(ours, threads))
    print(f"{settings.model}, {size}, batch 1, {settings.threads} threads; ", end="")
    print(f"{settings.rounds} processes each in turn, {settings.passes} passes a process")
    print(f"{'':14}{'ms min':>9}{'ms median':>11}{'peak MiB':>10}")
    for side, rounds in results.items():
        times = [time for result in rounds for time in result["milliseconds"]]
        peak = max(result["peak_mib"] for result in rounds)
        note = f"   (Python and its modules: {rounds[0]['before_mib']:.0f})" if "before_mib" in rounds[0] else ""
        print(f"{side:14}{min(times):9.1f}{statistics.median(times):11.1f}{peak:10.0f}{note}")


if __name__ == "__main__":
    main()
