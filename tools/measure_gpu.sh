#!/usr/bin/env bash
# Tests and times splatseg on the GPU of this machine, beside PyTorch on the same card. Fills the table of docs/GPU.md.
#
#     python3 -m venv target/gpu && target/gpu/bin/pip install torch torchvision ultralytics sam2
#     tools/measure_gpu.sh [gpu|vulkan|cuda|metal] [DATA]
#
# DATA is a folder with rooms/dev-a and redkitchen; without it the two videos are left out. Weights are random: speed does
# not depend on them. Everything is written to target/measure_gpu/, one file for each step. PYTHON names another Python, and
# TORCH_DEVICE another device for PyTorch than cuda. PASSES and FRAMES make it shorter, SIZE and MODEL smaller: to try
# the script itself on a machine without a GPU.
set -euo pipefail
cd "$(dirname "$0")/.."

device=${1:-gpu}
data=${2:-}
python=${PYTHON:-target/gpu/bin/python}
torch_device=${TORCH_DEVICE:-cuda}
passes=${PASSES:-50}
frames=${FRAMES:-20}
size=${SIZE:-1024}
model=${MODEL:-yolov8x-seg}
sam2=${SAM2:-base_plus}
objects=${OBJECTS:-1 5 20 100}
out=target/measure_gpu
mkdir -p "$out"

step() { printf '\n== %s\n' "$*"; }

step "build"
cargo build --release --locked --package splatseg --features "$device,autotune"
cargo build --release --locked --package xtask --features "$device,autotune"
target/release/splatseg devices | tee "$out/devices.txt"

step "tests on the device"
SPLATSEG_TEST_DEVICE=$device cargo test --release --locked --package splatseg-models --features "$device" \
    --lib --test sam2 --test fastsam 2>&1 | tee "$out/tests.log" | grep -a "^test result\|skipped\|FAILED"

step "FastSAM, $model at $size px"
"$python" tools/time_fastsam_pytorch.py "$out/$model.pt" --model "$model" --size "$size" --passes "$passes" \
    --device "$torch_device" | tee "$out/fastsam_pytorch.json"
target/release/xtask fastsam-speed "$out/$model.pt" "$size" "$passes" --device "$device" | tee "$out/fastsam.json"

step "SAM 2.1 $sam2 at $size px"
for compile in "" --compile; do
    # Words, not one argument: the numbers of objects.
    # shellcheck disable=SC2086
    "$python" tools/compare_sam2.py crates/models/tests/data/sam2 --size "$sam2" --image-size "$size" \
        --objects $objects --frames "$frames" --device "$torch_device" --splatseg-device "$device" $compile |
        tee "$out/sam2${compile:+_compiled}.json"
done

if [ -n "$data" ]; then
    step "videos"
    for scene in rooms/dev-a redkitchen; do
        name=$(basename "$scene")
        target/release/splatseg run "$data/$scene" --out "$out/run_$name" --overwrite --resize 320x240 --crop-border 5 \
            --segmenter fastsam --weights "$out/$model.pt" --device "$device" 2>&1 | tee "$out/run_$name.log" | tail -3
    done
fi
step "done: $out"
