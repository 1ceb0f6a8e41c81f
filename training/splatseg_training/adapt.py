"""Adapts the affinity network to unlabelled recordings, using the memory of `splatseg` to label them.

    python -m splatseg_training.adapt --recordings MY1 MY2 --replay 'data/shapes/*' data/clutter --out adapted

Every recording is segmented twice, the second time with the finished memory. Objects on which both passes agree in many
frames become labels (`consensus.py`), and the network is trained a little further: half of the samples come from the
recordings, half from the labelled folders of `--replay`, to prevent forgetting. OUT gets `affinity.safetensors` for
`splatseg run --weights`, `weights.pt` and the loss curve in `training/`, and the passes and labels of each recording in
`recordings/`. The same command resumes an interrupted run.

Options after `--` go to `splatseg run`: `... --out adapted -- --resize 320x240 --stride 5`. Needs the Python package of
splatseg to read recordings of all formats: `pip install ./python` in a clone.
"""

import argparse
import glob
import json
import os
import shutil
import subprocess
import sys

import cv2
import numpy as np

from .consensus import Consensus, Rules
from .export import export
from .network import load
from .run import DATA_HELP

SHIPPED = os.path.normpath(os.path.join(__file__, "../../../crates/segmenter/src/affinity/weights.safetensors"))
SHIPPED_THRESHOLD = -2.25
ASPECT = 4 / 3  # width by height of the training samples


def main(arguments=None):
    """Runs the command line; reports a failure in one line."""
    arguments = sys.argv[1:] if arguments is None else arguments
    split = arguments.index("--") if "--" in arguments else len(arguments)
    options = parse(arguments[:split])
    options.run_options = arguments[split + 1 :]
    try:
        adapt(options)
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        sys.exit(f"error: {error}")


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--recordings", nargs="+", required=True, metavar="RECORDING", help="inputs of `splatseg run`")
    add("--replay", nargs="+", required=True, metavar="PATTERN", help=DATA_HELP)
    add("--out", required=True, metavar="OUT", help="a new folder, or the folder of the same, interrupted command")
    add("--start", default=SHIPPED, metavar="WEIGHTS", help="weights.pt or .safetensors; by default those built in")
    add("--splatseg", default="splatseg", metavar="PROGRAM")
    add("--steps", type=int, default=300)
    add("--rate", type=float, default=5e-5, help="highest learning rate")
    add("--seed", type=int, default=0)
    add("--threshold", type=float, default=SHIPPED_THRESHOLD, help="threshold for `splatseg run`, see export")
    for name, default in Rules._field_defaults.items():
        add("--" + name.replace("_", "-"), type=type(default), default=default, help="see consensus.Rules")
    add("--threads", type=int, default=2, help="threads of the network")
    add("--workers", type=int, default=1, help="processes that prepare samples")
    return parser.parse_args(arguments)


def adapt(options):
    """Runs all parts; finished parts are skipped."""
    result = os.path.join(options.out, "affinity.safetensors")
    if shutil.which(options.splatseg) is None:
        raise ValueError(f"there is no program {options.splatseg}; name it with --splatseg")
    package()
    claim(options)
    if os.path.exists(result):
        print(f"{result} already exists")
        return
    start = starting_weights(options)
    folders = [labelled(recording, start, options, i + 1) for i, recording in enumerate(options.recordings)]
    weights = fine_tune(folders, options)
    export(weights, result, options.threshold)
    print(f"adapted weights: {result}; use them with splatseg run RECORDING --out OUT --weights {result}")


def package():
    """Imports the Python package of splatseg."""
    try:
        import splatseg
    except ImportError:
        raise ValueError("recordings are read by the Python package splatseg: pip install ./python") from None
    return splatseg


def claim(options):
    """Makes the folder of results, or checks that it belongs to the same command: parts made with other options would
    be wrong."""
    how = {"splatseg", "threads", "workers"}
    mine = {name: value for name, value in vars(options).items() if name not in how}
    path = os.path.join(options.out, "options.json")
    if os.path.exists(path):
        with open(path) as file:
            theirs = json.load(file)
        differ = [name for name in mine if theirs.get(name) != mine[name]]
        if differ:
            raise ValueError(f"{options.out} was made with other values of {', '.join(differ)}: choose another --out")
        return
    os.makedirs(options.out, exist_ok=True)
    if os.listdir(options.out):
        raise ValueError(f"{options.out} contains other files: choose another --out")
    with open(path, "w") as file:
        json.dump(mine, file, indent=2)


def starting_weights(options):
    """The file of the starting weights for `splatseg run`."""
    if not os.path.exists(options.start):
        raise ValueError(f"{options.start}: no such file; --start takes a weights.pt or a .safetensors")
    if options.start.endswith(".safetensors"):
        return options.start
    path = os.path.join(options.out, "start.safetensors")
    export(options.start, path, options.threshold)
    return path


def labelled(recording, weights, options, number):
    """The labelled folder of a recording; missing passes are run."""
    name = os.path.basename(os.path.normpath(recording))
    home = os.path.join(options.out, "recordings", f"{number}-{name}")
    done = os.path.join(home, "labelled")
    if os.path.exists(done):
        return done
    one, two = os.path.join(home, "one"), os.path.join(home, "two")
    segment(recording, weights, one, None, options)
    segment(recording, weights, two, os.path.join(one, "map.ply"), options)
    rules = Rules(**{name: getattr(options, name) for name in Rules._fields})
    write_labels(recording, Consensus(one, two, rules), done)
    return done


def segment(recording, weights, out, memory, options):
    """Runs one pass, with the memory of an earlier pass or, without a memory, saving `map.ply` for a later pass.

    The folder is renamed to `out` when it is complete.
    """
    if os.path.exists(out):
        return
    part = out + ".part"
    os.makedirs(os.path.dirname(out), exist_ok=True)
    command = [options.splatseg, "run", recording, "--out", part, "--overwrite", "--no-page", "--weights", weights]
    command += ["--load-memory", memory] if memory else ["--save-memory", os.path.join(part, "map.ply")]
    command += options.run_options
    print(" ".join(command), flush=True)
    subprocess.run(command, check=True)
    os.rename(part, out)


def write_labels(recording, consensus, out):
    """Writes the frames with enough labels in ScanNet's exported layout, at the size and crop of the passes."""
    with open(os.path.join(consensus.two, "summary.json")) as file:
        settings = json.load(file)["settings"]["dataset"]
    part, known = out + ".part", set(consensus.names)
    for folder in ("color", "depth", "instance-filt", "intrinsic"):
        os.makedirs(os.path.join(part, folder), exist_ok=True)
    total, written, shares, camera = 0, 0, 0.0, None
    for frame in package().open_scene(recording, **settings):
        total += 1
        name = next((name for name in (frame.name, frame.name.zfill(6)) if name in known), None)
        labels = None if name is None else consensus.labels(name)
        if labels is None:
            continue
        camera = write_view(part, written, frame, labels)
        written, shares = written + 1, shares + np.count_nonzero(labels) / labels.size
    if not written:
        raise ValueError(f"{recording}: the passes do not agree on enough pixels in any of {total} frames")
    np.savetxt(os.path.join(part, "intrinsic", "intrinsic_depth.txt"), camera)
    os.rename(part, out)
    objects = np.count_nonzero(consensus.kept)
    print(f"{recording}: {written} of {total} frames, {100 * shares / written:.0f} % of pixels, {objects} objects")


def write_view(folder, number, frame, labels):
    """Writes a view, centre-cropped to the network's aspect ratio, and returns its camera matrix."""
    window, camera = middle(labels.shape, frame.K)
    depth = np.rint(frame.depth[window] * 1000).clip(0, 65535).astype(np.uint16)
    cv2.imwrite(os.path.join(folder, "color", f"{number}.png"), frame.rgb[window][:, :, ::-1])
    cv2.imwrite(os.path.join(folder, "depth", f"{number}.png"), depth)
    cv2.imwrite(os.path.join(folder, "instance-filt", f"{number}.png"), labels[window])
    return camera


def middle(shape, camera):
    """The rows and columns of the largest centred window of ASPECT in an image, and its camera matrix."""
    height, width = shape
    rows, columns = min(height, round(width / ASPECT)), min(width, round(height * ASPECT))
    y, x = (height - rows) // 2, (width - columns) // 2
    camera = np.array(camera, float)
    camera[:2, 2] -= x, y
    return (slice(y, y + rows), slice(x, x + columns)), camera


def fine_tune(folders, options):
    """Trains, or resumes training; returns the file of the weights.

    Runs in a separate process: the trainer forks workers, and the threads that read the recordings do not survive a
    fork.
    """
    run = os.path.join(options.out, "training")
    values = {"steps": options.steps, "rate": options.rate, "seed": options.seed, "start": options.start}
    values |= {"threads": options.threads, "workers": options.workers, "out": run}
    arguments = [text for name, value in values.items() for text in ("--" + name, str(value))]
    widths = [convolution.weight.shape[0] for convolution in stages(load(options.start))]
    arguments += ["--freeze-norms", "--widths", *map(str, widths), "--turn", "0"]
    arguments += ["--data", *options.replay, "--measured", *map(glob.escape, folders)]
    paths = [os.path.dirname(os.path.dirname(__file__)), os.environ.get("PYTHONPATH")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    subprocess.run([sys.executable, "-m", "splatseg_training.train", *arguments], check=True, env=environment)
    return os.path.join(run, "weights.pt")


def stages(net):
    """The first convolution of each of the five resolutions."""
    return [net.stem[0], *(stage[0][0] for stage in (net.e1, net.e2, net.e3, net.e4))]


if __name__ == "__main__":
    main()
