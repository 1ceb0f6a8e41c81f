"""Random colours and materials for a room. Colours are linear RGB; scales are repeats per metre."""

import colorsys
from typing import NamedTuple

import numpy as np

from .geometry import PI
from .shaders import Shader


class Pattern(NamedTuple):
    """Placement of a texture on a thing: repeats per metre, stretch along the axes, rotation about z (radians)."""

    scale: float = 1.0
    stretch: tuple = (1, 1, 1)
    turn: float = 0.0


PLAIN = Pattern()


class Recipe(NamedTuple):
    """What a material was made of, for `quick.py`: see `Paint.material`."""

    texture: str
    colours: tuple  # two
    scale: tuple  # repeats per metre along the axes
    turn: float
    location: tuple
    rough: float
    metal: float
    glow: float
    pixels: np.ndarray | str | None


def pooled(most):
    """Decorator: a room reuses at most `most` materials of a kind, so that its furniture matches."""

    def wrap(make):
        def get(self):
            pool = self.pools.setdefault(make.__name__, [])
            if len(pool) < most:
                pool.append(make(self))
                return pool[-1]
            return self.pick(pool)

        return get

    return wrap


class Paint:
    """A room's random numbers, colours and materials.

    `glow` lists (strength input, strength) of the emitters, which are scaled once the exposure is known. `recipes` has each
    material's Recipe by its name.
    """

    def __init__(self, rng):
        self.rng, self.glow, self.pools, self.recipes = rng, [], {}, {}

    def uniform(self, low, high):
        return float(self.rng.uniform(low, high))

    def chance(self, probability):
        return self.uniform(0, 1) < probability

    def pick(self, items):
        return items[int(self.rng.integers(len(items)))]

    def colour(self, hue=None, saturation=(0.1, 0.65), value=(0.2, 0.85)):
        hue = self.uniform(0, 1) if hue is None else hue
        srgb = colorsys.hsv_to_rgb(hue % 1, self.uniform(*saturation), self.uniform(*value))
        return tuple(channel**2.2 for channel in srgb)

    def similar(self, colour, spread=0.25):
        factor = self.uniform(1 - spread, 1 + spread)
        return tuple(min(c * factor * self.uniform(1 - spread / 3, 1 + spread / 3), 1.0) for c in colour)

    def material(self, texture, colour, second=None, pattern=PLAIN, rough=0.6, metal=0.0, glow=0.0, pixels=None):
        """A material with one of the textures of `shaders`, or "plain"; `pixels` for an "image" or "mapped"."""
        second = self.similar(colour) if second is None else second
        shader = Shader(texture)
        scale = tuple(pattern.scale * factor for factor in pattern.stretch)
        location = (0, 0, 0)
        if texture != "image":
            location = (self.uniform(0, 9), self.uniform(0, 9), self.uniform(0, 9))
        at = shader.place(texture, scale, pattern.turn, location)
        output = self._texture(shader, texture, at, colour, second, pixels)
        strength = shader.finish(colour, output, rough, metal, glow)
        if strength:
            self.glow.append((strength, glow))
        colours = (tuple(colour), tuple(second))
        recipe = Recipe(texture, colours, scale, pattern.turn, location, rough, metal, glow, pixels)
        self.recipes[shader.material.name] = recipe
        return shader.material

    def _texture(self, shader, texture, at, colour, second, pixels):
        colours = (colour, second)
        if texture == "noise":
            noise = shader.node("TexNoise", at, Scale=1, Detail=4)
            return shader.ramp(noise.outputs[0], 0.3, 0.7, colours)
        if texture in ("wood", "stripes", "plaid"):
            return shader.waves(at, colours, texture)
        if texture == "checker":
            node = shader.node("TexChecker", at, Scale=1, Color1=(*colour, 1), Color2=(*second, 1))
            return node.outputs["Color"]
        if texture == "brick":
            return shader.bricks(at, colours, (0.5, 0.48, 0.45), 2.2, 0.03, 0.5)
        if texture == "plank":
            return shader.bricks(at, colours, [channel * 0.4 for channel in colour], 7, 0.01, 0.5)
        if texture == "tile":
            return shader.bricks(at, (colour, self.similar(colour, 0.1)), second, 1, 0.03, 0)
        if texture in ("dots", "terrazzo"):
            return shader.cells(at, colours, texture)
        if texture == "image":
            return shader.picture(at, pixels)
        if texture == "mapped":
            return shader.mapped_picture(pixels)
        return None

    def imported(self, colour, image):
        """A material of an imported mesh: its colour, or its texture if it has one (see `meshes.Finish`)."""
        colour = tuple(float(channel) for channel in colour)
        return self.material("plain" if image is None else "mapped", colour, pixels=image)

    @pooled(4)
    def wood(self):
        kind = self.uniform(0, 1)
        if kind < 0.7:
            colour = self.colour(self.uniform(0.04, 0.1), (0.35, 0.7), (0.22, 0.75))
        elif kind < 0.85:
            colour = self.colour(saturation=(0, 0.12), value=(0.8, 0.92))
        else:
            colour = self.colour(value=(0.1, 0.7))
        second = self.similar(colour, 0.45) if kind < 0.7 else None
        scale, rough = self.uniform(8, 22), self.uniform(0.25, 0.6)
        pattern = Pattern(scale, self.pick([(1, 0.25, 1), (0.2, 1, 1)]))
        return self.material("wood" if kind < 0.7 else "noise", colour, second, pattern, rough)

    @pooled(6)
    def fabric(self):
        texture = self.pick(["noise", "noise", "noise", "stripes", "plaid", "checker", "dots"])
        colour = self.colour(saturation=(0.05, 0.65), value=(0.2, 0.85))
        second = None
        if texture != "noise":
            second = self.pick([self.similar(colour, 0.7), self.colour(saturation=(0, 0.5), value=(0.5, 0.95))])
        scales = {"noise": (30, 60), "stripes": (3, 9), "plaid": (4, 9), "checker": (8, 20), "dots": (9, 18)}
        pattern = Pattern(self.uniform(*scales[texture]), turn=self.uniform(0, 1.6))
        return self.material(texture, colour, second, pattern, 0.95)

    @pooled(7)
    def gloss(self):
        colour = self.colour(saturation=(0.3, 0.95), value=(0.25, 0.95))
        return self.material("plain", colour, rough=self.uniform(0.1, 0.4))

    @pooled(6)
    def paint(self):
        colour = self.colour(saturation=(0.05, 0.6), value=(0.3, 0.92))
        pattern = Pattern(self.uniform(2, 8))
        return self.material("noise", colour, None, pattern, self.uniform(0.4, 0.7))

    @pooled(2)
    def metal(self):
        colour = self.pick([(0.55, 0.55, 0.56), (0.06, 0.06, 0.065), (0.6, 0.42, 0.18), (0.75, 0.75, 0.75)])
        return self.material("plain", colour, rough=self.uniform(0.2, 0.45), metal=self.pick([1.0, 1.0, 0.0]))

    @pooled(5)
    def ceramic(self):
        texture = self.pick(["plain", "plain", "stripes", "noise"])
        colour, second = self.colour(saturation=(0, 0.6), value=(0.5, 0.95)), self.colour()
        scale, rough = self.uniform(8, 25), self.uniform(0.08, 0.3)
        return self.material(texture, colour, second, Pattern(scale, turn=self.pick([0, PI / 2])), rough)

    @pooled(2)
    def card(self):
        return self.material("noise", self.colour(0.08, (0.35, 0.5), (0.5, 0.7)), None, Pattern(12), 0.9)

    @pooled(12)
    def cover(self):
        texture = self.pick(["plain", "plain", "noise", "dots"])
        colour, second = self.colour(saturation=(0.2, 0.9), value=(0.12, 0.85)), self.colour()
        pattern = Pattern(self.uniform(15, 40))
        return self.material(texture, colour, second, pattern, self.uniform(0.3, 0.7))

    @pooled(2)
    def leaf(self):
        colour = self.colour(self.uniform(0.2, 0.38), (0.5, 0.85), (0.2, 0.55))
        return self.material("noise", colour, self.colour(0.28, (0.4, 0.7), (0.25, 0.6)), Pattern(15), 0.5)

    @pooled(1)
    def white(self):
        return self.material("plain", self.colour(0.1, (0, 0.06), (0.85, 0.95)), rough=0.5)

    @pooled(1)
    def black(self):
        return self.material("plain", (0.015, 0.015, 0.017), rough=0.25)

    def wallpaper(self, accent=False):
        """A wall's material; accent walls may be of brick."""
        textures = ["noise", "noise", "noise", "noise", "stripes", "dots", "plank"] + ["brick"] * 3 * accent
        texture = self.pick(textures)
        if texture == "brick":
            colour = self.colour(self.uniform(0.01, 0.07), (0.3, 0.65), (0.4, 0.7))
        else:
            colour = self.colour(saturation=(0.02, 0.22), value=(0.75, 0.95))
        stripes, brick, dots, plank = (self.uniform(*bounds) for bounds in ((1.5, 5), (9, 13), (4, 8), (5, 8)))
        scale = {"noise": 1.5, "stripes": stripes, "brick": brick, "dots": dots, "plank": plank}[texture]
        second = self.similar(colour, {"stripes": 0.2, "dots": 0.3, "brick": 0.3}.get(texture, 0.06))
        turn = PI / 4 if texture == "stripes" and self.chance(0.2) else 0
        return self.material(texture, colour, second, Pattern(scale, turn=turn), 0.85)

    def flooring(self):
        """A floor's material: planks, tiles, carpet or terrazzo."""
        texture = self.pick(["plank", "plank", "plank", "tile", "checker", "noise", "terrazzo"])
        if texture == "plank":
            colour = self.colour(self.uniform(0.05, 0.1), (0.3, 0.65), (0.3, 0.75))
        else:
            colour = self.colour(saturation=(0.02, 0.4), value=(0.35, 0.85))
        seconds = {
            "plank": self.similar(colour, 0.3),
            "tile": self.colour(saturation=(0, 0.1), value=(0.2, 0.8)),
            "checker": self.similar(colour, 0.5),
            "noise": self.similar(colour, 0.3),
        }
        second = seconds.get(texture, self.colour(saturation=(0, 0.3)))
        scales = {"plank": (6, 9), "tile": (2, 3.5), "checker": (2, 4), "noise": (15, 50), "terrazzo": (20, 40)}
        scale = {name: self.uniform(*bounds) for name, bounds in scales.items()}[texture]
        rough = 0.9 if texture == "noise" else self.uniform(0.2, 0.6)
        return self.material(texture, colour, second, Pattern(scale, turn=self.pick([0, PI / 2])), rough)

    def art(self, screen=False, glow=0.0):
        """An image of blocks, discs and waves, or lines of text on a screen."""
        size = 96
        y, x = np.mgrid[0:size, 0:size] / size
        background = np.array(self.colour(value=(0.3, 0.95))) ** (1 / 2.2)
        pixels = np.ones((size, size, 3)) * background + (y[..., None] - 0.5) * self.rng.uniform(-0.5, 0.5, 3)
        if screen:
            pixels = np.ones((size, size, 3)) * self.pick([(0.9, 0.92, 0.95), (0.1, 0.12, 0.16), (0.2, 0.35, 0.6)])
            for row in range(8, size - 8, 6):
                start, end = int(self.uniform(6, 40)), int(self.uniform(45, 90))
                pixels[row : row + 3, start:end] = np.array(self.colour()) ** (1 / 2.2) * 0.6 + 0.2
        else:
            for _ in range(int(self.uniform(3, 9))):
                mask = self._shape(x, y)
                pixels[mask] = np.array(self.colour(saturation=(0.2, 0.95), value=(0.15, 0.95))) ** (1 / 2.2)
        return self.material("image", (1, 1, 1), rough=0.3, glow=glow, pixels=np.clip(pixels, 0, 1))

    def _shape(self, x, y):
        """A disc, a block or everything below a wave, as a mask."""
        centre_x, centre_y, radius, kind = (self.uniform(*b) for b in ((0, 1), (0, 1), (0.06, 0.35), (0, 1)))
        if kind < 0.4:
            return (x - centre_x) ** 2 + (y - centre_y) ** 2 < radius * radius
        if kind < 0.75:
            return (abs(x - centre_x) < radius) & (abs(y - centre_y) < self.uniform(0.04, 0.3))
        return y > centre_y + 0.1 * np.sin(x * self.uniform(4, 14) + centre_x * 9)
