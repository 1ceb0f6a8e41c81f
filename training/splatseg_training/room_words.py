"""Trains a small network for images and words on the things of rendered rooms: a stand-in for CLIP in tests, which knows
the kinds of things that `splatseg_training.rooms` furnishes rooms with.

    python -m splatseg_training.room_words --data 'rooms/*' --kinds ../crates/splatseg/tests/data/room_kinds.txt \
        --out ../crates/splatseg/tests/data/room_clip.safetensors

Its layout is that of `words.py`. With `--found FOUND`, the segments of `splatseg run ROOM --out FOUND/NAME`, where NAME
is that of the room's folder, are learned from too. Rooms with the seeds of test data (below 1000) are refused. A kind may have several names in
`objects.json`, all of which are words of one line of the kinds: a standing photo is a picture, too.
"""

import argparse
import glob
import json
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy
import torch
from safetensors.torch import load_file
from torch import nn
from torch.nn import functional

from . import colour, dataset
from .words import ANYTHING, Sizes, TinyClip, export, prompt, tokenise

SIZES = Sizes(side=48, patch=8, width=96, blocks=5, text_width=32, embedding=64)
# Crops are kept a little larger, so that samples can be cut out of them at random.
KEPT = 56
MIN_PIXELS = 60
# A segment is learned from if this share of its pixels shows one thing.
MIN_SHARE = 0.5
# How often a part of a thing is learned from too, as if the rest were another segment, and its least share.
PART_PROBABILITY, MIN_PART = 0.12, 0.4
# As in `crates/objects/src/object_view.rs` and `crates/splatseg/src/names/crops.rs`.
MARGIN, MIN_MARGIN, DIMMED = 0.15, 4, 0.2


class Crops(NamedTuple):
    """Crops of things, and of places that show no thing in particular."""

    images: numpy.ndarray  # [n, KEPT, KEPT, 3] uint8 RGB
    masks: numpy.ndarray  # [n, KEPT, KEPT] bool
    kinds: torch.Tensor  # [n] numbers of kinds, -1 for none
    weights: numpy.ndarray  # [n] how often each is drawn: things alike, rare kinds more often than their share


def read_kinds(path):
    """The words of each kind, as in a file of `--vocabulary`: the kind itself is the first."""
    return [[word.strip() for word in line.split(",")] for line in path.read_text().splitlines()]


def crop(image, mask):
    """The view of a thing in the middle of a square of the view's mean colour: RGB and mask [KEPT, KEPT]."""
    rows, columns = numpy.nonzero(mask.any(1))[0], numpy.nonzero(mask.any(0))[0]
    longer = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    margin = max(round(MARGIN * longer), MIN_MARGIN)
    top, left = max(rows[0] - margin, 0), max(columns[0] - margin, 0)
    view = numpy.s_[top : rows[-1] + 1 + margin, left : columns[-1] + 1 + margin]
    image, mask = image[view], mask[view].astype(numpy.uint8)
    side = max(mask.shape)
    top, left = (side - mask.shape[0]) // 2, (side - mask.shape[1]) // 2
    square = numpy.tile(image.reshape(-1, 3).mean(0).astype(numpy.uint8), (side, side, 1))
    whole = numpy.zeros((side, side), numpy.uint8)
    place = numpy.s_[top : top + mask.shape[0], left : left + mask.shape[1]]
    square[place], whole[place] = image, mask
    method = cv2.INTER_AREA if side > KEPT else cv2.INTER_LINEAR
    return cv2.resize(square, (KEPT, KEPT), interpolation=method), cv2.resize(whole, (KEPT, KEPT)) > 0


def masks_of(view, found, random):
    """Masks of a view, each with the thing that it shows: true ones, those of segments that were found, and a window
    anywhere, which shows nothing in particular, 0."""
    for thing in numpy.unique(view.ids[view.ids > 0]):
        mask = view.ids == thing
        yield mask, thing
        if random.random() < PART_PROBABILITY:
            yield part_of(mask, random), thing
    if found is not None:
        for segment in numpy.unique(found[found > 0]):
            mask = found == segment
            things, counts = numpy.unique(view.ids[mask], return_counts=True)
            if counts.max() >= MIN_SHARE * mask.sum() and things[counts.argmax()] > 0:
                yield mask, things[counts.argmax()]
    height, width = view.ids.shape
    size = random.integers(20, 100)
    top, left = random.integers(height - size), random.integers(width - size)
    window = numpy.zeros((height, width), bool)
    window[top : top + size, left : left + size] = True
    yield window, 0


def part_of(mask, random):
    """The part of a mask on one side of a line."""
    rows, columns = numpy.nonzero(mask)
    angle = random.uniform(0, 2 * numpy.pi)
    along = numpy.cos(angle) * columns + numpy.sin(angle) * rows
    part = numpy.zeros_like(mask)
    beyond = along > numpy.quantile(along, 1 - random.uniform(MIN_PART, 0.9))
    part[rows[beyond], columns[beyond]] = True
    return part


def painted(view, kinds, palette, random):
    """A view without colour in the colours that things of these kinds have elsewhere."""
    colours = numpy.zeros((int(view.ids.max()) + 1, 3))
    for thing in numpy.unique(view.ids):
        known = palette[kinds[str(thing)]] if thing else []
        colours[thing] = known[random.integers(len(known))] if known else random.uniform(40, 200, 3)
    return colour.shaded(view.depth / numpy.float32(1000), colours[view.ids], view.camera, random)


def read_crops(folders, found_in, kinds, random):
    """The crops of all views of rooms, by their true masks and by the segments in `found_in`. Things of other kinds than
    `kinds` are left out."""
    numbers = {word: number for number, words in enumerate(kinds) for word in words}
    images, masks, chosen, things = [], [], [], []
    # Mean colours of things of each kind, for views without colour.
    palette = defaultdict(list)
    for folder in sorted(map(Path, folders), key=lambda folder: not (folder / "color").exists()):
        description = json.loads((folder / "objects.json").read_text())
        if description["seed"] < 1000:
            raise ValueError(f"{folder}: seed {description['seed']} is one of a room for tests")
        found = sorted((found_in / folder.name / "segments").glob("*.png")) if found_in else []
        for place, (_, view) in enumerate(dataset.read_folder(folder)):
            seen = view.colour
            if seen is None:
                seen = painted(view, description["instances"], palette, random)
            segments = cv2.imread(str(found[place]), cv2.IMREAD_UNCHANGED) if found else None
            for mask, thing in masks_of(view, segments, random):
                kind = description["instances"][str(thing)] if thing else None
                if mask.sum() < MIN_PIXELS or (kind and kind not in numbers):
                    continue
                if kind and view.colour is not None:
                    palette[kind].append(seen[mask].mean(0))
                image, mask = crop(seen, mask)
                images.append(image)
                masks.append(mask)
                chosen.append(numbers[kind] if kind else -1)
                things.append((description["seed"], int(thing)))
    views = Counter(things)
    of_kinds = Counter(kind for (_, kind) in set(zip(things, chosen, strict=True)))
    weights = [views[thing] ** -0.5 * of_kinds[kind] ** -0.3 for thing, kind in zip(things, chosen, strict=True)]
    return Crops(numpy.stack(images), numpy.stack(masks), torch.tensor(chosen), numpy.array(weights) / sum(weights))


def dimmed(image, mask):
    mean = image.reshape(-1, 3).mean(0)
    around = cv2.convertScaleAbs(image, alpha=DIMMED) + ((1 - DIMMED) * mean).astype(numpy.uint8)
    return numpy.where(mask[..., None] > 0, image, around)


def recoloured(image, mask, random):
    """Thing and surroundings with other colours each: a few rooms do not show all that a kind of thing can have."""
    gains = numpy.exp(random.normal(0, 0.1, (2, 1)) + random.normal(0, 0.06, (2, 3)))
    tables = [numpy.clip(numpy.arange(256)[:, None] * gain, 0, 255).astype(numpy.uint8) for gain in gains]
    inside, around = (cv2.LUT(image, table[None]) for table in tables)
    return numpy.where(mask[..., None] > 0, inside, around)


def cut(image, mask, random):
    """A part [side, side, 3] of a crop, turned and mirrored at random, its surroundings mostly dimmed."""
    side = SIZES.side
    if random.random() < 0.3:
        change = cv2.erode if random.random() < 0.5 else cv2.dilate
        grown = random.integers(1, 4)
        mask = change(mask.astype(numpy.uint8), numpy.ones((grown, grown), numpy.uint8))
    image = recoloured(image, mask, random)
    mean = image.reshape(-1, 3).mean(0)
    if random.random() < 0.85:
        image = dimmed(image, mask)
    angle, scale = random.normal(0, 0.08), random.uniform(0.85, 1.15) * side / KEPT
    turn = scale * numpy.array([[numpy.cos(angle), -numpy.sin(angle)], [numpy.sin(angle), numpy.cos(angle)]])
    turn[:, 0] *= random.choice([-1, 1])
    shift = (side - 1) / 2 - turn @ numpy.full(2, (KEPT - 1) / 2) + random.uniform(-3, 3, 2)
    return cv2.warpAffine(
        image,
        numpy.column_stack([turn, shift]),
        (side, side),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=mean.tolist(),
    )


def normalised(images):
    """Images [n, side, side, 3] of 0 to 255 as the network takes them: [n, 3, side, side] from -1 to 1."""
    return images.clamp(0, 255).permute(0, 3, 1, 2) / 127.5 - 1


def samples(crops, chosen, random):
    """Parts of crops with other colours and noise."""
    images = torch.from_numpy(numpy.stack([cut(crops.images[one], crops.masks[one], random) for one in chosen])).float()

    def uniform(low, high, *channels):
        return low + (high - low) * torch.rand(len(images), 1, 1, *channels or (1,))

    grey = images.mean(-1, keepdim=True)
    images = grey + uniform(0.7, 1.2) * (images - grey)
    images = images * uniform(0.9, 1.1, 3) + uniform(-10, 10)
    return normalised(images + uniform(0, 4) * torch.randn(images.shape))


def train(crops, held_out, kinds, arguments):
    """The trained network and the tokens that it knows. Images learn first, with one embedding for each kind and one for
    anything; then texts learn these embeddings."""
    random = numpy.random.default_rng(arguments.seed)
    words = [word for words in kinds for word in words] + ANYTHING
    used, rows, ends = tokenise([prompt(word) for word in words])
    model = TinyClip(len(used), SIZES)
    print(f"{sum(parameter.numel() for parameter in model.parameters())} parameters", flush=True)
    begin(model)
    targets = torch.randn(len(kinds) + 1, SIZES.embedding)
    if arguments.start:
        state = load_file(arguments.start)
        if state.pop("token_rows").tolist() != used:
            raise ValueError(f"{arguments.start}: other words")
        state["token_embedding.weight"] = state.pop("token_embedding.rows")
        model.load_state_dict({name: tensor.float() for name, tensor in state.items()})
        first = [words.index(kind[0]) for kind in kinds] + [len(words) - 1]
        with torch.no_grad():
            targets = SIZES.embedding**0.5 * model.encode_text(rows[first], ends[first])
    targets = nn.Parameter(targets)
    train_images(model, targets, crops, held_out, random, arguments)
    of_words = [kind for kind, words in enumerate(kinds) for _ in words]
    of_words += [len(kinds)] * len(ANYTHING)
    train_texts(model, (rows, ends), functional.normalize(targets.detach(), dim=-1)[of_words])
    return model, used


def begin(model):
    """Begins with tokens that know their places (sines of column and row), and with attention to tokens alike and away from
    the own value, as trained networks have it (Trockman and Kolter 2023): fewer samples are needed."""
    visual, grid, width = model.visual, SIZES.side // SIZES.patch, SIZES.width
    with torch.no_grad():
        place = torch.stack(torch.meshgrid(torch.arange(grid), torch.arange(grid), indexing="ij"), -1).reshape(-1, 2, 1)
        angles = place / 100.0 ** (torch.arange(width // 4) / (width // 4))
        sines = torch.cat([angles.sin(), angles.cos()], -1).reshape(-1, width)
        visual.positional_embedding[1:] = 0.5 * sines
        for block in visual.transformer["resblocks"]:
            attention, head = block.attn, width // block.attn.num_heads
            for start in range(0, width, head):
                similar = 0.7 * torch.randn(width, width) / width**0.5 + 0.7 * torch.eye(width)
                left, sizes, right = torch.linalg.svd(similar)
                root = sizes[:head].sqrt()
                attention.in_proj_weight[start : start + head] = (left[:, :head] * root).T
                attention.in_proj_weight[width + start : width + start + head] = root[:, None] * right[:head]
            through = 0.4 * torch.randn(width, width) / width**0.5 - 0.4 * torch.eye(width)
            left, sizes, right = torch.linalg.svd(through)
            attention.out_proj.weight.copy_(left * sizes.sqrt())
            attention.in_proj_weight[2 * width :] = sizes.sqrt()[:, None] * right


def progress(step, began, arguments):
    """How much of the training is done, 0 to 1, by steps or by the clock."""
    return (time.time() - began) / (60 * arguments.minutes) if arguments.minutes else step / arguments.steps


def train_images(model, targets, crops, held_out, random, arguments):
    # Muon learns from fewer samples, but is only for the matrices between tokens.
    matrices = [one for one in model.visual.transformer.parameters() if one.ndim == 2]
    others = [one for one in model.visual.parameters() if all(one is not matrix for matrix in matrices)]
    others += [model.logit_scale, targets]
    optimisers = [
        torch.optim.Muon(matrices, arguments.matrix_rate, weight_decay=0.01),
        torch.optim.AdamW(others, arguments.rate, betas=(0.9, 0.95), weight_decay=0.05),
    ]
    rates = [group["lr"] for optimiser in optimisers for group in optimiser.param_groups]
    kinds = len(targets) - 1
    began, started, correct, step = time.time(), time.process_time(), 0.0, 0
    while (share := progress(step, began, arguments)) < 1:
        for optimiser, rate in zip(optimisers, rates, strict=True):
            for group in optimiser.param_groups:
                group["lr"] = rate * min(1, (step + 1) / 100) * 0.5 * (1 + numpy.cos(numpy.pi * share))
        chosen = random.choice(len(crops.images), arguments.batch, p=crops.weights)
        tokens = model.visual.tokens(samples(crops, chosen, random))
        right = crops.kinds[chosen]
        right = torch.where(right < 0, kinds, right)
        # The mean of the patches learns it too: the token of the class alone learns slowly.
        scaled = model.logit_scale.exp().clamp(max=100) * functional.normalize(targets, dim=-1).T
        fit, pooled = (model.visual.embedded(token) @ scaled for token in (tokens[:, 0], tokens[:, 1:].mean(1)))
        loss = sum(functional.cross_entropy(one, right, label_smoothing=0.05) for one in (fit, pooled)) / 2
        for optimiser in optimisers:
            optimiser.zero_grad()
        loss.backward()
        for optimiser in optimisers:
            optimiser.step()
        correct += 0.01 * ((fit.argmax(1) == right).float().mean().item() - correct)
        step += 1
        if step % 200 == 0:
            spent = time.process_time() - started
            print(f"step {step}, {spent:.0f} s, {share:.2f}: {loss.item():.3f}, {correct:.3f} right", flush=True)
        if step % 2000 == 0 or progress(step, began, arguments) >= 1:
            report(model, held_out, functional.normalize(targets[:kinds], dim=-1))


def train_texts(model, texts, targets, steps=4000):
    """Teaches the tower for texts these embeddings [texts, embedding]."""
    optimiser = torch.optim.AdamW(
        [parameter for name, parameter in model.named_parameters() if "visual" not in name and name != "logit_scale"],
        3e-3,
    )
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = 3e-3 * (1 - step / steps)
        loss = (1 - (model.encode_text(*texts) * targets).sum(1)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    print(f"texts: cosine {1 - loss.item():.4f} with their kinds", flush=True)


@torch.no_grad()
def report(model, crops, texts):
    """Prints how many crops of rooms that were not learned from get the right word."""
    known = (crops.kinds >= 0).nonzero().flatten().tolist()
    if not known:
        return
    middle = (KEPT - SIZES.side) // 2
    inside = numpy.s_[middle : middle + SIZES.side, middle : middle + SIZES.side]
    images = [dimmed(crops.images[one], crops.masks[one])[inside] for one in known]
    images = normalised(torch.from_numpy(numpy.stack(images)).float())
    found = torch.cat([model.visual(part) for part in images.split(256)])
    right = (found @ texts.T).argmax(1) == crops.kinds[known]
    of_kinds = [right[crops.kinds[known] == kind].float().mean().item() for kind in set(crops.kinds[known].tolist())]
    print(
        f"held out: {right.float().mean():.3f} of {len(known)} right, {numpy.mean(of_kinds):.3f} over kinds", flush=True
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--data", required=True, nargs="+", help="patterns of folders of rooms")
    parser.add_argument(
        "--kinds", type=Path, required=True, help="file with a kind in each line, and other words for it"
    )
    parser.add_argument("--found", type=Path, help="folder with the results of `splatseg run` by the names of rooms")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--start", type=Path, help="network of an earlier run, to go on from")
    parser.add_argument("--steps", type=int, default=9000)
    parser.add_argument("--minutes", type=float, help="instead of a number of steps")
    parser.add_argument("--batch", type=int, default=48)
    parser.add_argument("--rate", type=float, default=2e-3, help="largest learning rate")
    parser.add_argument("--matrix-rate", type=float, default=0.02, help="that of the matrices of transformers")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--held-out", type=int, nargs=2, default=(0, 0), help="seeds of the first and last room only looked at"
    )
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    kinds = read_kinds(arguments.kinds)
    folders = sorted(path for pattern in arguments.data for path in glob.glob(pattern))
    folders = [folder for folder in folders if (Path(folder) / "objects.json").exists()]
    seeds = {folder: json.loads((Path(folder) / "objects.json").read_text())["seed"] for folder in folders}
    is_held_out = {folder: arguments.held_out[0] <= seed <= arguments.held_out[1] for folder, seed in seeds.items()}
    random = numpy.random.default_rng(arguments.seed)
    crops = read_crops([folder for folder in folders if not is_held_out[folder]], arguments.found, kinds, random)
    held_out = Crops(numpy.empty(0), numpy.empty(0), torch.empty(0, dtype=torch.long), numpy.empty(0))
    if any(is_held_out.values()):
        held_out = read_crops([folder for folder in folders if is_held_out[folder]], arguments.found, kinds, random)
    print(f"{len(folders)} rooms, {len(crops.images)} crops to learn from, {len(held_out.images)} held out", flush=True)
    model, used = train(crops, held_out, kinds, arguments)
    export(model, used, arguments.out)


if __name__ == "__main__":
    main()
