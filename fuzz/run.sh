#!/usr/bin/env bash
# Fuzzes every reader: fuzz/run.sh [SECONDS FOR EACH TARGET] [TARGET…]
#
# Prints, for each target, how many inputs were tried and whether one of them failed: by a panic, by taking more than
# 5 seconds or more than 256 MB. Failing inputs are in fuzz/artifacts/TARGET, new ones worth keeping in target/fuzz-corpus.
#
# Needs cargo-fuzz and a nightly compiler: cargo install cargo-fuzz && rustup toolchain install nightly
# The address sanitizer is off: the workspace has no unsafe code, and ten times as many inputs are tried without it.
set -uo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
shift || true
targets=${*:-$(sed -n 's/^path = "fuzz_targets\/\(.*\)\.rs"/\1/p' fuzz/Cargo.toml)}

cargo +nightly fuzz build --sanitizer none || exit 1
total=0
failed=0
printf '%-12s %12s %8s  %s\n' target inputs 'per s' result
for target in $targets; do
    found=target/fuzz-corpus/$target
    corpora=("$found")
    [ -d "fuzz/corpus/$target" ] && corpora+=("fuzz/corpus/$target")
    mkdir -p "$found"
    log=target/fuzz-corpus/$target.log
    if cargo +nightly fuzz run --sanitizer none "$target" "${corpora[@]}" -- \
        -max_total_time="$seconds" -timeout=5 -max_len=65536 -print_final_stats=1 >"$log" 2>&1; then
        result=good
    else
        result="FAILED: $(grep -m1 -E "panicked at|SUMMARY|memory allocation|ERROR" "$log" || tail -1 "$log")"
        failed=1
    fi
    inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log" | tail -1)
    total=$((total + ${inputs:-0}))
    printf '%-12s %12s %8s  %s\n' "$target" "${inputs:-?}" "$((${inputs:-0} / (seconds > 0 ? seconds : 1)))" "$result"
done
printf '%-12s %12s\n' total "$total"
exit $failed
