#!/usr/bin/env bash
# Builds the documentation's site into target/site: tools/docs/build.sh
#
# mdBook is installed into target/ci/mdbook, once. Then every link of the site is followed to a file.
set -euo pipefail
cd "$(dirname "$0")/../.."
version=0.5.4
tool=$PWD/target/ci/mdbook
if [ "$(cat "$tool/version" 2>/dev/null)" != "$version" ]; then
    CARGO_TARGET_DIR=$tool/build cargo install --quiet --debug --locked --no-default-features --features search \
        --root "$tool" "mdbook@$version"
    rm -rf "$tool/build"
    echo "$version" >"$tool/version"
fi
rm -rf target/site
"$tool/bin/mdbook" build docs
# Its own configuration is no page.
rm -f target/site/book.toml
python3 tools/docs/check_site.py target/site
