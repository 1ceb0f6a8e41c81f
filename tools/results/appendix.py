"""The appendix, docs/RESULTS_TABLES.md: which tables it shows, in which order, under which headings."""

INTRODUCTION = """# Tables of results

`python tools/results --data ../shared/data` writes this page. Each table states the commit of the program, the date, the
machine and the commands, which run in the folder with the data. [RESULTS.md](RESULTS.md) has the summary, and
[ABLATIONS.md](dev/ABLATIONS.md) the changes of single settings.

`dev-a` and `dev-b` are rendered rooms of 80 frames. `kitchen-dev` is the first half, 50 frames, of a real Kinect video with
labels, `redkitchen` is all of it, and `redkitchen_dense` has its first 300 frames at 30 Hz. `net` is a small FastSAM trained
on other rendered rooms. The oracle returns the ground truth with errors ([ORACLE.md](dev/ORACLE.md)). Scores are percentages.
Unlabelled ground is left out. Scores over several scenes sum tubes, tracks and pixels before dividing. Protocol `paper` is
the authors' evaluation code, `strict` the metrics as VPQ and STEP define them.
"""

# Heading, one line about it, tables.
SECTIONS = [
    ("Scores by method, protocol `paper`", "", ["methods-paper"]),
    ("Scores by method, protocol `strict`", "", ["methods-strict"]),
    (
        "By size of the object",
        "Over the three scenes: AQ; ids per object, 1 is best; percentage of the frames that show the object's main id.",
        ["sizes"],
    ),
    (
        "The default method by crop",
        "The cropped border moves scores, by up to six points with `affinity`. These are the base of the table of rules in ABLATIONS.md.",
        ["crops"],
    ),
    (
        "Single frames",
        "The segmenters without a memory, every frame. AP and AR@100 are COCO's, for masks of one class. Over and under:"
        + " pixels outside the largest part of their object and of their segment, percent.",
        ["single-frames"],
    ),
    (
        "SAM2 and SAM2-Splat with a simulated tracker",
        "The tracker follows the truth and errs at set rates ([SIM_TRACKER.md](dev/SIM_TRACKER.md)). It answers clicks perfectly,"
        + " so gains are an upper bound. Mean and deviation over seeds.",
        ["sam2"],
    ),
    ("Categories of re-prompts", "With detections, protocol `paper`.", ["reprompts"]),
    ("Clicks", "Protocol `paper`.", ["clicks"]),
    (
        "Speed and size of the map",
        "`redkitchen`. Stages are measured without `segment_ahead`, so that they do not share the processor.",
        ["map", "stages"],
    ),
    ("A whole run", "`redkitchen` with everything that `run` writes.", ["whole"]),
    ("On a robot's processor", "`kitchen-dev`, by size and number of threads.", ["robot"]),
    ("Memory by size of frames", "", ["frame-sizes"]),
    ("Growth of the map", "", ["growth"]),
    ("A long run in a small room", "The camera sways at its own pace, so no round repeats the one before.", ["long"]),
]
