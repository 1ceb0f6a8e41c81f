"""The commands that produce the tables.

They run in the folder with the data: rooms/dev-a, rooms/dev-b, kitchen-dev, redkitchen, redkitchen_dense; the weights
of the small FastSAM are in ../models. The command printed under a table is the one that ran, except for the path of the
program and the folder for results, which is printed as OUT.
"""

import shlex
from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A command line of splatseg, without `--out`."""

    line: str
    # True if its times are shown, so that it needs an otherwise idle machine.
    is_timed: bool = False

    def text(self):
        return f"splatseg {self.line} --out OUT"

    def words(self, program, out):
        return [str(program), *shlex.split(self.line), "--out", str(out / "out")]


SCENES = "--scenes rooms/dev-a rooms/dev-b kitchen-dev --resize 320x240 --crop-border 5 --exclude-void --jobs 2"
ROOMS = "--scenes rooms/dev-a rooms/dev-b --crop-border 5 --jobs 2"
# Tables of settings are of online scores alone.
ONLINE = "--set online=true"
PAPER = "--method-preset paper"
FEATURES = "--set memory.kind=features"
SEGMENTERS = {
    "net": "--segmenter fastsam --weights ../models/fastsam-rooms-n.pt --set fastsam.image_size=320"
    " --set fastsam.confidence=0.25 --set fastsam.iou=0.7",
    "affinity": "--segmenter affinity",
    "graph": "--segmenter graph",
    "oracle": "--segmenter oracle --set oracle.preset=fastsam-like",
}
PROMPTS = {"detections": SEGMENTERS["oracle"], "truth": "--prompts ground-truth"}
SIM_TRACKER = f"bench {ROOMS} --tracker sim"
CATEGORIES = ("not_tracked", "incorrect_track", "duplicated_track")

# Segmenters, and borders that are cropped, as scores depend on the border.
CROPPED = ("affinity", "net", "oracle")
CROPS = (2, 5, 7, 12)

# Settings of the evidence memory and related settings. The first row is the default.
RULES = {
    "memory.max_votes": "4,8",
    "memory.no_segment_weight": "0.3",
    "memory.contradicted_weight": "1",
    "memory.depth_tolerance": "1000",
    "memory.growth_spacing": "1",
    "memory.removal_frames": "0",
    "min_area": "0",
    "min_visible_fraction": "0",
    "min_match_f_score": "0",
    "min_new_fraction": "0",
    "regions_decide": "false",
    "memory.compare_colors": "false",
    "show_tentative": "false",
}
# Departures of our defaults for the paper's memory from the paper, with the paper's values. The first row is ours.
DEPARTURES = {
    "match_whole_masks": "false,true",
    "min_area": "0",
    "memory.fade_matched": "false",
    "memory.fade_undecoded": "true",
    "memory.active_tolerance": "-1",
    "memory.direction_learning_rate": "0.5",
    "memory.learning_min_weight": "0",
    "memory.learn_new": "true",
}
# The same for settings that only SAM2-Splat has.
SAM2_DEPARTURES = {
    "reprompt.remove_tracks": "true,false",
    "reprompt.count_negative_clicks": "true",
    "memory.direction_learning_rate": "0.5",
}
# The paper's ablations, with the paper's learning rate.
ABLATIONS = {
    "memory.feature_dim": "1,4,7,14,28",
    "memory.num_steps": "0,1,5,20,50",
}


def varied(settings):
    return " ".join(f"--ablate {name}={values}" for name, values in settings.items())


def only(category):
    """Settings that disable the other categories of re-prompts."""
    return " ".join(f"--set reprompt.{name}=false" for name in CATEGORIES if name != category)


COMMANDS = {}
for _name, _segmenter in SEGMENTERS.items():
    COMMANDS[f"methods-{_name}"] = Command(f"bench {SCENES} --methods fastsam,fastspam,fastsam-splat {_segmenter}")
    COMMANDS[f"features-{_name}"] = Command(f"bench {SCENES} --methods fastsam-splat {FEATURES} {_segmenter}")
    if _name != "graph":
        COMMANDS[f"paper-{_name}"] = Command(f"bench {SCENES} --methods fastsam-splat {PAPER} {_segmenter}")
    if _name in ("net", "oracle"):
        COMMANDS[f"departures-{_name}"] = Command(
            f"bench {SCENES} --methods fastsam-splat {FEATURES} {_segmenter} {varied(DEPARTURES)}"
        )
for _name in CROPPED:
    for _crop in CROPS:
        COMMANDS[f"rules-{_name}-{_crop}"] = Command(
            f"bench {SCENES.replace('--crop-border 5', f'--crop-border {_crop}')} --methods fastsam-splat"
            f" {ONLINE} {SEGMENTERS[_name]} {varied(RULES)}"
        )
for _name, _prompts in PROMPTS.items():
    COMMANDS[f"sam2-{_name}"] = Command(f"{SIM_TRACKER} --methods sam2,sam2-splat --seeds 2 {_prompts}")
    COMMANDS[f"sam2-{_name}-features"] = Command(f"{SIM_TRACKER} --methods sam2-splat {FEATURES} --seeds 2 {_prompts}")
    COMMANDS[f"clicks-{_name}"] = Command(
        f"{SIM_TRACKER} --methods sam2-splat --seeds 2 {_prompts} --ablate reprompt.clicks=1,3,5"
    )
for _category in ("none", *CATEGORIES):
    COMMANDS[f"reprompts-{_category}"] = Command(
        f"{SIM_TRACKER} --methods sam2-splat --seeds 2 {SEGMENTERS['oracle']} {only(_category)}"
    )
COMMANDS["sam2-departures"] = Command(
    f"{SIM_TRACKER} --methods sam2-splat --seeds 2 {FEATURES} {SEGMENTERS['oracle']} {varied(SAM2_DEPARTURES)}"
)
COMMANDS["ablations"] = Command(
    f"bench {SCENES} --methods fastsam-splat {FEATURES} --set memory.direction_learning_rate=0.5 {SEGMENTERS['oracle']}"
    f" {varied(ABLATIONS)}"
)
COMMANDS["single-kitchen"], COMMANDS["single-tabletop"], COMMANDS["single-rooms"] = (
    Command(
        f"bench --scenes {scenes} --resize 320x240 --crop-border 5 --exclude-void --jobs 2 --methods fastsam"
        " --segmenter affinity --ablate segmenter=graph"
    )
    for scenes in ("kitchen-dev", "mosd-learn", "rooms/dev-a rooms/dev-b")
)
REDKITCHEN = "run redkitchen --resize 320x240 --crop-border 5"
# While stages are measured individually, the next frame's segmenter must not share the processor.
ALONE = "--set segment_ahead=false"
COMMANDS["map"] = Command(f"{REDKITCHEN} {ALONE}", is_timed=True)
COMMANDS["map-features"] = Command(f"{REDKITCHEN} {FEATURES} {ALONE}", is_timed=True)
COMMANDS["map-paper"] = Command(f"{REDKITCHEN} {PAPER} {ALONE}", is_timed=True)
COMMANDS["map-fastsam"] = Command(f"{REDKITCHEN} --method fastsam {ALONE}", is_timed=True)
COMMANDS["whole"] = Command(REDKITCHEN, is_timed=True)
COMMANDS["dense"] = Command("run redkitchen_dense --resize 320x240 --crop-border 5")
COMMANDS["dense-tenth"] = Command("run redkitchen_dense --stride 10 --resize 320x240 --crop-border 5")
COMMANDS["static"] = Command("run synthetic:frames=300,seed=0,camera=static,noise=kinect")
COMMANDS["long"] = Command(
    "run synthetic:frames=5000,seed=0,width=160,height=120,noise=kinect --threads 1", is_timed=True
)
for _size in ("320x240", "640x480"):
    for _threads in (1, 2):
        COMMANDS[f"robot-{_size}-{_threads}"] = Command(
            f"run kitchen-dev --resize {_size} --threads {_threads}", is_timed=True
        )
FRAME_SIZES = ("320x240", "640x480", "1280x960", "1920x1080")
for _size in FRAME_SIZES:
    _width, _height = _size.split("x")
    COMMANDS[f"frames-{_size}"] = Command(f"run synthetic:frames=5,noise=kinect,width={_width},height={_height}")
