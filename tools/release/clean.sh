#!/usr/bin/env bash
# Runs a command as on a new machine: tools/release/clean.sh COMMAND...
#
# The environment has an empty home and nothing else but where Rust's toolchain and cache are, certificates of the
# network, and the variables TARGET, FEATURES and CARGO_TARGET_DIR.
set -euo pipefail
home=$(mktemp -d)
trap 'rm -rf "$home"' EXIT
kept=()
for name in TARGET FEATURES CARGO_TARGET_DIR SSL_CERT_FILE PIP_CERT; do
    [ -z "${!name+set}" ] || kept+=("$name=${!name}")
done
env -i HOME="$home" TMPDIR="$home" PATH="$PATH" LANG=C.UTF-8 "${kept[@]}" \
    CARGO_HOME="${CARGO_HOME:-$HOME/.cargo}" RUSTUP_HOME="${RUSTUP_HOME:-$HOME/.rustup}" "$@"
