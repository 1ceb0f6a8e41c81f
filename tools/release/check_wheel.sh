#!/usr/bin/env bash
# Installs a wheel in an environment of its own and runs the first example: tools/release/check_wheel.sh FILE.whl
set -euo pipefail
wheel=$(realpath "$1")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
export HOME=$folder
"$(command -v python || command -v python3)" -m venv environment
bin=environment/bin
[ -d "$bin" ] || bin=environment/Scripts
"$bin/python" -m pip install --quiet --disable-pip-version-check "$wheel"
"$bin/python" -m pip list --disable-pip-version-check
"$bin/python" - <<'PROGRAM'
import splatseg as ss

seg = ss.FastSamSplat()
for r in seg.run("synthetic:frames=5,width=160,height=120"):
    print(r.name, [o.id for o in r.objects])
assert len(seg.objects()) >= 3
seg.save("map.ply")
PROGRAM
"$bin/splatseg" --version
echo "1 passed, 0 failed"
