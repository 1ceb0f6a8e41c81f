"""Measures the overhead of a step in Python over the same frame in Rust.

    python python/benches/step.py ../shared/data/kitchen-dev --frames 100

Rust's time is that of `Pipeline::step`, measured in Rust. The rest of a step is checking and copying arrays, and Python
itself.
"""

import argparse
import statistics
import time

import splatseg as ss


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--segmenter", default="affinity")
    parser.add_argument("--weights")
    parser.add_argument("--threads", type=int, default=0)
    arguments = parser.parse_args()
    frames = list(ss.open_scene(arguments.scene, max_frames=arguments.frames))
    pipeline = ss.FastSamSplat(arguments.segmenter, weights=arguments.weights, threads=arguments.threads)
    in_rust, in_python = [], []
    for frame in frames:
        started = time.perf_counter()
        result = pipeline.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=frame.camera_to_world)
        in_python.append(1e3 * (time.perf_counter() - started))
        in_rust.append(result.times_ms["step"])
    height, width = frames[0].depth.shape
    more = [python - rust for python, rust in zip(in_python, in_rust, strict=True)]
    print(f"{len(frames)} frames of {width}x{height}")
    print(f"Rust    mean {statistics.mean(in_rust):8.2f} ms, median {statistics.median(in_rust):8.2f} ms")
    print(f"Python  mean {statistics.mean(in_python):8.2f} ms, median {statistics.median(in_python):8.2f} ms")
    print(f"more    mean {statistics.mean(more):8.2f} ms, median {statistics.median(more):8.2f} ms")
    print(f"        {100 * sum(more) / sum(in_rust):.2f} % of Rust's time")


if __name__ == "__main__":
    main()
