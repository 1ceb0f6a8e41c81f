"""Guesses a mesh's kind, its usual size and its place in a home from its file name."""

import re
from typing import NamedTuple


class Kind(NamedTuple):
    """A kind of piece; its size along an axis is between two bounds in metres."""

    name: str
    axis: str  # "height", "width" (the larger horizontal side) or "largest"
    low: float
    high: float
    back: str = (
        "sides"  # "top": side of the backrest, "sides": the flat side, "rough": the other one, "none": unknown
    )


# The first pattern found in the words of a file name decides; None means that the mesh is not used.
RULES = [
    (r"collision|\bdoors?\b|windows?|\bwall\b|ceiling|\broom\b|floor b|column|curtain|chandelier|handle", None),
    (
        r"range ?hood|air ?conditioner a|sphere|security|quilt|board|cooking bench|utensils|light (c|cube|icosahedron|small)",
        None,
    ),
    (r"rug|carpet", Kind("rug", "width", 1.2, 2.4, "none")),
    (r"desk portrait|frame standing", Kind("photo", "height", 0.14, 0.25, "top")),
    (r"portrait|picture|painting|mirror|towel", Kind("picture", "height", 0.3, 0.8)),
    (r"shelf (a|b|small)\b", Kind("wall shelf", "width", 0.6, 1.0)),
    (r"light floor 1|light stand|lamp standing|floor lamp", Kind("floor lamp", "height", 1.3, 1.7, "none")),
    (r"\blight\b|lamp", Kind("lamp", "height", 0.3, 0.48, "none")),
    (r"night ?stand|bedside", Kind("nightstand", "height", 0.42, 0.65)),
    (r"arm ?chair|sofa (b|individual)|(couch|sofa) small", Kind("armchair", "width", 0.75, 1.05, "top")),
    (r"stool", Kind("stool", "width", 0.3, 0.45, "none")),
    (r"chair", Kind("chair", "height", 0.8, 1.0, "top")),
    (r"sofa|couch", Kind("sofa", "width", 1.6, 2.2, "top")),
    (r"\bbed\b", Kind("bed", "width", 1.9, 2.1, "top")),
    (r"pillow|cushion", Kind("pillow", "width", 0.4, 0.6, "none")),
    (r"washing|dryer|dish ?washer", Kind("fixture", "height", 0.8, 0.9)),
    (r"toilet paper", Kind("tableware", "height", 0.1, 0.25, "none")),
    (r"toilet", Kind("fixture", "width", 0.6, 0.72, "top")),
    (r"bath ?tub", Kind("fixture", "width", 1.5, 1.7)),
    (r"shower", Kind("fixture", "height", 1.9, 2.1)),
    (r"fire ?place|shoe ?rack|air ?conditioner", Kind("fixture", "height", 0.9, 1.2)),
    (r"fridge|refrigerator", Kind("fridge", "height", 1.5, 1.85)),
    (r"kitchen.*(drawer|cabinet|oven|sink)|oven|stove|sink|counter", Kind("fixture", "height", 0.82, 0.95)),
    (r"tv (cabinet|stand|bench)", Kind("cabinet", "height", 0.4, 0.6)),
    (r"\btv\b|television", Kind("tv", "width", 0.7, 1.1, "rough")),
    (r"coffee|table low|balcony table", Kind("low table", "height", 0.36, 0.48, "none")),
    (r"desk", Kind("desk", "height", 0.7, 0.76)),
    (r"table ?ware|tea set|mug|cup|bowl", Kind("tableware", "width", 0.12, 0.4, "none")),
    (r"tablet", Kind("book", "largest", 0.2, 0.28, "none")),
    (r"table", Kind("table", "height", 0.7, 0.8, "none")),
    (r"wardrobe|closet", Kind("wardrobe", "height", 1.7, 2.1)),
    (r"book ?(shelf|case)|shel(f|ves)", Kind("shelf", "height", 1.2, 2.05)),
    (r"cabinet|drawers?|dresser|chest|sideboard", Kind("cabinet", "height", 0.6, 1.0)),
    (r"plant|cactus|flower|tree", Kind("plant", "height", 0.2, 1.2, "none")),
    (r"trash|bin|waste", Kind("bin", "height", 0.28, 0.6, "none")),
    (r"vase", Kind("vase", "height", 0.18, 0.36, "none")),
    (r"plate|dish", Kind("plate", "width", 0.18, 0.27, "none")),
    (r"fork|knife|spoon", Kind("cutlery", "largest", 0.16, 0.22, "none")),
    (r"books?\b", Kind("book", "largest", 0.18, 0.27, "none")),
    (r"ball", Kind("ball", "largest", 0.15, 0.4, "none")),
]
OTHER = Kind("other", "largest", 0.2, 1.0, "none")

# Kinds that may replace a thing requested by the room, and the required height (None: the kind's own).
STANDS_FOR = {
    "table": (("table",), None),
    "low table": (("low table",), None),
    "desk": (("desk",), None),
    "chair": (("chair",), None),
    "shelf": (("shelf",), None),
    "wall shelf": (("wall shelf",), None),
    "cabinet": (("cabinet", "cabinet", "fixture"), None),
    "nightstand": (("nightstand",), None),
    "wardrobe": (("wardrobe",), None),
    "fridge": (("fridge",), None),
    "sofa": (("sofa",), None),
    "armchair": (("armchair",), None),
    "bed": (("bed",), None),
    "rug": (("rug",), None),
    "fixture": (("fixture",), None),
    "picture": (("picture",), None),
    "photo": (("photo",), None),
    "tv": (("tv",), None),
    "stool": (("stool", "chair"), None),
    "bin": (("bin",), None),
    "basket": (("bin",), (0.14, 0.26)),
    "plantlet": (("plant",), (0.18, 0.4)),
    "bigplant": (("plant",), (0.6, 1.3)),
    "tlamp": (("lamp",), None),
    "flamp": (("floor lamp",), None),
    "cushion": (("pillow",), None),
    "pillow": (("pillow",), None),
    "mug": (("tableware", "cutlery"), None),
    "plate": (("plate", "cutlery"), None),
    "vase": (("vase", "plant"), (0.15, 0.36)),
    "flatbook": (("book",), None),
    "ball": (("ball", "other"), None),
    "box": (("other", "bin"), (0.1, 0.25)),
    "bigbox": (("other", "chair", "armchair", "nightstand", "low table", "fixture", "bin"), None),
    "suitcase": (("other", "cabinet", "chair"), None),
}


def guess(name):
    """The kind for a file name without extension; None if such a mesh is not used."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=[0-9])(?=[A-Za-z])|[^A-Za-z0-9]+", " ", name)
    words = words.lower()
    for pattern, kind in RULES:
        if re.search(pattern, words):
            return kind
    return OTHER
