#!/usr/bin/env bash
# Unpacks a packed command and uses it as a new user would: tools/release/check_binary.sh FILE.tar.gz|FILE.zip
set -euo pipefail
archive=$(realpath "$1")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
export HOME=$folder
case $archive in
*.zip) "$(command -v python || command -v python3)" -m zipfile --extract "$archive" . ;;
*) tar --extract --file "$archive" ;;
esac
program=$(echo "$PWD"/splatseg-*/splatseg*)
"$program" --version
# What of the system it needs, and how old that may be.
if [ "$(uname)" = Linux ]; then
    ldd "$program"
    newest=$(grep -ao 'GLIBC_2\.[0-9]*' "$program" | sort -t. -k2 -n -u | tail -1)
    echo "needs glibc ${newest#GLIBC_}"
    [ "${newest#GLIBC_2.}" -le 28 ]
fi
"$program" demo --out demo
test -s demo/index.html
# Without vector instructions beyond the baseline, on any processor.
SPLATSEG_INSTRUCTIONS=portable "$program" run synthetic:frames=2,width=96,height=72 --out portable
echo "1 passed, 0 failed"
