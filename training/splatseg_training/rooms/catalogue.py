"""The small objects of a room by name, and the surfaces that each may stand on."""

from . import furniture, things

MAKERS = {
    "smallball": lambda paint: things.ball(paint, paint.uniform(0.035, 0.07)),
    "plantlet": lambda paint: things.plant(paint, paint.uniform(0.2, 0.38)),
    "bigplant": lambda paint: things.plant(paint, paint.uniform(0.7, 1.4), paint.uniform(0.12, 0.18)),
    "tlamp": lambda paint: things.lamp(paint, False),
    "flamp": lambda paint: things.lamp(paint, True),
    "laptop": lambda paint: things.screen(paint, paint.uniform(0.32, 0.38), "laptop"),
    "monitor": lambda paint: things.screen(paint, paint.uniform(0.46, 0.6), "monitor"),
    "tv": lambda paint: things.screen(paint, paint.uniform(0.7, 0.95), "tv"),
    "flatbook": lambda paint: things.book(paint, True),
    "photo": lambda paint: things.picture(paint, paint.uniform(0.14, 0.2), paint.uniform(0.16, 0.24), True),
    "picture": lambda paint: things.picture(paint, paint.uniform(0.3, 0.8), paint.uniform(0.3, 0.7)),
    "basket": lambda paint: things.bin(paint, paint.uniform(0.07, 0.1)),
    "bigbox": lambda paint: things.box(paint, paint.uniform(0.3, 0.45)),
    "stool": furniture.stool,
    "keyboard": things.keyboard,
    "speaker": things.speaker,
    "book": things.book,
    "mug": things.mug,
    "bottle": things.bottle,
    "bowl": things.bowl,
    "plate": things.plate,
    "vase": things.vase,
    "can": things.can,
    "fruit": things.fruit,
    "ball": things.ball,
    "block": things.block,
    "box": things.box,
    "bin": things.bin,
    "suitcase": things.suitcase,
    "backpack": things.backpack,
    "teddy": things.teddy,
    "shoe": things.shoe,
    "cushion": things.cushion,
    "pillow": things.pillow,
}

# Objects by kind of surface; a name listed twice is twice as frequent.
STANDS_ON = {
    "table": "mug mug plate plate bowl bottle bottle vase fruit fruit plantlet flatbook can laptop",
    "desk": "mug flatbook flatbook can tlamp photo plantlet bottle box",
    "shelf": "box box vase plantlet smallball photo basket flatbook speaker teddy bowl bottle can",
    "soft": "cushion cushion cushion teddy flatbook",
    "cabinet": "plantlet vase photo photo speaker tlamp box flatbook bowl bottle teddy",
    "bed": "teddy flatbook laptop box backpack",
    "floor": "bigbox bigbox ball bin suitcase backpack stool bigplant shoe teddy block block flamp bigbox basket",
}
STANDS_ON = {surface: names.split() for surface, names in STANDS_ON.items()}

MOST_MODELS = {"book": 9, "flatbook": 4, "picture": 5, "box": 4, "bigbox": 3, "fruit": 3}  # others: 2 in a room
FACING = ("photo", "speaker", "monitor", "laptop", "book", "cushion", "tlamp", "teddy")  # with the front to the front
