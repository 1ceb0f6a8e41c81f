#!/usr/bin/env bash
# Writes SHA256SUMS for all files of a folder: tools/release/checksums.sh FOLDER
#
# `sha256sum --check SHA256SUMS` checks them.
set -euo pipefail
cd "$1"
rm -f SHA256SUMS
sums=$(sha256sum -- *)
echo "$sums" >SHA256SUMS
sha256sum --check SHA256SUMS
