#!/usr/bin/env bash
# Tests and times splatseg on the GPU of this machine, beside PyTorch on the same card. Fills the table of docs/GPU.md.
#
#     python3 -m venv target/gpu && target/gpu/bin/pip install torch torchvision ultralytics sam2
#     tools/measure_gpu.sh [gpu|vulkan|cuda|metal] [DATA [WEIGHTS]]
#
# DATA is a folder with rooms/dev-a and redkitchen, WEIGHTS a checkpoint of FastSAM, e.g. FastSAM-x.pt: without them the
# videos are left out. The networks' speed is measured with random weights, on which it does not depend. Everything is written to target/measure_gpu/, one file for each step; with NVIDIA's driver also what
# the card's memory held, twice a second. PYTHON names another Python, and TORCH_DEVICE another device for PyTorch than cuda.
# PASSES and FRAMES make it shorter, SIZE, SAM2 and MODEL smaller, TUNING= leaves autotune out: to try the script itself on a
# machine without a GPU.
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

# The features of a package, as cargo takes them for several packages. The memory needs `gpu` whatever runs the networks.
features() {
    for name in gpu "$device" $tuning; do
        printf '%s/%s,' "$1" "$name"
    done
}

if command -v nvidia-smi >/dev/null; then
    nvidia-smi --query-gpu=timestamp,memory.used --format=csv --loop-ms=500 >"$out/gpu_memory.csv" &
    trap 'kill %1' EXIT
fi

step "build"
cargo build --release --locked --package splatseg --package xtask --features "$(features splatseg)$(features xtask)"
target/release/splatseg devices | tee "$out/devices.txt"

step "tests on the device"
SPLATSEG_TEST_DEVICE=$device cargo test --release --locked --package splatseg-models --package splatseg-render-gpu \
    --features "$(features splatseg-models)" --lib --test sam2 --test fastsam --test both_sides 2>&1 |
    tee "$out/tests.log" | grep -a "^test result\|skipped\|FAILED"

step "FastSAM, $model at $size px"
"$python" tools/time_fastsam_pytorch.py "$out/$model.pt" --model "$model" --size "$size" --passes "$passes" \
    --device "$torch_device" | tee "$out/fastsam_pytorch.json"
target/release/xtask fastsam-speed "$out/$model.pt" "$size" "$passes" --device "$device" | tee "$out/fastsam.json"

step "SAM 2.1 $sam2 at $size px"
for compile in "" --compile; do
    # Words, not one argument: the numbers of objects.
    # shellcheck disable=SC2086
    "$python" tools/compare_sam2.py crates/models/tests/data/sam2 --size "$sam2" --image-size "$size" \
        --objects $objects --frames "$passes" --device "$torch_device" --splatseg-device "$device" $compile |
        tee "$out/sam2${compile:+_compiled}.json"
done

if [ -n "$data" ]; then
    step "memory on both sides"
    for scene in rooms/dev-a redkitchen; do
        for kind in evidence features; do
            cargo run --release --locked --package splatseg-render-gpu --example agreement -- \
                "$data/$scene" "$frames" "$kind" | tee "$out/agreement_$(basename "$scene")_$kind.txt" | tail -3
        done
    done
fi

if [ -n "$weights" ]; then
    step "videos"
    options=(--resize 320x240 --crop-border 5 --max-frames "$frames" --segmenter fastsam --weights "$weights"
        --set "fastsam.image_size=$size" --device "$device" --overwrite)
    for memory in cpu gpu; do
        target/release/splatseg bench --scenes "$data/rooms/dev-a" --methods fastsam-splat "${options[@]}" \
            --memory-device "$memory" --out "$out/bench_dev-a_$memory" 2>&1 | tee "$out/bench_dev-a_$memory.log" |
            grep "frames per second"
        target/release/splatseg run "$data/redkitchen" "${options[@]}" --memory-device "$memory" \
            --out "$out/run_redkitchen_$memory" 2>&1 | tee "$out/run_redkitchen_$memory.log" | grep "frames per second"
    done
fi
step "done: $out"
