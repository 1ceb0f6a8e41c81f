"""The tables of the documents: their commands and how they are rendered."""

from collections.abc import Callable
from dataclasses import dataclass

from bench_output import mean, scores, single_frames, sizes, summary
from commands import (
    ABLATIONS,
    CATEGORIES,
    COMMANDS,
    CROPPED,
    CROPS,
    DEPARTURES,
    FRAME_SIZES,
    PROMPTS,
    RULES,
    SAM2_DEPARTURES,
    SEGMENTERS,
)

SCENE_NAMES = ("dev-a", "dev-b", "kitchen-dev")
COLUMNS = ("k=1", "k=5", "k=10", "k=15", "VSQ", "STQ", "AQ", "SQ")
NET_NAMES = {"net": "net", "affinity": "`affinity`", "graph": "`graph`", "oracle": "oracle"}


@dataclass(frozen=True)
class Table:
    """A table: `render` takes the folder of each command."""

    commands: list[str]
    render: Callable
    # Tables that share the commands of an earlier one refer to it instead of repeating them.
    shows_commands: bool = True
    source: str = ""


def markdown(head, rows):
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def number(value, digits=1):
    return "–" if value is None else f"{value:,.{digits}f}"


def full_row(label, cells):
    return [label, *(cells[column] for column in COLUMNS)]


# The command and row of each memory's scores.
MEMORIES = (
    ("fastsam", "methods", "fastsam"),
    ("fastspam", "methods", "fastspam"),
    ("paper's method", "paper", "fastsam-splat"),
    ("`memory.kind=features`", "features", "fastsam-splat"),
    ("**fastsam-splat**", "methods", "fastsam-splat"),
)


def memories_of(segmenter, folders):
    """The rows of MEMORIES measured with a segmenter."""
    return [row for row in MEMORIES if f"{row[1]}-{segmenter}" in folders]


def memory_table(folders):
    rows = []
    for segmenter in SEGMENTERS:
        for label, command, method in memories_of(segmenter, folders):
            folder = folders[f"{command}-{segmenter}"]
            cells = [scores(folder, scene)[method] for scene in SCENE_NAMES] + [scores(folder, None, "strict")[method]]
            texts = [
                f"{number(mean(cell['VSQ']))} / {number(mean(cell['STQ']))} ({number(mean(cell['k=1']))})"
                for cell in cells
            ]
            rows.append([f"{NET_NAMES[segmenter]}: {label}", *texts])
    return markdown(["VSQ / STQ (k = 1)", *SCENE_NAMES, "all three, `strict`"], rows)


def methods_table(protocol):
    def render(folders):
        rows = []
        for segmenter in SEGMENTERS:
            for label, command, method in memories_of(segmenter, folders):
                cells = scores(folders[f"{command}-{segmenter}"], None, protocol)[method]
                rows.append(full_row(f"{NET_NAMES[segmenter]}: {label}", cells))
        return markdown([f"protocol `{protocol}`", *COLUMNS], rows)

    return render


def size_table(folders):
    classes = ("small (under 400 px)", "medium (400 to 4000 px)", "large (over 4000 px)")
    rows = []
    for segmenter in SEGMENTERS:
        table = sizes(folders[f"methods-{segmenter}"])
        for method in ("fastsam", "fastsam-splat"):
            cells = [table[method, wanted] for wanted in classes]
            texts = [
                f"{number(mean(cell['AQ']))}; {number(mean(cell['ids per object']))}; {number(mean(cell['main id']), 0)}"
                for cell in cells
            ]
            rows.append([f"{NET_NAMES[segmenter]}: {method}", *texts])
    return markdown(["AQ; ids per object; main id", *classes], rows)


SINGLE_FRAME_SETS = {"single-kitchen": "kitchen-dev", "single-tabletop": "mosd-learn", "single-rooms": "dev-a, dev-b"}


def single_frames_table(folders):
    rows, columns = [], []
    for command, name in SINGLE_FRAME_SETS.items():
        table = single_frames(folders[command])
        for segmenter, row in (("affinity", "fastsam"), ("graph", "fastsam segmenter=graph")):
            columns = list(table[row])
            rows.append([f"{name}: `{segmenter}`", *(number(mean(cell)) for cell in table[row].values())])
    return markdown(["single frames", *columns], rows)


def rows_of_crops(folders, segmenter, label):
    """VSQ and STQ of a row of the commands of the rules: for each scene, one pair for each crop."""
    found = []
    for scene in SCENE_NAMES:
        cells = [scores(folders[f"rules-{segmenter}-{crop}"], scene)[label] for crop in CROPS]
        found.append([(mean(cell["VSQ"]), mean(cell["STQ"])) for cell in cells])
    return found


def average(pairs):
    pairs = list(pairs)
    return [sum(values) / len(pairs) for values in zip(*pairs)]


def both(pair, text="{:.1f}"):
    return " / ".join(text.format(value) for value in pair)


def pair_of(cells):
    return mean(cells["VSQ"]), mean(cells["STQ"])


FIRST_RULE = "fastsam-splat " + next(f"{setting}={values.split(',')[0]}" for setting, values in RULES.items())


def crops_table(folders):
    """VSQ / STQ of the default method by crop, and their mean, on each scene and over the scenes."""
    rows = []
    for segmenter in CROPPED:
        scenes = rows_of_crops(folders, segmenter, FIRST_RULE)
        for place, crop in enumerate(CROPS):
            pairs = [scene[place] for scene in scenes]
            rows.append([f"{NET_NAMES[segmenter]}, {crop} px", *map(both, pairs), both(average(pairs), "{:.2f}")])
        means = [average(scene) for scene in scenes]
        rows.append([f"**{NET_NAMES[segmenter]}, mean**", *map(both, means), both(average(means), "{:.2f}")])
    return markdown(["VSQ / STQ", *SCENE_NAMES, "mean of the scenes"], rows)


def rules_table(folders):
    """Every changed setting against the first row: the mean of crops and scenes, with each segmenter."""
    labels = [f"{setting}={value}" for setting, values in RULES.items() for value in values.split(",")]

    def total(segmenter, label):
        return average(pair for scene in rows_of_crops(folders, segmenter, label) for pair in scene)

    base = {segmenter: total(segmenter, FIRST_RULE) for segmenter in CROPPED}
    rows = []
    for label in labels[1:]:
        changes = []
        for segmenter in CROPPED:
            found = total(segmenter, f"fastsam-splat {label}")
            changes.append(both([value - old for value, old in zip(found, base[segmenter])], "{:+.1f}"))
        rows.append([f"`{label}`", *changes])
    return markdown(["change of VSQ / STQ", *(NET_NAMES[segmenter] for segmenter in CROPPED)], rows)


def summary_table(folders):
    """Ours, the paper's method and the baseline: scores, speed and memory."""
    lines = (
        ("**splatseg**", "methods-affinity", "fastsam-splat", "map"),
        ("the paper's method", "paper-affinity", "fastsam-splat", "map-paper"),
        ("no memory (FastSAM)", "methods-affinity", "fastsam", "map-fastsam"),
    )
    rows = []
    for label, command, method, run in lines:
        kitchen, *rooms = [scores(folders[command], scene)[method] for scene in ("kitchen-dev", "dev-a", "dev-b")]
        speed = summary(folders[run])
        numbers = speed["parameters"]
        rows.append([
            label, both(pair_of(kitchen)), both(average(map(pair_of, rooms))), number(speed["fps"]["without_segmenter"]),
            f"{speed['peak_memory_mb']:.0f} MB", f"{numbers / 1e6:.2f} M" if numbers else "–",
        ])  # fmt: skip
    head = [
        "",
        "real kitchen: VSQ / STQ",
        "rooms: VSQ / STQ",
        "frames per second",
        "peak memory",
        "numbers in the memory",
    ]
    return markdown(head, rows)


def whole_table(folders):
    run = summary(folders["whole"])
    return markdown(
        ["", "frames per second", "peak memory"],
        [["`redkitchen`, everything included", number(run["fps"]["total"]), f"{run['peak_memory_mb']:.0f} MB"]],
    )


def change(cells, base, column):
    return f"{mean(cells[column]) - mean(base[column]):+.1f}"


def changes_table(command, settings, method="fastsam-splat"):
    """A table of every changed setting against the first row, over all scenes."""

    def render(folders):
        table = scores(folders[command], None)
        labels = [f"{setting}={value}" for setting, values in settings.items() for value in values.split(",")]
        base = table[f"{method} {labels[0]}"]
        columns = ("VSQ", "STQ", "k=1")
        rows = [
            [f"`{label}`", *(change(table[f"{method} {label}"], base, column) for column in columns)]
            for label in labels[1:]
        ]
        return markdown(["change of", *columns], rows)

    return render


def departures_table(folders):
    """The change from reverting each departure, on every scene."""
    labels = [f"{setting}={value}" for setting, values in DEPARTURES.items() for value in values.split(",")]
    rows = []
    for label in labels[1:]:
        row = [f"`{label}`"]
        for segmenter in ("net", "oracle"):
            for scene in SCENE_NAMES:
                table = scores(folders[f"departures-{segmenter}"], scene)
                base, cells = table[f"fastsam-splat {labels[0]}"], table[f"fastsam-splat {label}"]
                row.append(" / ".join(change(cells, base, column) for column in ("VSQ", "STQ")))
        rows.append(row)
    names = [f"{segmenter}: {scene}" for segmenter in ("net", "oracle") for scene in SCENE_NAMES]
    return markdown(["change of VSQ / STQ", *names], rows)


def sam2_table(folders):
    rows = []
    for protocol in ("paper", "strict"):
        for prompts, name in (("detections", "detections"), ("truth", "ground truth")):
            measured = scores(folders[f"sam2-{prompts}"], None, protocol)
            features = scores(folders[f"sam2-{prompts}-features"], None, protocol)["sam2-splat"]
            lines = (
                ("sam2", measured["sam2"]),
                ("sam2-splat", measured["sam2-splat"]),
                ("sam2-splat, `features`", features),
            )
            rows += [full_row(f"{name}, `{protocol}`: {label}", cells) for label, cells in lines]
    return markdown(["", *COLUMNS], rows)


def reprompts_table(folders):
    names = dict(zip(CATEGORIES, ("(a) not tracked alone", "(b) incorrect track alone", "(c) duplicated track alone")))
    rows = [full_row("none", scores(folders["reprompts-none"], None)["sam2-splat"])]
    rows += [full_row(names[name], scores(folders[f"reprompts-{name}"], None)["sam2-splat"]) for name in CATEGORIES]
    rows.append(full_row("all", scores(folders["sam2-detections"], None)["sam2-splat"]))
    return markdown(["", *COLUMNS], rows)


def clicks_table(folders):
    rows = []
    for prompts, name in (("detections", "detections"), ("truth", "ground truth")):
        table = scores(folders[f"clicks-{prompts}"], None)
        rows += [full_row(f"{name}, {clicks}", table[f"sam2-splat reprompt.clicks={clicks}"]) for clicks in (1, 3, 5)]
    return markdown(["clicks", *COLUMNS], rows)


def ablations_table(folders):
    table = scores(folders["ablations"], None)
    rows = []
    for setting, values in ABLATIONS.items():
        rows += [
            full_row(f"`{setting}={value}`", table[f"fastsam-splat {setting}={value}"]) for value in values.split(",")
        ]
    return markdown(["", *COLUMNS], rows)


def map_table(folders):
    columns = [summary(folders[name]) for name in ("map-paper", "map-features", "map")]
    lines = (
        ("all but the segmenter, frames per second", lambda run: number(run["fps"]["without_segmenter"])),
        ("slowest frame, ms", lambda run: number(run["slowest_frame_ms"], 0)),
        ("Gaussians", lambda run: f"{run['gaussians']:,}"),
        ("numbers in the memory, millions", lambda run: number(run["parameters"] / 1e6, 2)),
        ("peak memory, MB", lambda run: number(run["peak_memory_mb"], 0)),
        ("ids", lambda run: str(run["segments"])),
    )
    rows = [[label, *(value(run) for run in columns)] for label, value in lines]
    return markdown(["", "the paper's method", "`features`", "**default**"], rows)


def stages_table(folders):
    run = summary(folders["map"])
    rows = [[stage, number(ms)] for stage, ms in run["stage_ms"].items() if ms > 0.05]
    return markdown(["stage", "ms per frame"], rows)


def growth_table(folders):
    names = (
        ("dense", "`redkitchen_dense`, 300 frames"),
        ("dense-tenth", "every tenth of them"),
        ("static", "static camera, 300 frames"),
    )
    rows = []
    for command, label in names:
        run = summary(folders[command])
        rows.append([label, f"{run['curve'][0]['gaussians']:,}", f"{run['gaussians']:,}", str(run["segments"])])
    return markdown(["", "Gaussians at the first point of the curve", "at the end", "ids"], rows)


def long_table(folders):
    curve = summary(folders["long"])["curve"]
    picked = [curve[index * (len(curve) - 1) // 7] for index in range(8)]
    rows = [
        ["Gaussians", *(f"{point['gaussians']:,}" for point in picked)],
        ["MB in memory", *(number(point["memory_mb"]) for point in picked)],
        ["ms a frame, all but the segmenter", *(number(point["ms"]) for point in picked)],
    ]
    return markdown(["frame", *(str(point["frame"]) for point in picked)], rows)


def robot_table(folders):
    rows = []
    for size in ("320x240", "640x480"):
        for threads in (1, 2):
            run = summary(folders[f"robot-{size}-{threads}"])
            segmenter = run["stage_ms"]["segment"]
            rest = 1000 / run["fps"]["without_segmenter"]
            rows.append([
                size, str(threads), number(run["fps"]["total"]), f"{segmenter:.0f} + {rest:.0f} ms",
                f"{run['slowest_frame_ms']:.0f} ms", f"{run['peak_memory_mb']:.0f} MB",
            ])  # fmt: skip
    head = ["size", "threads", "frames per second", "a frame: segmenter + rest, mean", "rest, slowest", "peak memory"]
    return markdown(head, rows)


def frame_sizes_table(folders):
    runs = [summary(folders[f"frames-{size}"]) for size in FRAME_SIZES]
    return markdown(
        ["frames", *FRAME_SIZES], [["peak memory, MB", *(number(run["peak_memory_mb"], 0) for run in runs)]]
    )


RULE_RUNS = [f"rules-{name}-{crop}" for name in CROPPED for crop in CROPS]
_SCORES = [name for name in COMMANDS if name.split("-")[0] in ("methods", "features", "paper")]
TABLES = {
    "memory": Table(
        _SCORES, memory_table, False, "the commands of `methods-paper` in [RESULTS_TABLES.md](RESULTS_TABLES.md)"
    ),
    "methods-paper": Table(_SCORES, methods_table("paper")),
    "methods-strict": Table(_SCORES, methods_table("strict"), False, "the commands of the first table"),
    "sizes": Table([f"methods-{name}" for name in SEGMENTERS], size_table, False, "the commands of the first table"),
    "single-frames": Table(list(SINGLE_FRAME_SETS), single_frames_table),
    "summary": Table(
        ["methods-affinity", "paper-affinity", "map", "map-paper", "map-fastsam"],
        summary_table,
        False,
        "the commands of [RESULTS_TABLES.md](RESULTS_TABLES.md)",
    ),
    "crops": Table(RULE_RUNS, crops_table),
    "rules": Table(RULE_RUNS, rules_table, False, "the commands of `crops` in [RESULTS_TABLES.md](../RESULTS_TABLES.md)"),
    "whole": Table(["whole"], whole_table),
    "departures": Table([f"departures-{name}" for name in ("net", "oracle")], departures_table),
    "sam2-departures": Table(["sam2-departures"], changes_table("sam2-departures", SAM2_DEPARTURES, "sam2-splat")),
    "sam2": Table([f"sam2-{prompts}{kind}" for prompts in PROMPTS for kind in ("", "-features")], sam2_table),
    "reprompts": Table([f"reprompts-{name}" for name in ("none", *CATEGORIES)] + ["sam2-detections"], reprompts_table),
    "clicks": Table([f"clicks-{prompts}" for prompts in PROMPTS], clicks_table),
    "ablations": Table(["ablations"], ablations_table),
    "map": Table(["map-paper", "map-features", "map"], map_table),
    "stages": Table(["map"], stages_table),
    "growth": Table(["dense", "dense-tenth", "static"], growth_table),
    "long": Table(["long"], long_table),
    "frame-sizes": Table([f"frames-{size}" for size in FRAME_SIZES], frame_sizes_table),
    "robot": Table([f"robot-{size}-{threads}" for size in ("320x240", "640x480") for threads in (1, 2)], robot_table),
}
