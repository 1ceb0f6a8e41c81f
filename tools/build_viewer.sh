#!/usr/bin/env bash
# Builds crates/output/viewer/viewer.min.js, the script of a run's index.html, from its sources and three.js.
#
# Needs Node.js and npm. Versions and checksums of packages are fixed by package-lock.json, so the result is
# reproducible byte for byte. `tools/build_viewer.sh --check` builds to a temporary file and compares it with the
# committed one.
set -euo pipefail
cd "$(dirname "$0")/../crates/output/viewer"

built=viewer.min.js
if [ "${1:-}" = --check ]; then
    built=$(mktemp)
    trap 'rm -f "$built"' EXIT
fi
# Packages may not run install scripts; esbuild works without them.
npm ci --ignore-scripts --no-audit --no-fund --silent
# Lets a test detect without npm whether the script is older than its sources.
sources=$(LC_ALL=C; cat src/*.js package-lock.json | sha256sum | cut -d' ' -f1)
# three.js's licence must accompany its code.
licence="/*!
splatseg's viewer (MIT OR Apache-2.0). Built by tools/build_viewer.sh from crates/output/viewer/src and three.js.
sha256 of src/*.js and package-lock.json: $sources

$(cat node_modules/three/LICENSE)
*/"
node_modules/.bin/esbuild src/main.js --bundle --minify --format=iife --target=es2022 --charset=utf8 \
    --legal-comments=none --banner:js="$licence" --log-level=warning --outfile="$built" --allow-overwrite
if [ "${1:-}" = --check ]; then
    cmp "$built" viewer.min.js && echo "viewer.min.js matches its sources"
else
    wc -c "$built"
fi
