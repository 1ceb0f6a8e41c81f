#!/usr/bin/env bash
# Fuzzes every reader: fuzz/run.sh [SECONDS FOR EACH TARGET, or INPUTSx] [TARGET…]
#
#   fuzz/run.sh 60                                                  every target, a minute each
#   fuzz/run.sh 10000000x bag mkv phones depth_files db3            ten million inputs each
#
# Prints, for each target, how many inputs were tried and whether one of them failed: by a panic, by taking more than
# 5 seconds (FUZZ_TIMEOUT) or more than 256 MB. Failing inputs are in fuzz/artifacts/TARGET, new ones worth keeping in
# target/fuzz-corpus.
#
# Needs cargo-fuzz, a nightly compiler and g++: cargo install cargo-fuzz && rustup toolchain install nightly
# The address sanitizer is off: the workspace has no unsafe code, and ten times as many inputs are tried without it.
set -uo pipefail
cd "$(dirname "$0")/.."
amount=${1:-60}
shift || true
targets=${*:-$(sed -n 's/^path = "fuzz_targets\/\(.*\)\.rs"/\1/p' fuzz/Cargo.toml)}
case $amount in
*x) limit=-runs=${amount%x} ;;
*) limit=-max_total_time=$amount ;;
esac
# Readers of recordings need neither maps nor networks, which take most of the time to build.
features=(--no-default-features)
for target in $targets; do
    if grep -A1 "^name = \"$target\"" fuzz/Cargo.toml | grep -q maps; then features=(); fi
done

for target in $targets; do
    cargo +nightly fuzz build --sanitizer none "${features[@]}" "$target" || exit 1
done
total=0
failed=0
printf '%-12s %12s %8s  %s\n' target inputs 'per s' result
for target in $targets; do
    found=target/fuzz-corpus/$target
    corpora=("$found")
    [ -d "fuzz/corpus/$target" ] && corpora+=("fuzz/corpus/$target")
    mkdir -p "$found"
    log=target/fuzz-corpus/$target.log
    # Of the longest bag, a part is enough: it is read as far as it goes.
    case $target in bag) longest=16384 ;; *) longest=65536 ;; esac
    started=$(date +%s)
    if cargo +nightly fuzz run --sanitizer none "${features[@]}" "$target" "${corpora[@]}" -- \
        "$limit" -timeout="${FUZZ_TIMEOUT:-5}" -max_len=$longest -print_final_stats=1 >"$log" 2>&1; then
        result=good
    else
        result="FAILED: $(grep -m1 -E "panicked at|SUMMARY|memory allocation|ERROR" "$log" || tail -1 "$log")"
        failed=1
    fi
    seconds=$(($(date +%s) - started))
    inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log" | tail -1)
    total=$((total + ${inputs:-0}))
    printf '%-12s %12s %8s  %s\n' "$target" "${inputs:-?}" "$((${inputs:-0} / (seconds > 0 ? seconds : 1)))" "$result"
done
printf '%-12s %12s\n' total "$total"
exit $failed
