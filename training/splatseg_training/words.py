"""Trains a tiny network for images and words on drawings: a stand-in for CLIP in tests, which knows a few shapes and
colours.

    python -m splatseg_training.words --out ../crates/splatseg/tests/data/tiny_clip.safetensors --minutes 3

It has the layout of OpenCLIP, which `crates/models/src/clip` reads, but only the rows of the token embedding that its
prompts use: `token_rows` has their numbers. Tests fill the others with zeros. Needs `open_clip_torch` for the tokens.
"""

import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy
import torch
from open_clip.tokenizer import SimpleTokenizer
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional

HEAD, CONTEXT = 16, 12
SHAPES = ["ball", "box", "cone"]
COLORS = {
    "red": (190, 30, 35),
    "yellow": (235, 210, 50),
    "green": (50, 140, 60),
    "blue": (40, 75, 180),
    "white": (235, 235, 235),
    "black": (30, 30, 30),
}
ANYTHING = ["object", "thing", "surface", "background", "part of something", "room"]


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Sizes of a network. Images have sides of `side` pixels."""

    side: int
    patch: int
    width: int
    blocks: int
    text_width: int
    embedding: int


DRAWINGS = Sizes(side=32, patch=8, width=48, blocks=2, text_width=32, embedding=32)


def prompt(word):
    return f"a photo of a {word}"


class Block(nn.Module):
    """A block with the names of OpenCLIP."""

    def __init__(self, width):
        super().__init__()
        self.ln_1, self.ln_2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attn = nn.MultiheadAttention(width, width // HEAD, batch_first=True)
        self.mlp = nn.ModuleDict({"c_fc": nn.Linear(width, 2 * width), "c_proj": nn.Linear(2 * width, width)})

    def forward(self, tokens, mask=None):
        normal = self.ln_1(tokens)
        tokens = tokens + self.attn(normal, normal, normal, need_weights=False, attn_mask=mask)[0]
        return tokens + self.mlp["c_proj"](functional.gelu(self.mlp["c_fc"](self.ln_2(tokens))))


def blocks(width, count):
    return nn.ModuleDict({"resblocks": nn.ModuleList(Block(width) for _ in range(count))})


class Visual(nn.Module):
    def __init__(self, sizes):
        super().__init__()
        width, count = sizes.width, (sizes.side // sizes.patch) ** 2 + 1
        self.conv1 = nn.Conv2d(3, width, sizes.patch, sizes.patch, bias=False)
        self.class_embedding = nn.Parameter(0.1 * torch.randn(width))
        self.positional_embedding = nn.Parameter(0.1 * torch.randn(count, width))
        self.ln_pre, self.ln_post = nn.LayerNorm(width), nn.LayerNorm(width)
        self.transformer = blocks(width, sizes.blocks)
        self.proj = nn.Parameter(width**-0.5 * torch.randn(width, sizes.embedding))

    def tokens(self, images, share=1.0):
        """The token of the class, then those of a share of the patches."""
        tokens = self.conv1(images).flatten(2).transpose(1, 2) + self.positional_embedding[1:]
        if share < 1:
            tokens = tokens[:, torch.randperm(tokens.shape[1])[: round(share * tokens.shape[1])]]
        first = self.class_embedding + self.positional_embedding[0]
        tokens = self.ln_pre(torch.cat([first.expand(len(tokens), 1, -1), tokens], 1))
        for block in self.transformer["resblocks"]:
            tokens = block(tokens)
        return tokens

    def embedded(self, token):
        return functional.normalize(self.ln_post(token) @ self.proj, dim=-1)

    def forward(self, images):
        return self.embedded(self.tokens(images)[:, 0])


class TinyClip(nn.Module):
    """Towers for images and for texts of the tokens in `rows`."""

    def __init__(self, rows, sizes):
        super().__init__()
        self.sizes = sizes
        self.visual = Visual(sizes)
        self.token_embedding = nn.Embedding(rows, sizes.text_width)
        self.positional_embedding = nn.Parameter(0.1 * torch.randn(CONTEXT, sizes.text_width))
        self.transformer = blocks(sizes.text_width, 1)
        self.ln_final = nn.LayerNorm(sizes.text_width)
        self.text_projection = nn.Parameter(sizes.text_width**-0.5 * torch.randn(sizes.text_width, sizes.embedding))
        self.logit_scale = nn.Parameter(torch.tensor(3.0))

    def encode_text(self, rows, ends):
        tokens = self.token_embedding(rows) + self.positional_embedding
        mask = torch.full((CONTEXT, CONTEXT), float("-inf")).triu(1)
        for block in self.transformer["resblocks"]:
            tokens = block(tokens, mask)
        last = self.ln_final(tokens[torch.arange(len(tokens)), ends])
        return functional.normalize(last @ self.text_projection, dim=-1)


def tokenise(texts):
    """The numbers of the tokens that texts use, sorted; each text's tokens as places in them; and where texts end."""
    tokenizer = SimpleTokenizer(context_length=CONTEXT)
    tokens = tokenizer(texts).numpy()
    used = sorted(set(tokens.flatten().tolist()))
    rows = torch.from_numpy(numpy.searchsorted(used, tokens))
    return used, rows, torch.from_numpy((tokens == tokenizer.eot_token_id).argmax(1))


def drawing(shape, color, random):
    """A thing before a background: RGB [side, side, 3] from 0 to 255. Without a shape, the background alone."""
    side = DRAWINGS.side
    y, x = numpy.mgrid[0:side, 0:side] / side
    backdrop = random.uniform(60, 200) + random.uniform(-25, 25, 3)
    image = backdrop + random.uniform(-40, 40) * x[..., None] + random.uniform(-40, 40) * y[..., None]
    if random.random() < 0.5:
        # An edge of something else.
        direction = random.uniform(0, 2 * numpy.pi)
        beyond = numpy.cos(direction) * (x - 0.5) + numpy.sin(direction) * (y - 0.5) > random.uniform(0.1, 0.5)
        image = numpy.where(beyond[..., None], random.uniform(20, 235, 3), image)
    if shape is not None:
        (cx, cy), size = random.uniform(0.42, 0.58, 2), random.uniform(0.26, 0.42)
        ratio = random.uniform(0.85, 1.2)
        u, v = (x - cx) / size, (y - cy) / (size * ratio)
        inside = {
            "ball": u**2 + v**2 < 1,
            "box": (abs(u) < 0.95) & (abs(v) < 0.95),
            "cone": (abs(v) < 1) & (abs(u) < (v + 1) / 2),
        }[shape]
        shade = 1 + random.uniform(-0.25, 0.25) * u + random.uniform(-0.25, 0.25) * v
        paint = numpy.clip(numpy.array(COLORS[color]) + random.uniform(-18, 18, 3), 0, 255) * random.uniform(0.75, 1.15)
        image = numpy.where(inside[..., None], paint * shade[..., None], image)
        if random.random() < 0.5:
            # The surroundings dimmed, as `crops.rs` does.
            mean = image.reshape(-1, 3).mean(0)
            image = numpy.where(inside[..., None], image, mean + 0.2 * (image - mean))
    return numpy.clip(image + random.normal(0, 4, image.shape), 0, 255)


def drawings(count, random):
    """Drawings [count, 3, side, side] from 0 to 1, and the number of shape and colour of each, -1 for none."""
    images, shapes, colors = [], [], []
    for _ in range(count):
        shape, color = random.integers(len(SHAPES)), random.integers(len(COLORS))
        if random.random() < 0.1:
            shape = color = -1
        shapes.append(shape)
        colors.append(color)
        images.append(drawing(SHAPES[shape] if shape >= 0 else None, list(COLORS)[color], random))
    images = torch.from_numpy(numpy.stack(images)).float().permute(0, 3, 1, 2) / 255
    return images, torch.tensor(shapes), torch.tensor(colors)


def export(model, used, path):
    """Writes a network whose rows of the token embedding are those of the tokens `used`."""
    sizes = model.sizes
    state = {name: tensor.detach().half().contiguous() for name, tensor in model.state_dict().items()}
    state["token_embedding.rows"] = state.pop("token_embedding.weight")
    state["token_rows"] = torch.tensor(used, dtype=torch.int32)
    vision = {
        "image_size": sizes.side,
        "head_width": HEAD,
        "width": sizes.width,
        "layers": sizes.blocks,
        "patch_size": sizes.patch,
    }
    text = {
        "context_length": CONTEXT,
        "width": sizes.text_width,
        "heads": sizes.text_width // HEAD,
        "layers": 1,
    }
    configuration = {
        "vision_cfg": vision,
        "text_cfg": text,
        "preprocess_cfg": {"mean": [0.5] * 3, "std": [0.5] * 3},
    }
    metadata = json.dumps({"architecture": "CLIP of OpenCLIP", "configuration": configuration})
    save_file(state, path, {"splatseg": metadata})


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=3)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    random = numpy.random.default_rng(arguments.seed)
    pairs = [f"{color} {shape}" for shape in SHAPES for color in COLORS]
    texts = [prompt(word) for word in pairs + SHAPES + list(COLORS) + ANYTHING]
    used, rows, ends = tokenise(texts)
    groups = numpy.cumsum([len(pairs), len(SHAPES), len(COLORS), len(ANYTHING)])
    model = TinyClip(len(used), DRAWINGS)
    print(f"{sum(parameter.numel() for parameter in model.parameters())} parameters")
    optimiser = torch.optim.AdamW(model.parameters(), 2e-3, weight_decay=0.02)
    started, step = time.time(), 0
    while (share := (time.time() - started) / (60 * arguments.minutes)) < 1:
        for group in optimiser.param_groups:
            group["lr"] = 2e-3 * min(1, (step + 1) / 100) * (1 - share)
        images, shape, color = drawings(128, random)
        found = model.visual(2 * images - 1)
        pair_text, shape_text, color_text, any_text = model.encode_text(rows, ends).tensor_split(groups[:-1].tolist())
        scale = model.logit_scale.exp().clamp(max=100)
        has = shape >= 0
        # A thing fits its words better than others and those for anything; nothing in particular fits the latter.
        loss = 0
        for text, right in [
            (pair_text, shape * len(COLORS) + color),
            (shape_text, shape),
            (color_text, color),
        ]:
            fit = scale * found @ torch.cat([text, any_text]).T
            anything = len(text) + torch.randint(len(ANYTHING), shape.shape)
            loss = loss + functional.cross_entropy(fit, torch.where(has, right, anything), label_smoothing=0.02)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if step % 100 == 0:
            right = (found[has] @ pair_text.T).argmax(1) == (shape * len(COLORS) + color)[has]
            print(f"{share:.2f} step {step}: {loss.item():.3f}, {right.float().mean().item():.2f} right", flush=True)
        step += 1
    export(model, used, arguments.out)


if __name__ == "__main__":
    main()
