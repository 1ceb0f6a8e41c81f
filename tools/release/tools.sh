# shellcheck shell=bash disable=SC2034
# Read by the other scripts here: the version of the program, the target, and the tools that build releases.
#
# `zig` links against an old glibc (2.17, of 2012), so that one file runs on every Linux of the last ten years, whatever
# the machine that built it has. No container is needed for that.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' "$root/Cargo.toml")
target=${TARGET:-$(rustc -vV | sed -n 's/^host: //p')}
glibc=2.17
# `FEATURES=` builds without networks, ROS 2 and the server for assistants, in less time.
features=${FEATURES-networks ros2 mcp}
built=${CARGO_TARGET_DIR:-$root/target}
python=$(command -v python || command -v python3)
venv=$built/release-tools
[ -d "$venv" ] || "$python" -m venv "$venv"
# Windows has no `bin`.
tools=$venv/bin
[ -d "$tools" ] || tools=$venv/Scripts
PATH=$tools:$PATH

install_tools() {
    "$tools/python" -m pip install --quiet --disable-pip-version-check "$@"
}
