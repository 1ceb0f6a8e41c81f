#!/usr/bin/env bash
# Builds the command for release, and packs it: tools/release/binary.sh OUT
#
# Writes OUT/splatseg-VERSION-TARGET.tar.gz (.zip on Windows) with the command, the licences, the README and the
# changelog. TARGET is that of the machine, or the variable's. Vector instructions (AVX2, AVX-512, NEON) are chosen
# when the program runs, so there is one file for every x86-64 processor.
# shellcheck source=tools/release/tools.sh
. "$(dirname "${BASH_SOURCE[0]}")/tools.sh"
mkdir -p "$1"
out=$(cd "$1" && pwd)
cd "$root"

arguments=(--locked --profile dist --package splatseg-cli --features "$features")
case $target in
*linux*)
    install_tools cargo-zigbuild==0.24.1 ziglang==0.17.1
    cargo zigbuild "${arguments[@]}" --target "$target.$glibc"
    ;;
*) cargo build "${arguments[@]}" --target "$target" ;;
esac

name=splatseg-$version-$target
packed=$(mktemp -d)
trap 'rm -rf "$packed"' EXIT
mkdir "$packed/$name"
suffix=
case $target in *windows*) suffix=.exe ;; esac
cp "$built/$target/dist/splatseg$suffix" README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT "$packed/$name/"
if [ -n "$suffix" ]; then
    "$tools/python" -m zipfile --create "$out/$name.zip" "$packed/$name"
else
    strip "$packed/$name/splatseg"
    tar --create --gzip --file "$out/$name.tar.gz" --directory "$packed" "$name"
fi
ls -l "$out"
