#!/usr/bin/env bash
# Builds the Python wheel for release: tools/release/wheel.sh OUT
#
# One wheel for every Python from 3.10 on (abi3), and on Linux for every distribution with glibc 2.17 or later.
# shellcheck source=tools/release/tools.sh
. "$(dirname "${BASH_SOURCE[0]}")/tools.sh"
mkdir -p "$1"
out=$(cd "$1" && pwd)
cd "$root"

install_tools maturin==1.16.0 ziglang==0.17.1
arguments=(--locked --profile dist --manifest-path python/Cargo.toml --target "$target" --out "$out")
arguments+=(--no-default-features --features "$features")
case $target in
*linux*) "$tools/maturin" build "${arguments[@]}" --zig --compatibility "manylinux_${glibc/./_}" ;;
*) "$tools/maturin" build "${arguments[@]}" ;;
esac
ls -l "$out"
