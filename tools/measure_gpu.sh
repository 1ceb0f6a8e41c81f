#!/usr/bin/env bash Tests and times splatseg on this machine's GPU, and PyTorch on the same card. Provides the table of
#docs/GPU.md.
#
#     python3 -m venv target/gpu && target/gpu/bin/pip install torch torchvision ultralytics sam2
#     tools/measure_gpu.sh [gpu|vulkan|cuda|metal] [DATA [WEIGHTS]]
#
# DATA is a folder with rooms/dev-a and redkitchen, WEIGHTS a checkpoint of FastSAM, e.g. FastSAM-x.pt; without them,
# the videos are skipped. The networks' speed is measured with random weights, on which it does not depend. Everything
# is written to target/measure_gpu/, one file per step; with NVIDIA's driver also the card's memory use, twice a second.
# PYTHON selects another Python, TORCH_DEVICE another device than cuda for PyTorch. To try the script itself on a
# machine without a GPU, PASSES and FRAMES make it shorter, SIZE, SAM2 and MODEL smaller, and TUNING= disables autotune.
set -euo pipefail
cd "$(dirname "$0")/.."

device=${1:-gpu}
data=${2:-}
weights=${3:-}
python=${PYTHON:-target/gpu/bin/python}
torch_device=${TORCH_DEVICE:-cuda}
tuning=${TUNING-autotune}
passes=${PASSES:-30}
frames=${FRAMES:-60}
size=${SIZE:-1024}
model=${MODEL:-yolov8x-seg}
sam2=${SAM2:-base_plus}
objects=${OBJECTS:-1 5 20 100}
out=target/measure_gpu
mkdir -p "$out"

step() { printf '\n== %s\n' "$*"; }

# A package's features in cargo's syntax for several packages.
features() {
    for name in "$device" $tuning; do
        printf '%s/%s,' "$1" "$name"
    done
}

if command -v nvidia-smi >/dev/null; then
    nvidia-smi --query-gpu=timestamp,memory.used --format=csv --loop-ms=500 >"$out/gpu_memory.csv" &
    trap 'kill %1' EXIT
fi

step "build"
cargo build --profile dist --locked --package splatseg-cli --package xtask --features "$(features splatseg-cli)$(features xtask)"
target/dist/splatseg devices | tee "$out/devices.txt"

step "tests on the device"
SPLATSEG_TEST_DEVICE=$device cargo test --profile dist --locked --package splatseg-models \
    --features "$(features splatseg-models)" --lib --test sam2 --test fastsam 2>&1 |
    tee "$out/tests.log" | grep -a "^test result\|skipped\|FAILED"

step "FastSAM, $model at $size px"
"$python" tools/time_fastsam_pytorch.py "$out/$model.pt" --model "$model" --size "$size" --passes "$passes" \
    --device "$torch_device" | tee "$out/fastsam_pytorch.json"
target/dist/xtask fastsam-speed "$out/$model.pt" "$size" "$passes" --device "$device" | tee "$out/fastsam.json"

step "SAM 2.1 $sam2 at $size px"
for compile in "" --compile; do
    # Words, not one argument: the numbers of objects.
    # shellcheck disable=SC2086
    "$python" tools/compare_sam2.py crates/models/tests/data/sam2 --size "$sam2" --image-size "$size" \
        --objects $objects --frames "$passes" --device "$torch_device" --splatseg-device "$device" $compile |
        tee "$out/sam2${compile:+_compiled}.json"
done

if [ -n "$weights" ]; then
    step "videos"
    options=(--resize 320x240 --crop-border 5 --max-frames "$frames" --segmenter fastsam --weights "$weights"
        --set "fastsam.image_size=$size" --device "$device" --overwrite)
    target/dist/splatseg bench --scenes "$data/rooms/dev-a" --methods fastsam-splat "${options[@]}" \
        --out "$out/bench_dev-a" 2>&1 | tee "$out/bench_dev-a.log" | grep "frames per second"
    target/dist/splatseg run "$data/redkitchen" "${options[@]}" \
        --out "$out/run_redkitchen" 2>&1 | tee "$out/run_redkitchen.log" | grep "frames per second"
fi
step "done: $out"
