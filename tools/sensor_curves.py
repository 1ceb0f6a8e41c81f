"""Scores of scenes as worse and worse depth cameras would see them: one curve for each kind of error.

    python tools/sensor_curves.py ../shared --variants affinity.noisy_depth=1e6 affinity.noisy_depth=0 -

Copies scenes of `../shared/data` with the errors of `../shared/tools/sensors/perturb.py` at several strengths, and scores
each with `splatseg bench` (online, 320x240, border 5), once for each variant of the settings. Prints VSQ / STQ, and k = 1 in brackets, as a Markdown table.
Copies stay in `--folder` and are used again. Needs what `perturb.py` needs: numpy, scipy, opencv-python-headless.
"""

import argparse
import subprocess
import sys
from pathlib import Path

CURVES = ("noise", "correlation", "fatten", "holes", "quantised")


def copies(perturb):
    """(curve, label, name) of each copy; adds those to `perturb` that it does not have."""
    for centimetres in (0.5, 1, 2, 3, 4, 6, 8):
        name = f"corr{centimetres:g}cm_L4"
        perturb.D[name] = perturb.corr(centimetres / 400, 4)
        yield "noise", f"{centimetres:g} cm over 4 px", name
    for length in (0.01, 1, 2, 8, 16):
        name = f"corr2cm_L{length:g}"
        perturb.D[name] = perturb.corr(0.005, length)
        yield "correlation", f"2 cm over {length:.0f} px", name
    for length in (1, 2, 10, 16):
        name = f"corr4cm_L{length:g}"
        perturb.D[name] = perturb.corr(0.01, length)
        yield "correlation", f"4 cm over {length} px", name
    for pixels in (1, 2, 3, 4):
        perturb.D[f"fatten{pixels}px"] = perturb.fatten(pixels)
        yield "fatten", f"fattened {pixels} px", f"fatten{pixels}px"
    for percent in (30, 60, 80):
        perturb.D[f"holes{percent}_L5"] = perturb.holes(percent / 100, 5)
        yield "holes", f"{percent} % holes", f"holes{percent}_L5"
    for steps in (16, 8, 4):
        perturb.D[f"disp_{steps}"] = perturb.dquant(0.05 * 385, steps)
        yield "quantised", f"disparity in 1/{steps} px", f"disp_{steps}"


def score(arguments, scene, variant, out):
    """VSQ / STQ (k = 1) of a scene."""
    command = [arguments.program, "bench", "--scenes", scene, "--resize", "320x240", "--crop-border", "5"]
    command += ["--exclude-void", "--methods", "fastsam-splat", "--set", "online=true", "--out", out, "--overwrite"]
    command += [] if variant == "-" else [word for value in variant.split(",") for word in ("--set", value)]
    done = subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True)
    row = next((line.split() for line in done.stdout.splitlines() if line.startswith("fastsam-splat ")), None)
    if row is None or "-" in row:
        sys.exit(f"{' '.join(map(str, command))}: {done.stderr.strip() or done.stdout.strip()}")
    return f"{row[5]} / {row[6]} ({row[1]})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, help="folder with `data` and `tools/sensors`")
    parser.add_argument("--program", default="splatseg")
    parser.add_argument("--scenes", nargs="+", default=["kitchen-dev", "rooms/dev-a"])
    parser.add_argument("--variants", nargs="+", default=["-"], help="settings KEY=VALUE,..., or - for none")
    parser.add_argument("--curves", nargs="+", choices=CURVES, default=CURVES)
    parser.add_argument("--folder", type=Path, default=Path("/tmp/sensor-curves"), help="for copies and results")
    arguments = parser.parse_args()
    sys.path.insert(0, str(arguments.shared / "tools/sensors"))
    import perturb

    arguments.folder.mkdir(parents=True, exist_ok=True)
    cases = [(None, "as it is", None), *(copy for copy in copies(perturb) if copy[0] in arguments.curves)]
    columns = [(scene, variant) for scene in arguments.scenes for variant in arguments.variants]
    print("|  | " + " | ".join(f"{scene}, {variant}" for scene, variant in columns) + " |")
    print("| --- |" + " ---: |" * len(columns))
    for _, label, name in cases:
        row = []
        for scene, variant in columns:
            source = arguments.shared / "data" / scene
            copy = arguments.folder / f"{Path(scene).name}-{name}"
            if name is None:
                copy = source
            elif not copy.exists():
                perturb.main(source, copy, name)
            row.append(score(arguments, copy, variant, arguments.folder / "results"))
        print(f"| {label} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
