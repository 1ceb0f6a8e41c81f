#!/usr/bin/env bash
# Tries the program for ARM on another machine, emulated: tools/arm/check.sh [PACKAGE...]
#
# Runs the tests of the packages that use vector instructions, or of those given, and then the demo, whose ids and map
# must be the bytes of this machine's own program. Last, it counts the instructions of six frames with each set, on both.
#
# It needs Debian's gcc, gcc-aarch64-linux-gnu and qemu-user, and Rust's standard library for ARM: that of
# `rustup target add aarch64-unknown-linux-gnu`, or of the compiler in RUSTC. Emulated programs are some 30 times slower.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
target=aarch64-unknown-linux-gnu
libraries=/usr/aarch64-linux-gnu
features=networks,ros2,mcp
packages=("$@")
[ $# -gt 0 ] || packages=(splatseg-geometry splatseg-kernels splatseg-memory splatseg-segmenter)
built=$(realpath "${CARGO_TARGET_DIR:-target}")
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L $libraries"
cargo test --release --locked --target "$target" --lib --tests "${packages[@]/#/--package=}"
cargo build --release --locked --target "$target" --package splatseg-cli --features "$features"
cargo build --release --locked --package splatseg-cli --features "$features"
arm=$built/$target/release/splatseg
own=$built/release/splatseg

qemu-aarch64 -L "$libraries" "$arm" --quiet demo --out "$out/arm"
"$own" --quiet demo --out "$out/own"
diff --recursive --brief "$out/arm/segments" "$out/own/segments"
cmp "$out/arm/memory.ply" "$out/own/memory.ply"
echo "the ids and the map of the demo are the same bytes on ARM and here"

gcc -shared -fPIC -o "$out/count.so" tools/arm/count_instructions.c
count() {
    printf '%s, %s: ' "$1" "$2"
    RAYON_NUM_THREADS=1 "${@:3}" --quiet run "$out/arm/scene" --online --max-frames 6 --out "$out/$1-$2" 2>&1 |
        grep --only-matching 'instructions.*'
}
for set in neon portable; do
    count ARM $set qemu-aarch64 -L "$libraries" -plugin "$out/count.so" -E SPLATSEG_INSTRUCTIONS=$set "$arm"
done
for set in avx2 portable; do
    count x86-64 $set qemu-x86_64 -cpu max -plugin "$out/count.so" -E SPLATSEG_INSTRUCTIONS=$set "$own"
done
